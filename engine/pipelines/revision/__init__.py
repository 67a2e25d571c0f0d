"""Plan revision: when the world has changed in the middle of a plan, keep what still serves and replan the gap."""

from engine.pipelines.revision.course import Course
from engine.pipelines.revision.remaining import remaining
from engine.pipelines.revision.revise import Revision, planned_anew, revise

__all__ = ["Course", "Revision", "planned_anew", "remaining", "revise"]
