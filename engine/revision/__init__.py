"""Plan revision: when the world has changed in the middle of a plan, keep what still serves and replan the gap."""

from engine.revision.course import Course
from engine.revision.remaining import remaining
from engine.revision.revise import Revision, revise

__all__ = ["Course", "Revision", "remaining", "revise"]
