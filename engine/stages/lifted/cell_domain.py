"""Cell domain: a domain with the static facts of one cell, its changes by steps, its situations.

The module also says what a ground step does in a state of such a world.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

from cellwright.engine.stages.lifted.domain_digests import DomainDigests
from cellwright.engine.stages.lifted.fact_queries import (
    Bindings,
    FactSet,
    GivenFacts,
    LayeredFacts,
    is_satisfiable,
    solve_body,
)
from cellwright.engine.stages.lifted.ground_steps import GroundStep, ground_step, is_plain
from cellwright.engine.stages.lifted.operator_schemas import (
    GuardedAtom,
    NotGeneral,
    OperatorSchema,
    OperatorSchemas,
    stand_in,
)
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.asp.static_program import VIOLATED, type_guard
from cellwright.kb.graphs import strong_components
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.conditions import (
    Aggregate,
    Body,
    Literal,
    Parameter,
    StateAggregate,
    literals_in,
)
from cellwright.kb.model.domain_model import Domain, Rule
from cellwright.kb.model.operator_amounts import Amounts
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import (
    Atom,
    Function,
    Term,
    Variable,
    match_term,
    sort_naturally,
    substitute_atom,
)

State = frozenset[Atom]
MAX_KEPT_STEPS = 1 << 15  # ground steps


@dataclass(frozen=True, slots=True)
class StepChange:
    """The atoms that a step adds, the atoms of the state that it ends, and its events."""

    adds: tuple[Atom, ...]
    ends: tuple[Atom, ...]
    events: tuple[Atom, ...] = ()

    def applied(self, facts: FactSet) -> FactSet:
        """The facts after the step."""
        return facts.after(self.ends, self.adds)


class CellDomain:
    """A domain with the statics of one cell."""

    def __init__(self, problem: Problem, schemas: OperatorSchemas | None = None) -> None:
        self.problem = problem
        self.domain: Domain = problem.domain
        self.schemas = schemas if schemas is not None else OperatorSchemas(problem.domain)
        self.ground_step = lru_cache(MAX_KEPT_STEPS)(self._ground_step)
        self.fitting: dict[tuple[str, Atom], tuple[Term, ...] | None] = {}
        """What lookup found out with the statics alone, for goals of MACROPs and goals of
        queries.
        """
        self._plain: dict[str, bool] = {}
        self._stratified: tuple[Rule, ...] | None = None
        self._strata: list[list[Rule]] = []

    @cached_property
    def statics(self) -> FactSet:
        """The atoms that hold in every state. They are evaluated at the first use."""
        grounder = evaluate_statics(self.problem, _aggregate_rules(self.domain))
        return GivenFacts(grounder.named, grounder.holds)

    @cached_property
    def amounts(self) -> Amounts:
        """The durations and costs of steps in the cell."""
        return amounts_of(self.problem, self._facts_of)

    def _facts_of(self, name: str, arity: int) -> Iterator[tuple[Term, ...]]:
        return (fact.arguments for fact in self.statics.named(name) if len(fact.arguments) == arity)

    @property
    def violated(self) -> bool:
        """Whether an integrity constraint of the domain is violated. Then no plan makes sense."""
        return bool(self.statics.named(VIOLATED))

    @cached_property
    def digests(self) -> DomainDigests:
        """The digests of the domain's parts."""
        return DomainDigests(self.domain)

    @property
    def strata(self) -> list[list[Rule]]:
        """The rules of derived predicates in an order in which negation looks only backwards."""
        # operators add rules when they are first met
        if self._stratified is not self.schemas.rules:
            self._stratified, self._strata = self.schemas.rules, self._layers()
        return self._strata

    def _layers(self) -> list[list[Rule]]:
        graph: dict[str, list[str]] = {rule.head.name: [] for rule in self.schemas.rules}
        for rule in self.schemas.rules:
            used = (literal.atom.name for part in rule.body for literal in literals_in(part))
            graph[rule.head.name] += [name for name in used if name in graph]
        return [
            [rule for rule in self.schemas.rules if rule.head.name in part]
            for part in strong_components(graph)
        ]

    def fits(self, problem: Problem) -> bool:
        """Whether a problem has the same domain, objects and statics."""
        own = self.problem
        pairs = (
            (problem.statics, own.statics),
            (problem.objects, own.objects),
            (problem.durations, own.durations),
        )
        return problem.domain is own.domain and all(
            mine is theirs or mine == theirs for mine, theirs in pairs
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

    def change(self, step: Function, facts: FactSet) -> StepChange:
        """What a step does in a state that allows it.

        `facts` must include the derived atoms that the conditions of its effects name.
        """
        schema, bindings = self.binding(step)
        adds = dict.fromkeys(
            atom for addition in schema.adds for atom in self._instances(addition, bindings, facts)
        )
        ends = dict.fromkeys(
            atom for denial in schema.denies for atom in self._ended(denial, bindings, facts)
        )
        events = [substitute_atom(event, bindings) for event in schema.events]
        events += dict.fromkeys(
            a for batch in schema.batches for a in self._instances(batch, bindings, facts)
        )
        return StepChange(
            tuple(adds), tuple(atom for atom in ends if atom not in adds), tuple(events)
        )

    def _instances(
        self, guarded: GuardedAtom, bindings: Bindings, facts: FactSet
    ) -> Iterator[Atom]:
        if self.domain.quantities:  # numbers in a guard have their values from the state
            for solution in solve_body(
                (*guarded.guard, *guarded.needs), LayeredFacts(facts, self.statics), bindings
            ):
                yield substitute_atom(guarded.atom, solution)
            return
        for solution in solve_body(guarded.guard, self.statics, bindings):
            if not guarded.needs or body_holds(guarded.needs, self, facts, solution):
                yield substitute_atom(guarded.atom, solution)

    def _ended(self, guarded: GuardedAtom, bindings: Bindings, facts: FactSet) -> Iterator[Atom]:
        for atom in facts.matching(substitute_atom(guarded.atom, bindings)):
            if self.fires(guarded, atom, bindings, facts):
                yield atom

    def fires(self, guarded: GuardedAtom, atom: Atom, bindings: Bindings, facts: FactSet) -> bool:
        """Whether a step adds or denies `atom` by this consequence."""
        match_bindings = match_term(guarded.atom, atom, bindings)
        if match_bindings is None:
            return False
        if not guarded.needs:
            return is_satisfiable(guarded.guard, self.statics, match_bindings)
        return any(
            body_holds(guarded.needs, self, facts, solution)
            for solution in solve_body(guarded.guard, self.statics, match_bindings)
        )


def body_holds(body: Body, world: CellDomain, state: FactSet, bindings: Bindings) -> bool:
    """Whether some binding makes a body true in a state. `state` must include the derived atoms."""
    static = tuple(part for part in body if not world.schemas.is_dynamic(part))
    dynamic = tuple(part for part in body if world.schemas.is_dynamic(part))
    positive = tuple(part for part in dynamic if isinstance(part, Literal) and part.positive)
    negative = tuple(part for part in dynamic if part not in positive)
    return any(
        is_satisfiable(negative, state, solution)
        for first in solve_body(positive, state, bindings)
        for solution in solve_body(static, world.statics, first)
    )


def with_derived(world: CellDomain, facts: FactSet) -> FactSet:
    """A state with its derived atoms.

    The rules of each stratum are applied until nothing new follows.
    """
    for stratum in world.strata:
        while True:
            derived_atoms = [
                atom
                for rule in stratum
                for bindings in _body_solutions(rule.body, world, facts)
                if (atom := substitute_atom(rule.head, bindings)) not in facts
            ]
            if not derived_atoms:
                break
            facts = facts.after((), derived_atoms)
    return facts


def _body_solutions(
    body: Body, world: CellDomain, state: FactSet
) -> Iterator[Mapping[Variable, Term]]:
    if any(isinstance(part, StateAggregate) for part in body):
        yield from solve_body(body, LayeredFacts(state, world.statics), {})
        return
    dynamic = tuple(
        p for p in body if world.schemas.is_dynamic(p) and isinstance(p, Literal) and p.positive
    )
    negative = tuple(p for p in body if world.schemas.is_dynamic(p) and p not in dynamic)
    static = tuple(p for p in body if not world.schemas.is_dynamic(p))
    for first in solve_body(dynamic, state, {}):
        for static_bindings in solve_body(static, world.statics, first):
            if is_satisfiable(negative, state, static_bindings):
                yield static_bindings


def _aggregate_rules(domain: Domain) -> Iterator[str]:
    bodies: list[tuple[Body, tuple[Parameter, ...]]] = [
        (operator.body, operator.parameters) for operator in domain.operators
    ]
    bodies += [
        ((*d.body, *c.body), c.parameters)
        for d in domain.deductive_operators
        for c in d.consequences
    ]
    for body, parameters in bodies:
        if any(isinstance(part, Aggregate) for part in body):
            yield (
                f"{stand_in(body, parameters)} :- "
                f"{', '.join([*type_guard(parameters), *map(str, body)])}."
            )


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


@dataclass(frozen=True, slots=True)
class Situation:
    """A state of a world.

    The situation after a step shares everything that the step does not touch, so it is cheap.
    """

    world: CellDomain
    facts: FactSet

    @classmethod
    def of(cls, world: CellDomain, state: Iterable[Atom]) -> "Situation":
        """The situation of a state. The atoms are sorted, so that results repeat."""
        return cls(world, FactSet(sort_naturally(state)))

    @property
    def state(self) -> frozenset[Atom]:
        """The atoms that are true."""
        return self.facts.atoms()
