"""Is there a cheaper plan? All states of a task are looked at, where that is possible."""

from dataclasses import replace

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.replay import early
from cellwright.engine.pipelines.gate import accepted
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning.elimination import eliminate, reached
from cellwright.engine.stages.planning.improvement.deorder import deorder
from cellwright.engine.stages.planning.improvement.exact import optimum
from cellwright.engine.stages.planning.limits import Room
from cellwright.engine.stages.planning.variants import TooManyVariants, unconditional
from cellwright.kb.model.problem import Problem

ROOM = Room(states=2_000_000, checks=400_000_000)


def proved(problem: Problem, found: Found, interrupted: Interrupted, room: Room = ROOM) -> Found:
    """The same answer, or a cheaper one, with the proof that nothing is cheaper; as it is if that takes too long."""
    if found.optimal or found.plan.cost == 0:
        return replace(found, optimal=True)
    task = ground(problem)
    try:
        operators = unconditional(task)
    except TooManyVariants:
        return found
    size, bound = len(task.atoms), found.plan.cost
    best = optimum(operators, size, task.initial, task.goals, bound, interrupted, room)
    if best is None:
        return found
    if best.steps is None:
        return replace(found, optimal=True)
    steps = early(task, best.steps)
    goals = reached(task, steps)
    plan = deorder(task, eliminate(task.initial, steps, goals), goals)
    return replace(found, plan=accepted(problem, plan), optimal=True)
