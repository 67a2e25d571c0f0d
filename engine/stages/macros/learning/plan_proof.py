"""Proof why a plan works, with variables in place of constants: explanation-based generalisation.

Every step becomes its operator with new variables. Every causal link makes a condition of its
consumer equal to a consequence of its producer, and nothing else is made equal (Fikes, Hart &
Nilsson 1972; Mooney & DeJong's EGGS 1986; for partial orders Kambhampati & Kedar 1994).
`cellwright.engine.stages.macros.learning.proof_safety` adds the conditions that exclude
disturbances.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

from cellwright.engine.stages.lifted.cell_domain import CellDomain, State, StepChange, with_derived
from cellwright.engine.stages.lifted.fact_queries import FactSet, solve_body
from cellwright.engine.stages.lifted.operator_schemas import GuardedAtom, NotGeneral, OperatorSchema
from cellwright.engine.stages.macros.learning.term_equalities import Equalities
from cellwright.kb.model.conditions import (
    Body,
    BodyPart,
    Comparison,
    Literal,
    part_variables,
    substitute_part,
)
from cellwright.kb.model.domain_model import Kind
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, Plan, Step, StepId
from cellwright.kb.terms import (
    Atom,
    Function,
    Term,
    Variable,
    is_ground,
    match_term,
    sort_naturally,
    substitute_atom,
    term_variables,
)

MAX_PROOF_DEPTH = 40


@dataclass(frozen=True, slots=True)
class SupportedLiteral:
    """A literal that must hold before `consumer`, and the step that makes it so."""

    atom: Atom
    positive: bool
    producer: StepId
    consumer: StepId


@dataclass(frozen=True, slots=True)
class Conjunct:
    """One literal that a consumer needs, with variables, and its ground atom in the plan."""

    literal: Literal
    ground: Atom


@dataclass
class PlanProof:
    """The proof of one plan, built step by step.

    `origin` has the constant of each variable in that plan.
    """

    world: CellDomain
    plan: Plan
    initial: State
    equal: Equalities = field(default_factory=Equalities)
    origin: dict[Variable, Term] = field(default_factory=dict)
    schemas: dict[StepId, OperatorSchema] = field(default_factory=dict)
    needs: dict[SupportedLiteral, None] = field(default_factory=dict)
    constraints: dict[BodyPart, None] = field(default_factory=dict)
    states: dict[StepId, FactSet] = field(default_factory=dict)
    changes: dict[StepId, StepChange] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._header: dict[StepId, dict[Variable, Variable]] = {}
        self.before = self.plan.predecessors()
        self._places = {step.id: place for place, step in enumerate(self.plan.steps)}
        self._linked: dict[StepId, dict[Atom, StepId]] = {}
        for link in self.plan.links:
            self._linked.setdefault(link.consumer, {})[link.condition] = link.producer
        for step in self.plan.steps:
            self._lift(step)
        self._execute()

    def _lift(self, step: Step) -> None:
        schema, bindings = self.world.binding(step.operator)
        if schema.universal:
            raise NotGeneral(f"a condition of {step.operator.name} is about all objects")
        fresh = {variable: self.world.schemas.fresh(variable) for variable in schema.variables()}
        self.schemas[step.id] = schema.renamed(fresh)
        self._header[step.id] = {
            variable: fresh[variable] for variable in schema.operator.variables
        }
        self.origin.update({fresh[variable]: bindings[variable] for variable in bindings})

    def header(self, step: StepId) -> dict[Variable, Variable]:
        """For each variable in the header of the step's operator, the variable in this proof."""
        return self._header[step]

    def _execute(self) -> None:
        facts = FactSet(sort_naturally(self.initial))
        for step in self.plan.steps:
            self.states[step.id] = with_derived(self.world, facts)
            self.changes[step.id] = self.world.change(step.operator, self.states[step.id])
            facts = self.changes[step.id].applied(facts)
        self.states[GOAL_STEP] = with_derived(self.world, facts)

    def justify(self, step: Step) -> None:
        """Collect what one step needs: its constraints, and its precondition as its links
        provide it.
        """
        schema = self.schemas[step.id]
        bindings = next(
            solve_body(schema.body, self.world.statics, self._ground(schema.body)), None
        )
        if bindings is None:
            raise NotGeneral(f"the constraints of {step.operator} do not hold")
        self._constrain(schema.body, bindings)
        if not any(self.rest(body, step.id, {}) is not None for body in schema.alternatives):
            raise NotGeneral(f"the precondition of {step.operator} does not hold")

    def rest(
        self, body: Body, consumer: StepId, bindings: dict[Variable, Term]
    ) -> list[Conjunct] | None:
        """Prove a body for `consumer`, and add its needs to the proof.

        Returns the literals over fluents that the proof uses, or None if the body does not hold.
        """
        sources = [[*self._provided(consumer)]] if self._linked.get(consumer) else []
        for available in [*map(FactSet, sources), self.states[consumer]]:
            start = {**self._ground(body), **bindings}
            solution = next(self._prove(body, start, available, consumer, 0), None)
            if solution is not None:
                ground, leaves, equations = solution
                self.origin.update(ground)
                for left, right in equations:
                    self.equal.join(left, right)
                return [part for leaf in leaves for part in self._leaf(leaf, consumer)]
        return None

    def _provided(self, consumer: StepId) -> Iterator[Atom]:
        return (
            linked_atom
            for linked_atom in self._linked.get(consumer, {})
            if linked_atom.name != "not"
        )

    def _ground(self, body: Body) -> dict[Variable, Term]:
        used = (variable for part in body for variable in part_variables(part))
        return {variable: self.origin[variable] for variable in used if variable in self.origin}

    def _constrain(self, body: Body, bindings: dict[Variable, Term]) -> None:
        self.origin.update(bindings)
        self.constraints.update(dict.fromkeys(body))

    def _leaf(self, leaf: BodyPart, consumer: StepId) -> Iterator[Conjunct]:
        if not self.world.schemas.is_dynamic(leaf) or not isinstance(leaf, Literal):
            self.constraints[leaf] = None
            return
        ground = substitute_atom(leaf.atom, self.origin)
        if self.world.schemas.kinds.get(leaf.atom.name) is Kind.FLUENT:
            self.need(leaf.atom, leaf.positive, consumer)
            yield Conjunct(leaf, ground)
        else:
            yield from self._frozen(leaf, consumer)

    def _frozen(self, leaf: Literal, consumer: StepId) -> Iterator[Conjunct]:
        """A negated derived literal stays as it was in the plan: with its constants.

        It is false because no rule supports it, so the consumer needs everything that its links
        provide.
        """
        for variable in term_variables(leaf.atom):
            self.equal.join(variable, self.origin[variable])
        for condition in self._linked.get(consumer, {}):
            negated = condition.name == "not" and len(condition.arguments) == 1
            atom = condition.arguments[0] if negated else condition
            if isinstance(atom, Function) and not atom.name.startswith("_"):
                self.need(atom, not negated, consumer)
                yield Conjunct(Literal(atom, not negated), atom)

    # The following methods explain how a literal becomes true.

    def need(self, atom: Atom, positive: bool, consumer: StepId) -> None:
        """Add a fluent literal to the needs of `consumer`, and explain how it becomes true."""
        ground = substitute_atom(atom, self.origin)
        producer = self._producer(ground, positive, consumer)
        self.needs[SupportedLiteral(atom, positive, producer, consumer)] = None
        if producer != INITIAL_STEP:
            self.produce(producer, atom, ground, positive)

    def _producer(self, ground: Atom, positive: bool, consumer: StepId) -> StepId:
        condition = ground if positive else Function("not", (ground,))
        linked = self._linked.get(consumer, {}).get(condition)
        if linked is not None:
            return linked
        place = self._places.get(consumer, len(self.plan.steps))
        producer: StepId | None = None
        for step in reversed(self.plan.steps[:place]):
            change = self.changes[step.id]
            gained, lost = (change.adds, change.ends) if positive else (change.ends, change.adds)
            if ground in gained and (consumer == GOAL_STEP or step.id in self.before[consumer]):
                producer = step.id
            elif ground in lost:
                break
        else:
            if (ground in self.initial) == positive:
                return INITIAL_STEP
        if producer is None:
            raise NotGeneral(f"nothing makes {condition} true for step {consumer}")
        return producer

    def produce(self, producer: StepId, atom: Atom, ground: Atom, positive: bool) -> None:
        """Make a literal equal to a consequence of `producer`.

        The guard and needs of this join the proof.
        """
        schema = self.schemas[producer]
        candidates = sorted(
            schema.adds if positive else schema.denies, key=lambda addition: len(addition.guard)
        )
        for candidate in candidates:
            candidate = self.apart(candidate)
            bindings = self._as(candidate, ground)
            if bindings is None:
                continue
            self.origin.update(bindings)
            self.equal.join(candidate.atom, atom)
            self._hold(candidate.guard)
            if candidate.needs and self.rest(candidate.needs, producer, bindings) is None:
                continue
            return
        raise NotGeneral(f"step {producer} does not provide {ground}")

    def apart(self, following: GuardedAtom) -> GuardedAtom:
        """The consequence with new local variables.

        It may be used for several values, and each use needs its own.
        """
        used = (
            variable
            for part in (*following.guard, *following.needs)
            for variable in part_variables(part)
        )
        local = {
            v: self.world.schemas.fresh(v)
            for v in (*term_variables(following.atom), *used)
            if v not in self.origin
        }
        return following.renamed(local) if local else following

    def _as(self, following: GuardedAtom, ground: Atom) -> dict[Variable, Term] | None:
        known_bindings = {
            v: self.origin[v] for v in term_variables(following.atom) if v in self.origin
        }
        match_bindings = match_term(following.atom, ground, known_bindings)
        if match_bindings is None:
            return None
        return next(
            solve_body(
                following.guard,
                self.world.statics,
                {**self._ground(following.guard), **match_bindings},
            ),
            None,
        )

    def _hold(self, guard: Body) -> None:
        for part in guard:
            if isinstance(part, Comparison) and part.relation == "=":
                self.equal.join(part.left, part.right)
            else:
                self.constraints[part] = None

    # Bodies are proved by resolution, with the constants of the plan. The variables are kept beside
    # them.

    def _prove(
        self,
        body: Body,
        ground: dict[Variable, Term],
        available: FactSet,
        consumer: StepId,
        depth: int,
    ) -> (
        "Iterator[tuple[dict[Variable, Term], tuple[BodyPart, ...], tuple[tuple[Term, Term], ...]]]"
    ):
        if not body:
            yield ground, (), ()
            return
        index = self._next(body, ground)
        part, rest = body[index], body[:index] + body[index + 1 :]
        if isinstance(part, Literal) and part.positive and self.world.schemas.is_derived(part.atom):
            yield from self._by_rule(part.atom, rest, ground, available, consumer, depth)
            return
        for extended in self._solutions(part, ground, available, consumer):
            for ground_bindings, leaves, equations in self._prove(
                rest, extended, available, consumer, depth
            ):
                yield ground_bindings, (part, *leaves), equations

    def _next(self, body: Body, ground: dict[Variable, Term]) -> int:
        def rank(part: BodyPart) -> int:
            closed = all(variable in ground for variable in part_variables(part))
            positive = isinstance(part, Literal) and part.positive
            derived = isinstance(part, Literal) and self.world.schemas.is_derived(part.atom)
            return (
                0
                if closed and not derived
                else 1
                if positive and not derived
                else 2
                if derived
                else 3
            )

        return min(range(len(body)), key=lambda index: rank(body[index]))

    def _solutions(
        self, part: BodyPart, ground: dict[Variable, Term], available: FactSet, consumer: StepId
    ) -> Iterator[dict[Variable, Term]]:
        if not self.world.schemas.is_dynamic(part):
            yield from solve_body((part,), self.world.statics, ground)
        elif isinstance(part, Literal) and part.positive:
            yield from solve_body((part,), available, ground)
        elif isinstance(part, Literal) and is_ground(substitute_atom(part.atom, ground)):
            yield from solve_body((part,), self.states[consumer], ground)
        else:
            raise NotGeneral(f"{part} is about all instances")

    def _by_rule(
        self,
        atom: Atom,
        rest: Body,
        ground: dict[Variable, Term],
        available: FactSet,
        consumer: StepId,
        depth: int,
    ) -> (
        "Iterator[tuple[dict[Variable, Term], tuple[BodyPart, ...], tuple[tuple[Term, Term], ...]]]"
    ):
        if depth > MAX_PROOF_DEPTH:
            return
        if not is_ground(substitute_atom(atom, ground)):
            for answer in solve_body((Literal(atom),), self.states[consumer], ground):
                yield from self._by_rule(atom, rest, answer, available, consumer, depth)
            return
        target = substitute_atom(atom, ground)
        for rule in self.world.schemas.rules:
            if rule.head.name != atom.name:
                continue
            used = [
                *term_variables(rule.head),
                *(v for part in rule.body for v in part_variables(part)),
            ]
            fresh = {variable: self.world.schemas.fresh(variable) for variable in used}
            head = substitute_atom(rule.head, fresh)
            head_bindings = match_term(head, target, ground)
            if head_bindings is None:
                continue
            body = tuple(substitute_part(part, fresh) for part in rule.body)
            for solved, leaves, equations in self._prove(
                body + rest, head_bindings, available, consumer, depth + 1
            ):
                yield solved, leaves, ((head, atom), *equations)
