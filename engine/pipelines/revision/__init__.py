"""Plan revision: when the world changes in the middle of a plan, keep the steps that still serve and plan the rest anew."""

from cellwright.engine.pipelines.revision.course import Course
from cellwright.engine.pipelines.revision.remaining import remaining
from cellwright.engine.pipelines.revision.revise import PlanRevision, planned_anew, revise

__all__ = ["Course", "PlanRevision", "planned_anew", "remaining", "revise"]
