"""Why there is no plan, and which changes would allow one: the answer of `cellwright explain`."""

from dataclasses import dataclass

from kb.model.plan import CausalLink, Step
from kb.terms import Atom


@dataclass(frozen=True, slots=True)
class Amendment:
    """A change to a problem. `kind` is add static, remove static, add initial, remove initial, or drop goal.

    `proof` is the number of steps of a checked plan for the changed problem.
    """

    kind: str
    facts: tuple[Atom, ...] = ()
    goal: str = ""
    proof: int = 0
    missing: tuple[str, ...] = ()  # from the goal down to the condition that is missing

    def __str__(self) -> str:
        what = self.goal or ", ".join(map(str, self.facts))
        return f"{self.kind} {what}"


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why there is no plan. `status` is feasible, infeasible or unknown.

    `goals` is a minimal set of goals that cannot be reached (together, if there are several). `exclusions`
    are pairs of these that are never true at the same time. `changes` are the smallest ones; each is proved
    by a plan.
    """

    status: str
    goals: tuple[str, ...] = ()
    exclusions: tuple[str, ...] = ()
    changes: tuple[Amendment, ...] = ()
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Purpose:
    """A step achieves `condition` for `consumer` (None if it is a goal).

    Through the causal links in `links` this serves a goal.
    """

    condition: Atom
    consumer: Step | None
    links: tuple[CausalLink, ...]


@dataclass(frozen=True, slots=True)
class OrderReason:
    """Why one step comes before another."""

    earlier: Step
    later: Step
    reason: str


@dataclass(frozen=True, slots=True)
class StepReason:
    """Why a step is in a plan, and why it has its place in the order."""

    step: Step
    purposes: tuple[Purpose, ...]
    orders: tuple[OrderReason, ...]
