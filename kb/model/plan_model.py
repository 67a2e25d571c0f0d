"""The plan (partially ordered steps with causal links) and the MACROP, a plan with variables.

It is a value that files and databases hold. `cellwright.engine.stages.macros` makes MACROPs.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NewType

from cellwright.kb.model.conditions import Body, Comparison, Literal, Parameter
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.terms import Atom, Function, Number, Term, Variable

StepId = NewType("StepId", int)
INITIAL_STEP = StepId(0)  # produces the initial state
GOAL_STEP = StepId(-1)  # consumes the goals


@dataclass(frozen=True, slots=True)
class Step:
    """One operator instance.

    `after` are the steps that must end before it starts, transitively reduced.
    """

    id: StepId
    operator: Function
    after: tuple[StepId, ...] = ()
    resources: tuple[Term, ...] = ()
    duration: int = 0  # the domain's unit of time
    cost: int = 1


@dataclass(frozen=True, slots=True)
class CausalLink:
    """`producer` achieves `condition` for `consumer`; no step ordered between them may delete
    it.
    """

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
    """A line of a history as a file has it: a stage of a chain, the step that reaches it, its
    start and its duration.
    """

    chain: str
    stage: str
    step: StepId
    start: int
    duration: int


@dataclass(frozen=True, slots=True)
class Claims:
    """What a plan file says beside the plan, all of which can be computed; None and empty where it
    says nothing.

    `starts` are times in the domain's unit. `told` is the makespan that the answer around the plan
    tells, and `bound` the one that no order of the steps is said to stay below.
    """

    starts: Mapping[StepId, int] = field(default_factory=dict)
    cost: int | None = None
    makespan: int | None = None
    histories: tuple[Happened, ...] = ()
    told: int | None = None
    bound: int | None = None


def full_order(plan: Plan) -> Plan:
    """The same plan in full order: each step comes after the one before it in the list."""
    steps = tuple(
        replace(step, after=(plan.steps[place - 1].id,) if place else ())
        for place, step in enumerate(plan.steps)
    )
    return Plan(steps, plan.links)


NO_TIME, ONE = Number(0), Number(1)


@dataclass(frozen=True, slots=True)
class MacroStep:
    """One step of the body.

    `after` are its predecessors; `duration` and `cost` are numbers or variables.
    """

    id: StepId
    operator: Function
    after: tuple[StepId, ...] = ()
    resources: tuple[Term, ...] = ()
    duration: Term = NO_TIME
    cost: Term = ONE


@dataclass(frozen=True, slots=True)
class MacroChain:
    """A workflow chain that the body completes. Names of chains are variables, too."""

    name: Term
    stages: tuple[Atom, ...]
    after: tuple[Term, ...] = ()
    subject: Term | None = None


@dataclass(frozen=True, slots=True)
class MacroPart:
    """Steps of a body that are an instance of another MACROP, and the name of that MACROP."""

    name: str
    steps: tuple[StepId, ...]


@dataclass(frozen=True)
class Macrop:
    """A generalised plan.

    Any binding of the variables that satisfies `types`, `constraints` (n-ary, over statics),
    `disequalities` and none of the `exclusions`, in a state where the `preconditions` hold, makes
    the body a plan for the `goals` and `chains`. The `adders` hold afterwards. `depends` maps each
    part of the domain that the proof of this uses to its digest. A `subsequence` is an operator for
    searches; it is not retrieved as a plan for goals.
    """

    name: Function
    domain: str
    goals: tuple[Literal, ...]
    preconditions: tuple[Literal, ...]
    adders: tuple[Atom, ...]
    types: tuple[Parameter, ...]
    constraints: Body
    disequalities: tuple[Comparison, ...]
    exclusions: tuple[Body, ...]  # bodies over statics; none of them may have a binding
    resources: tuple[Term, ...]
    steps: tuple[MacroStep, ...]
    links: tuple[CausalLink, ...]
    chains: tuple[MacroChain, ...] = ()
    depends: Mapping[str, str] = field(default_factory=dict)
    parts: tuple[MacroPart, ...] = ()
    subsequence: bool = False

    @property
    def parameters(self) -> tuple[Variable, ...]:
        """The header's variables: those that the goals do not bind, then those of the goals."""
        return tuple(argument for argument in self.name.arguments if isinstance(argument, Variable))

    @cached_property
    def cost(self) -> int | None:
        """The sum of the costs of the steps; None if it depends on the binding."""
        costs = [step.cost for step in self.steps]
        return (
            sum(cost.value for cost in costs if isinstance(cost, Number))
            if _are_numbers(costs)
            else None
        )

    @cached_property
    def duration(self) -> int | None:
        """The length of the longest chain of predecessors, in time units; None if the binding
        decides.
        """
        if not _are_numbers([step.duration for step in self.steps]):
            return None
        ends: dict[StepId, int] = {}
        for step in self.steps:
            own = step.duration.value if isinstance(step.duration, Number) else 0
            ends[step.id] = own + max((ends[before] for before in step.after), default=0)
        return max(ends.values(), default=0)

    def unary_constraints(self, domain: Domain) -> tuple[Parameter, ...]:
        """The types that must be tested.

        Types that a compound term in a precondition or goal already implies are left out.
        """
        stated = set(self._stated(domain))
        return tuple(
            constraint
            for constraint in self.types
            if not any(
                v == constraint.variable and domain.is_subtype(t, constraint.type)
                for v, t in stated
            )
        )

    def _stated(self, domain: Domain) -> Iterator[tuple[Variable, str]]:
        for literal in (*self.preconditions, *self.goals):
            for argument in literal.atom.arguments:
                yield from _typed_arguments(argument, domain)


def _are_numbers(terms: Iterable[Term]) -> bool:
    return all(isinstance(term, Number) for term in terms)


def _typed_arguments(term: Term, domain: Domain) -> Iterator[tuple[Variable, str]]:
    signature = (
        domain.functions.get(term.name) if isinstance(term, Function) and term.arguments else None
    )
    if signature is None or not isinstance(term, Function):
        return
    for argument, type_ in zip(term.arguments, signature.arguments, strict=False):
        if isinstance(argument, Variable):
            yield argument, type_
        else:
            yield from _typed_arguments(argument, domain)
