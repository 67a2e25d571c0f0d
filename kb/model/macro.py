"""The MACROP: a plan with variables, and the conditions under which an instance is a plan (ITA, figure 4).

It is a value that files and databases hold. `cellwright.engine.stages.macros` makes MACROPs.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from cellwright.kb.model.conditions import Body, Comparison, Literal, Parameter
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.plan import CausalLink, StepId
from cellwright.kb.terms import Atom, Function, Number, Term, Variable

NO_TIME, ONE = Number(0), Number(1)


@dataclass(frozen=True, slots=True)
class MacroStep:
    """One step of the body. `after` are its predecessors; `duration` and `cost` are numbers or variables."""

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

    Any binding of the variables that satisfies `types`, `constraints` (n-ary, over statics), `disequalities`
    and none of the `exclusions`, in a state where the `preconditions` hold, makes the body a plan for the
    `goals` and `chains`. The `adders` hold afterwards. `depends` maps each part of the domain that the proof
    of this uses to its digest. A `subsequence` is an operator for searches; it is not retrieved as a plan for
    goals.
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
        return tuple(each for each in self.name.arguments if isinstance(each, Variable))

    @cached_property
    def cost(self) -> int | None:
        """The sum of the costs of the steps; None if it depends on the binding."""
        costs = [step.cost for step in self.steps]
        return sum(each.value for each in costs if isinstance(each, Number)) if _fixed(costs) else None

    @cached_property
    def duration(self) -> int | None:
        """The length of the longest chain of predecessors, in time units; None if the binding decides."""
        if not _fixed([step.duration for step in self.steps]):
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
            each
            for each in self.types
            if not any(v == each.variable and domain.is_subtype(t, each.type) for v, t in stated)
        )

    def _stated(self, domain: Domain) -> Iterator[tuple[Variable, str]]:
        for literal in (*self.preconditions, *self.goals):
            for argument in literal.atom.arguments:
                yield from _typed_arguments(argument, domain)


def _fixed(terms: Iterable[Term]) -> bool:
    return all(isinstance(each, Number) for each in terms)


def _typed_arguments(term: Term, domain: Domain) -> Iterator[tuple[Variable, str]]:
    signature = domain.functions.get(term.name) if isinstance(term, Function) and term.arguments else None
    if signature is None or not isinstance(term, Function):
        return
    for argument, type_ in zip(term.arguments, signature.arguments, strict=False):
        if isinstance(argument, Variable):
            yield argument, type_
        else:
            yield from _typed_arguments(argument, domain)
