"""The world of a cell: the domain and statics that its problems share. The statics are evaluated once.

The module also says what a ground step does in a state of such a world.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

from cellwright.engine.stages.macros.lifted.bodies import Bindings, satisfiable, solve
from cellwright.engine.stages.macros.lifted.digests import Digests
from cellwright.engine.stages.macros.lifted.facts import Facts, GivenFacts, Layered
from cellwright.engine.stages.macros.lifted.ground_steps import GroundStep, ground_step, is_plain
from cellwright.engine.stages.macros.lifted.schema import (
    Following,
    NotGeneral,
    OperatorSchema,
    Schemas,
    stand_in,
)
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.asp.vocabulary import VIOLATED, guard
from cellwright.kb.graphs import components
from cellwright.kb.loader.amounts import amounts_of
from cellwright.kb.model.amounts import Amounts
from cellwright.kb.model.conditions import Aggregate, Body, Literal, Parameter, StateAggregate, literals
from cellwright.kb.model.domain import Domain, Rule
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Term, Variable, match, substitute_atom

State = frozenset[Atom]
KEPT = 1 << 15  # ground steps


@dataclass(frozen=True, slots=True)
class StepChange:
    """The atoms that a step adds, the atoms of the state that it ends, and its events."""

    adds: tuple[Atom, ...]
    ends: tuple[Atom, ...]
    events: tuple[Atom, ...] = ()

    def applied(self, facts: Facts) -> Facts:
        """The facts after the step."""
        return facts.after(self.ends, self.adds)


class CellDomain:
    """A domain with the statics of one cell."""

    def __init__(self, problem: Problem, schemas: Schemas | None = None) -> None:
        self.problem = problem
        self.domain: Domain = problem.domain
        self.schemas = schemas if schemas is not None else Schemas(problem.domain)
        self.ground_step = lru_cache(KEPT)(self._ground_step)
        self.fitting: dict[tuple[str, Atom], tuple[Term, ...] | None] = {}
        """What lookup found out with the statics alone, for goals of MACROPs and goals of queries."""
        self._plain: dict[str, bool] = {}
        self._stratified: tuple[Rule, ...] | None = None
        self._strata: list[list[Rule]] = []

    @cached_property
    def statics(self) -> Facts:
        """The atoms that hold in every state. They are evaluated at the first use."""
        grounder = evaluated(self.problem, _aggregate_rules(self.domain))
        return GivenFacts(grounder.named, grounder.holds)

    @cached_property
    def amounts(self) -> Amounts:
        """The durations and costs of steps in the cell."""
        return amounts_of(self.problem, self._facts_of)

    def _facts_of(self, name: str, arity: int) -> Iterator[tuple[Term, ...]]:
        return (each.arguments for each in self.statics.named(name) if len(each.arguments) == arity)

    @property
    def violated(self) -> bool:
        """Whether an integrity constraint of the domain is violated. Then no plan makes sense."""
        return bool(self.statics.named(VIOLATED))

    @cached_property
    def digests(self) -> Digests:
        """The digests of the domain's parts."""
        return Digests(self.domain)

    @property
    def strata(self) -> list[list[Rule]]:
        """The rules of derived predicates in an order in which negation looks only backwards."""
        if self._stratified is not self.schemas.rules:  # operators add rules when they are first met
            self._stratified, self._strata = self.schemas.rules, self._layers()
        return self._strata

    def _layers(self) -> list[list[Rule]]:
        graph: dict[str, list[str]] = {rule.head.name: [] for rule in self.schemas.rules}
        for rule in self.schemas.rules:
            used = (each.atom.name for part in rule.body for each in literals(part))
            graph[rule.head.name] += [name for name in used if name in graph]
        return [[rule for rule in self.schemas.rules if rule.head.name in part] for part in components(graph)]

    def fits(self, problem: Problem) -> bool:
        """Whether a problem has the same domain, objects and statics."""
        own = self.problem
        return problem.domain is own.domain and all(
            one is other or one == other
            for one, other in ((problem.statics, own.statics), (problem.objects, own.objects))
        )

    def binding(self, step: Function) -> tuple[OperatorSchema, dict[Variable, Term]]:
        """The schema of a step, and the values of its header variables.

        Raises `NotGeneral` if they do not fit.
        """
        schema = self.schemas.named(step.name)
        if len(step.arguments) != len(schema.operator.parameters):
            raise NotGeneral(f"{step.name} takes {len(schema.operator.parameters)} arguments")
        return schema, dict(zip(schema.operator.variables, step.arguments, strict=True))

    def _ground_step(self, step: Function) -> GroundStep | None:
        """A step prepared for all states; None if that depends on the state."""
        schema, bindings = self.binding(step)
        if step.name not in self._plain:
            self._plain[step.name] = is_plain(schema, self.schemas)
        return ground_step(schema, bindings, self.statics) if self._plain[step.name] else None

    def change(self, step: Function, facts: Facts) -> StepChange:
        """What a step does in a state that allows it.

        `facts` must include the derived atoms that the conditions of its effects name.
        """
        schema, bindings = self.binding(step)
        adds = dict.fromkeys(atom for each in schema.adds for atom in self._instances(each, bindings, facts))
        ends = dict.fromkeys(atom for each in schema.denies for atom in self._ended(each, bindings, facts))
        events = [substitute_atom(each, bindings) for each in schema.events]
        events += dict.fromkeys(a for each in schema.batches for a in self._instances(each, bindings, facts))
        return StepChange(tuple(adds), tuple(atom for atom in ends if atom not in adds), tuple(events))

    def _instances(self, each: Following, bindings: Bindings, facts: Facts) -> Iterator[Atom]:
        if self.domain.quantities:  # numbers in a guard have their values from the state
            for found in solve((*each.guard, *each.needs), Layered(facts, self.statics), bindings):
                yield substitute_atom(each.atom, found)
            return
        for found in solve(each.guard, self.statics, bindings):
            if not each.needs or holds(each.needs, self, facts, found):
                yield substitute_atom(each.atom, found)

    def _ended(self, each: Following, bindings: Bindings, facts: Facts) -> Iterator[Atom]:
        for atom in facts.matching(substitute_atom(each.atom, bindings)):
            if self.fires(each, atom, bindings, facts):
                yield atom

    def fires(self, each: Following, atom: Atom, bindings: Bindings, facts: Facts) -> bool:
        """Whether a step adds or denies `atom` by this consequence."""
        found = match(each.atom, atom, bindings)
        if found is None:
            return False
        if not each.needs:
            return satisfiable(each.guard, self.statics, found)
        return any(holds(each.needs, self, facts, other) for other in solve(each.guard, self.statics, found))


