"""Executes plans with lifted operators: what each step does, and the situation after it.

`Execution` checks whether each step can be taken. `changes_of` and `executed` assume it.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from cellwright.engine.stages.macros.lifted.bodies import Bindings, satisfiable
from cellwright.engine.stages.macros.lifted.facts import Facts
from cellwright.engine.stages.macros.lifted.ground_steps import GroundStep
from cellwright.engine.stages.macros.lifted.schema import OperatorSchema
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lifted.support import support
from cellwright.engine.stages.macros.lifted.world import CellDomain, StepChange, with_derived
from cellwright.kb.model.conditions import Body
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.terms import Atom


@dataclass
class Execution:
    """The execution of one linearisation.

    `facts` is the present state; `changes` are those of the steps taken, and `before` the states in which they began.
    """

    world: CellDomain
    facts: Facts
    changes: dict[StepId, StepChange] = field(default_factory=dict)
    before: dict[StepId, Facts] = field(default_factory=dict)

    def run(self, plan: Plan) -> str:
        """Execute all steps. Returns the reason why a step cannot be taken, or an empty text."""
        for step in plan.steps:
            refusal = self._take(step)
            if refusal:
                return f"step {step.id} {step.operator}: {refusal}"
        return ""

    def _take(self, step: Step) -> str:
        self.before[step.id] = self.facts
        known = self.world.ground_step(step.operator)
        return self.take_known(step, known) if known is not None else self.take_any(step)

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
        if not satisfiable(schema.body, self.world.statics, bindings):
            return "its constraints do not hold"
        if all(support(body, self.world, self.facts, bindings) is None for body in schema.alternatives):
            return "its precondition does not hold"
        derived = any(map(self.world.schemas.rests_on_rules, _needs(schema)))
        facts = with_derived(self.world, self.facts) if derived else self.facts
        change = self.changes[step.id] = self.world.change(step.operator, facts)
        contradiction = self._contradiction(schema, bindings, change, facts)
        if contradiction:
            return f"it adds and denies {contradiction}"
        self.facts = change.applied(self.facts)
        return ""

    def _contradiction(
        self, schema: OperatorSchema, bindings: Bindings, change: StepChange, facts: Facts
    ) -> Atom | None:
        for each in schema.denies:
            if each.deduced:
                for atom in change.adds:
                    if atom.name == each.atom.name and self.world.fires(each, atom, bindings, facts):
                        return atom
        return None


def _needs(schema: OperatorSchema) -> Iterator[Body]:
    return (each.needs for each in (*schema.adds, *schema.denies, *schema.batches))


def changes_of(start: Situation, steps: Iterable[Step]) -> list[StepChange]:
    """The changes that the steps of a valid plan make when they are executed one after another."""
    world, facts, found = start.world, start.facts, list[StepChange]()
    for step in steps:
        schema, _ = world.binding(step.operator)
        asks = any(map(world.schemas.rests_on_rules, _needs(schema)))
        change = world.change(step.operator, with_derived(world, facts) if asks else facts)
        facts = change.applied(facts)
        found.append(change)
    return found


def executed(plan: Plan, start: Situation) -> Situation:
    """The situation that a valid plan leads to."""
    facts = start.facts
    for change in changes_of(start, plan.steps):
        facts = change.applied(facts)
    return Situation(start.world, facts)
