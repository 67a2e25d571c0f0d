"""Which steps of a plan have no motion, or leave a body's way to somebody else."""

from cellwright.engine.model.motion_values import UnprovedStep
from cellwright.engine.pipelines.motion.places_in_a_row import changed_bodies, handled_bodies
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, operation_of, states_of
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.kb.model.cell_model import Cell, Operation
from cellwright.kb.model.plan_model import Plan, Step
from cellwright.kb.terms import Atom


def unproved_steps(walk: PlanWalk, plan: Plan) -> tuple[UnprovedStep, ...]:
    """The steps of a plan of which something is not proved, in the order of their starts."""
    unproved = []
    last: tuple[frozenset[Atom], GeometricWorld] | None = None
    home = GeometricWorld.of(walk.cell)
    for step, before, after in states_of(walk.semantics, plan):
        operation = operation_of(walk.cell, step.operator)
        facts, new_facts = (walk.located(state) for state in (before, after))
        if facts == new_facts:
            if operation is None:
                unproved.append(UnprovedStep(step.id, step.operator))
            continue
        old = last[1] if last and last[0] == facts else world_after_facts(home, facts)
        new = world_after_facts(home, new_facts)
        last = new_facts, new
        unproved += _unproved(walk.cell, step, operation, old, new)
    return tuple(unproved)


def _unproved(
    cell: Cell,
    step: Step,
    operation: Operation | None,
    before: GeometricWorld,
    after: GeometricWorld,
) -> list[UnprovedStep]:
    """What is not proved of a step that changes the cell; none if an arm moves all of it."""
    if operation is None:
        return [UnprovedStep(step.id, step.operator, tuple(changed_bodies(before, after)))]
    stops = map(str, (*operation.stops, operation.with_place))
    places = [cell.places[stop] for stop in stops if stop in cell.places]
    carried = str(operation.carries)  # by both arms, on a way that is proved
    jumping = tuple(
        body.body
        for body in handled_bodies(before, after, places)
        if body.jumps and body.body != carried
    )
    where = places[0].name if places else operation.drives
    return [UnprovedStep(step.id, step.operator, jumping, where)] if jumping else []
