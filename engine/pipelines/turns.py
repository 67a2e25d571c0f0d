"""What is to be done in its turn is done then, not before: "read the force before opening the drawer" opens the drawer last.

A stage that is a fluent is reached in its turn if it holds then, whenever it was made true. So a search may make it true as
early as it likes. Who asks for it expects it done in its turn. Where that costs nothing, the step that makes it true moves there.
"""

from collections.abc import Iterator, Sequence

from cellwright.engine.model.replay import Instances, instances, reached_goals, replayed
from cellwright.engine.model.stages import REACHES, STAGE
from cellwright.engine.model.task import Bits, GroundOperator, Task, bitset, indices
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.timetable.blocked import operators_of
from cellwright.engine.stages.planning.improvement.deorder import deorder
from cellwright.engine.stages.scheduling.blocks import Unstructured
from cellwright.kb.model.plan import Plan, Step
from cellwright.kb.model.problem import Problem

LONG = 400  # steps; the order of longer plans is as it was found


def in_turn(problem: Problem, task: Task, plan: Plan) -> Plan:
    """The plan with the same steps that makes settings of the workflow in their turn; the plan itself if the gate refuses that."""
    if task.axioms or len(plan.steps) > LONG:
        return plan
    known, order = instances(task), plan.steps
    for _ in plan.steps:
        later = _later(task, known, order)
        if later is None:
            break
        order = later
    if order == plan.steps:
        return plan
    try:
        made = deorder(task, *operators_of(task, Plan(order)))
    except Unstructured:
        return plan
    return plan if PlanGate().findings(problem, made) else made


def _later(task: Task, known: Instances, order: tuple[Step, ...]) -> tuple[Step, ...] | None:
    """The order with one step moved back to its turn; None if every one is there, or cannot be."""
    steps = replayed(task, known, task.initial, [each.operator for each in order])
    for maker, turn in _early(task, steps or ()):
        other = (*order[:maker], *order[maker + 1 : turn + 1], order[maker], *order[turn + 1 :])
        found = replayed(task, known, task.initial, [each.operator for each in other])
        if found is not None and reached_goals(task, _end(task, found)) is not None:
            return other
    return None


def _early(task: Task, steps: Sequence[GroundOperator]) -> Iterator[tuple[int, int]]:
    """The places of steps that make a stage true before its turn, and of those with which its turn comes."""
    stages = bitset([number for number, atom in enumerate(task.atoms) if atom.name == STAGE])
    makers: dict[int, int] = {}
    before, state, place = task.initial, task.initial, -1
    for step in steps:
        if step.instance.name == REACHES:
            for atom in indices(step.preconditions & before & ~stages):
                if 0 <= makers.get(atom, -1) < place:
                    yield makers[atom], place
        else:
            place, before = place + 1, state
            makers |= dict.fromkeys(indices(step.adds & ~state), place)
        state = task.after(state, step)


def _end(task: Task, steps: Sequence[GroundOperator]) -> Bits:
    state = task.initial
    for step in steps:
        state = task.after(state, step)
    return state
