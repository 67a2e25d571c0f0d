"""Execution of plans with lifted operators: each step's change, and what conditions rest on.

A condition is asked for, and rules answer it: only what it needs is looked at. That a state is
completed with all its derived atoms first (`with_derived`) is needed only for rules that build on
themselves, or that leave an argument open.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from cellwright.engine.stages.lifted.cell_domain import (
    CellDomain,
    Situation,
    StepChange,
    body_holds,
    with_derived,
)
from cellwright.engine.stages.lifted.fact_queries import (
    Bindings,
    FactSet,
    is_satisfiable,
    solve_body,
)
from cellwright.engine.stages.lifted.ground_steps import GroundStep
from cellwright.engine.stages.lifted.operator_schemas import OperatorSchema
from cellwright.kb.model.conditions import Body, Literal
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.terms import Atom, Function, is_ground, match_term, substitute_atom


class _Open(Exception):
    """A derived atom with an open argument is asked for."""


def find_support(
    body: Body, world: CellDomain, facts: FactSet, bindings: Bindings
) -> tuple[Atom, ...] | None:
    """The fluents that make a body true in a state, as `not(...)` where they must be false; None if
    it is not true.

    Where rules build on themselves, only the fluents that the body names itself are told.
    """
    if not world.schemas.is_recursive():
        try:
            return _first_support(body, world, facts, bindings)
        except _Open:
            pass
    if not body_holds(body, world, with_derived(world, facts), bindings):
        return None
    named = tuple(
        p for p in body if world.schemas.is_dynamic(p) and not world.schemas.rests_on_rules((p,))
    )
    return _first_support(named, world, facts, bindings)


def _first_support(
    body: Body, world: CellDomain, facts: FactSet, bindings: Bindings
) -> tuple[Atom, ...] | None:
    """What the first binding that makes a body true rests on."""
    literals = [
        part for part in body if isinstance(part, Literal) and world.schemas.is_dynamic(part)
    ]
    static = tuple(part for part in body if part not in literals)
    derived = tuple(literal for literal in literals if world.schemas.is_derived(literal.atom))
    present = tuple(literal for literal in literals if literal.positive and literal not in derived)
    absent = tuple(
        literal for literal in literals if not literal.positive and literal not in derived
    )
    for first in solve_body(present, facts, bindings):
        for static_bindings in solve_body(static, world.statics, first):
            if not is_satisfiable(absent, facts, static_bindings):
                continue
            below = _through_rules(derived, world, facts, static_bindings)
            if below is not None:
                return (
                    *_ground_atoms(present, static_bindings),
                    *_negate_atoms(_ground_atoms(absent, static_bindings)),
                    *below,
                )
    return None


def _through_rules(
    derived: Iterable[Literal], world: CellDomain, facts: FactSet, bindings: Bindings
) -> tuple[Atom, ...] | None:
    """What derived conditions rest on together; None if one of them is not as it should be."""
    together: list[Atom] = []
    for derived_literal in derived:
        atom = substitute_atom(derived_literal.atom, bindings)
        if not is_ground(atom):
            raise _Open
        proof = _atom_support(atom, world, facts)
        if (proof is None) == derived_literal.positive:
            return None
        together += proof or ()
    return tuple(together)


def _atom_support(atom: Atom, world: CellDomain, facts: FactSet) -> tuple[Atom, ...] | None:
    for rule in world.schemas.rules:
        if rule.head.name == atom.name and (bound := match_term(rule.head, atom, {})) is not None:
            body_support = _first_support(rule.body, world, facts, dict(bound))
            if body_support is not None:
                return body_support
    return None


def _ground_atoms(literals: Iterable[Literal], bindings: Bindings) -> Iterator[Atom]:
    return (substitute_atom(literal.atom, bindings) for literal in literals)


def _negate_atoms(atoms: Iterable[Atom]) -> Iterator[Atom]:
    return (Function("not", (atom,)) for atom in atoms)


@dataclass
class LiftedExecution:
    """The execution of one linearisation.

    `facts` is the present state; `changes` are those of the steps taken, and `before` the states in
    which they began.
    """

    world: CellDomain
    facts: FactSet
    changes: dict[StepId, StepChange] = field(default_factory=dict)
    before: dict[StepId, FactSet] = field(default_factory=dict)

    def run(self, plan: Plan) -> str:
        """Execute all steps. Returns the reason why a step cannot be taken, or an empty text."""
        for step in plan.steps:
            refusal = self._take(step)
            if refusal:
                return f"step {step.id} {step.operator}: {refusal}"
        return ""

    def _take(self, step: Step) -> str:
        self.before[step.id] = self.facts
        prepared = self.world.ground_step(step.operator)
        return self.take_known(step, prepared) if prepared is not None else self.take_any(step)

    def take_known(self, step: Step, known: GroundStep) -> str:
        """Execute a prepared step. Returns the reason why it cannot be taken, or an empty text."""
        if known.refusal or not known.applicable(self.facts):
            return known.refusal or "its precondition does not hold"
        ends = known.ended(self.facts, self.world.statics)
        change = self.changes[step.id] = StepChange(known.adds, ends, known.events)
        self.facts = change.applied(self.facts)
        return ""

    def take_any(self, step: Step) -> str:
        """Execute a step from its operator's schema.

        Returns the reason why it cannot be taken, or an empty text.
        """
        schema, bindings = self.world.binding(step.operator)
        if not is_satisfiable(schema.body, self.world.statics, bindings):
            return "its constraints do not hold"
        if all(
            find_support(body, self.world, self.facts, bindings) is None
            for body in schema.alternatives
        ):
            return "its precondition does not hold"
        derived = any(map(self.world.schemas.rests_on_rules, _schema_needs(schema)))
        facts = with_derived(self.world, self.facts) if derived else self.facts
        change = self.changes[step.id] = self.world.change(step.operator, facts)
        contradiction = self._contradiction(schema, bindings, change, facts)
        if contradiction:
            return f"it adds and denies {contradiction}"
        self.facts = change.applied(self.facts)
        return ""

    def _contradiction(
        self, schema: OperatorSchema, bindings: Bindings, change: StepChange, facts: FactSet
    ) -> Atom | None:
        for denial in schema.denies:
            if denial.deduced:
                for atom in change.adds:
                    if atom.name == denial.atom.name and self.world.fires(
                        denial, atom, bindings, facts
                    ):
                        return atom
        return None


def _schema_needs(schema: OperatorSchema) -> Iterator[Body]:
    return (guarded.needs for guarded in (*schema.adds, *schema.denies, *schema.batches))


def changes_of(start: Situation, steps: Iterable[Step]) -> list[StepChange]:
    """The changes that the steps of a valid plan make when they are executed one after another."""
    world, facts, changes = start.world, start.facts, list[StepChange]()
    for step in steps:
        schema, _ = world.binding(step.operator)
        asks = any(map(world.schemas.rests_on_rules, _schema_needs(schema)))
        change = world.change(step.operator, with_derived(world, facts) if asks else facts)
        facts = change.applied(facts)
        changes.append(change)
    return changes


def final_situation(plan: Plan, start: Situation) -> Situation:
    """The situation that a valid plan leads to."""
    facts = start.facts
    for change in changes_of(start, plan.steps):
        facts = change.applied(facts)
    return Situation(start.world, facts)
