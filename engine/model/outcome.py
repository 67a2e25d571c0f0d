"""The outcome of a search (plan, proof of none, or limit), and the check of linearizations."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.terms import Function


@dataclass(frozen=True, slots=True)
class Counterexample:
    """An order that fails: its last step cannot be done, or all steps are done and the goal
    does not hold.
    """

    order: tuple[StepId, ...]
    at_the_goal: bool


@dataclass(frozen=True, slots=True)
class OrderCheck:
    """Whether every order is valid; None if this is unknown."""

    valid: bool | None
    counterexample: Counterexample | None = None


@dataclass(frozen=True, slots=True)
class MacroOffer:
    """The MACROPs that a search had as operators, as steps with variables, and those that its plan
    uses.

    `search` is the search that answered, `backward` or `forward`; it is empty if no MACROPs were
    offered.
    """

    search: str = ""
    offered: tuple[tuple[Function, ...], ...] = ()
    used: tuple[tuple[Function, ...], ...] = ()


NO_OFFER = MacroOffer()


@dataclass(frozen=True, slots=True)
class Statistics:
    """Measurements of one run, for research.

    Times are in seconds and never part of golden output.
    """

    counts: Mapping[str, int] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    offer: MacroOffer = NO_OFFER


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
    """The search stopped at a limit (`limit` is expansions, time or memory), or was not
    exhaustive.
    """

    reason: str
    limit: str = "expansions"
    statistics: Statistics = Statistics()


Outcome = Found | Infeasible | GaveUp
