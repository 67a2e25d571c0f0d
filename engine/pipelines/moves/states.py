"""The states of a plan: which facts hold before each step, and after it."""

from collections.abc import Iterator

from cellwright.engine.model.forecast import earliest_starts
from cellwright.engine.stages.validation.changes import State
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.plan import Plan, Step


def states_of(semantics: Semantics, plan: Plan) -> Iterator[tuple[Step, State, State]]:
    """Each step in the order of the earliest starts, with the facts before and after it."""
    state = semantics.initial()
    for step in in_order(plan):
        after = after_step(semantics, step, state)
        yield step, state, after
        state = after


def in_order(plan: Plan) -> list[Step]:
    """The steps in the order of the earliest starts; of those that start together, in the order of the plan."""
    starts = earliest_starts(plan)
    place = {step.id: number for number, step in enumerate(plan.steps)}
    return sorted(plan.steps, key=lambda each: (starts[each.id], place[each.id]))


def after_step(semantics: Semantics, step: Step, state: State) -> State:
    """The facts after a step; those before it, if it is none of the domain."""
    found = semantics.binding(step.operator)
    if isinstance(found, str):
        return state
    change = semantics.change(*found, semantics.facts(state), state)
    return (state - change.ends) | change.adds
