"""Answers: a plan was found, proved impossible, or the search gave up."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from kb.model.plan import Plan


@dataclass(frozen=True, slots=True)
class Statistics:
    """What a researcher wants to know of one run; times in seconds, never part of golden output."""

    counts: Mapping[str, int] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Found:
    """A checked plan; `optimal` only if proved."""

    plan: Plan
    statistics: Statistics = Statistics()
    optimal: bool = False


@dataclass(frozen=True, slots=True)
class Infeasible:
    """Proved: no plan exists. `reason` is a sentence for people."""

    reason: str
    statistics: Statistics = Statistics()


@dataclass(frozen=True, slots=True)
class GaveUp:
    """The search stopped at a limit (`limit`: expansions, time or memory) or could not be exhaustive."""

    reason: str
    limit: str = "expansions"
    statistics: Statistics = Statistics()


Outcome = Found | Infeasible | GaveUp
