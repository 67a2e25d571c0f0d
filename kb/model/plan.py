"""The plan: partially ordered steps with causal links (McAllester & Rosenblitt 1991), as a value."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NewType

from cellwright.kb.terms import Atom, Function, Term

StepId = NewType("StepId", int)
START = StepId(0)  # produces the initial state
GOAL = StepId(-1)  # consumes the goals


@dataclass(frozen=True, slots=True)
class Step:
    """One operator instance. `after` are the steps that must end before it starts, transitively reduced."""

    id: StepId
    operator: Function
    after: tuple[StepId, ...] = ()
    resources: tuple[Term, ...] = ()
    duration: int = 0  # the domain's unit of time
    cost: int = 1


@dataclass(frozen=True, slots=True)
class CausalLink:
    """`producer` achieves `condition` for `consumer`; no step ordered between them may delete it."""

    producer: StepId
    condition: Atom  # `not(p)` for a negative condition
    consumer: StepId


@dataclass(frozen=True, slots=True)
class Plan:
    """Steps, listed in an order that can be executed.

    Unordered steps may overlap in time; therefore they never interfere.
    """

    steps: tuple[Step, ...]
    links: tuple[CausalLink, ...] = ()

    @property
    def cost(self) -> int:
        """The sum of the costs of the steps."""
        return sum(step.cost for step in self.steps)

    def predecessors(self) -> dict[StepId, frozenset[StepId]]:
        """For each step, all steps that must come before it, directly or through others."""
        closed: dict[StepId, frozenset[StepId]] = {}
        for step in self.steps:
            direct = frozenset(step.after)
            closed[step.id] = direct.union(*(closed.get(before, frozenset()) for before in direct))
        return closed


@dataclass(frozen=True, slots=True)
class Happened:
    """A line of a history as a file has it: a stage of a chain, the step that reaches it, its start and its duration."""

    chain: str
    stage: str
    step: StepId
    start: int
    duration: int


@dataclass(frozen=True, slots=True)
class Claims:
    """What a plan file says beside the plan, all of which can be computed; None and empty where it says nothing.

    `starts` are times in the domain's unit. `told` is the makespan that the answer around the plan tells, and `bound` the one
    that no order of the steps is said to stay below.
    """

    starts: Mapping[StepId, int] = field(default_factory=dict)
    cost: int | None = None
    makespan: int | None = None
    histories: tuple[Happened, ...] = ()
    told: int | None = None
    bound: int | None = None


def in_sequence(plan: Plan) -> Plan:
    """The same plan in full order: each step comes after the one before it in the list."""
    steps = tuple(
        replace(step, after=(plan.steps[place - 1].id,) if place else ())
        for place, step in enumerate(plan.steps)
    )
    return Plan(steps, plan.links)
