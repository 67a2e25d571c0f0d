"""Answers: a plan was found, proved impossible, or the search gave up."""

from collections.abc import Mapping
from dataclasses import field

from kb.model.plan import Plan
from kb.records import dataclass
from kb.terms import Function


@dataclass(frozen=True, slots=True)
class Statistics:
    """What a researcher wants to know of one run; times in seconds, never part of golden output.

    `offered` are the MACROPs, as steps with variables, that searches had as operators; `used` those that the answer rests on.
    """

    counts: Mapping[str, int] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    offered: tuple[tuple[Function, ...], ...] = ()
    used: tuple[tuple[Function, ...], ...] = ()


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