def holds(body: Body, world: CellDomain, state: Facts, bindings: Bindings) -> bool:
    """Whether some binding makes a body true in a state. `state` must include the derived atoms."""
    static = tuple(part for part in body if not world.schemas.is_dynamic(part))
    dynamic = tuple(part for part in body if world.schemas.is_dynamic(part))
    positive = tuple(part for part in dynamic if isinstance(part, Literal) and part.positive)
    negative = tuple(part for part in dynamic if part not in positive)
    return any(
        satisfiable(negative, state, found)
        for first in solve(positive, state, bindings)
        for found in solve(static, world.statics, first)
    )


def with_derived(world: CellDomain, facts: Facts) -> Facts:
    """A state with its derived atoms. The rules of each stratum are applied until nothing new follows."""
    for stratum in world.strata:
        while True:
            found = [
                atom
                for rule in stratum
                for bindings in _solutions(rule.body, world, facts)
                if (atom := substitute_atom(rule.head, bindings)) not in facts
            ]
            if not found:
                break
            facts = facts.after((), found)
    return facts


def _solutions(body: Body, world: CellDomain, state: Facts) -> Iterator[Mapping[Variable, Term]]:
    if any(isinstance(part, StateAggregate) for part in body):
        yield from solve(body, Layered(state, world.statics), {})
        return
    dynamic = tuple(p for p in body if world.schemas.is_dynamic(p) and isinstance(p, Literal) and p.positive)
    negative = tuple(p for p in body if world.schemas.is_dynamic(p) and p not in dynamic)
    static = tuple(p for p in body if not world.schemas.is_dynamic(p))
    for first in solve(dynamic, state, {}):
        for found in solve(static, world.statics, first):
            if satisfiable(negative, state, found):
                yield found


def _aggregate_rules(domain: Domain) -> Iterator[str]:
    bodies: list[tuple[Body, tuple[Parameter, ...]]] = [
        (each.body, each.parameters) for each in domain.operators
    ]
    bodies += [((*d.body, *c.body), c.parameters) for d in domain.deductive_operators for c in d.consequences]
    for body, parameters in bodies:
        if any(isinstance(part, Aggregate) for part in body):
            yield f"{stand_in(body, parameters)} :- {', '.join([*guard(parameters), *map(str, body)])}."


class CellDomains:
    """The worlds that were used last, at most `most`. Problems of one cell share one world."""

    def __init__(self, most: int = 8) -> None:
        self._most = most
        self._recent: list[CellDomain] = []

    def of(self, problem: Problem) -> CellDomain:
        """The world of a problem. If none of the recent ones fits, a new one is made."""
        for index, world in enumerate(self._recent):
            if world.fits(problem):
                if index:
                    self._recent.insert(0, self._recent.pop(index))
                return world
        shared = next((w.schemas for w in self._recent if w.domain is problem.domain), None)
        world = CellDomain(problem, shared)
        self._recent = [world, *self._recent[: self._most - 1]]
        return world
