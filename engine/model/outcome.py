"""Answers: a plan was found, proved impossible, or the search gave up."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from kb.model.plan import Plan
from kb.terms import Function


@dataclass(frozen=True, slots=True)
class Offer:
    """The MACROPs, as steps with variables, that the search which answered had as operators, and those that it took.

    `search` is `backward` or `forward`, empty if nothing was offered.
    """

    search: str = ""
    offered: tuple[tuple[Function, ...], ...] = ()
    used: tuple[tuple[Function, ...], ...] = ()


NO_OFFER = Offer()


@dataclass(frozen=True, slots=True)
class Statistics:
    """What a researcher wants to know of one run; times in seconds, never part of golden output."""

    counts: Mapping[str, int] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    offer: Offer = NO_OFFER


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
