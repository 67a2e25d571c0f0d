"""Is there a cheaper plan? Uniform-cost search (Dijkstra 1959) over states, for tasks small enough to be searched."""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, replace

from engine.kernels.cancellation import Interrupted
from engine.model.outcome import Found
from engine.model.task import Bits, GroundOperator, Task, progress
from engine.pipelines.gate import accepted
from engine.stages.grounding import ground
from engine.stages.planning.elimination import eliminate
from engine.stages.planning.improvement.deorder import deorder
from engine.stages.planning.variants import plainly
from kb.model.plan import Plan
from kb.model.problem import Problem

MOST = 2_000_000  # questions whether an operator can be done in a state, before the search is given up


@dataclass(frozen=True, slots=True)
class Optimum:
    """Steps of a cheapest plan; None if none is cheaper than the bound."""

    steps: tuple[GroundOperator, ...] | None


def optimum(task: Task, bound: int, interrupted: Interrupted, most: int = MOST) -> Optimum | None:
    """A cheapest of all plans that cost less than `bound`; None if that would take too long to find out."""
    costs: dict[Bits, int] = {task.initial: 0}
    reached: dict[Bits, tuple[Bits, GroundOperator]] = {}
    queue, asked = [(0, 0, task.initial)], 0
    while queue:
        cost, _, state = heapq.heappop(queue)
        if cost > costs[state]:
            continue
        if any(not goal & ~state for goal in task.goals):
            return Optimum(_way(reached, state))
        asked += len(task.operators)
        if asked > most or interrupted():
            return None
        for operator in task.operators:
            dearer = cost + operator.cost
            if operator.preconditions & ~state or dearer >= bound:
                continue
            following = progress(state, operator)
            if dearer < costs.get(following, bound):
                costs[following], reached[following] = dearer, (state, operator)
                heapq.heappush(queue, (dearer, len(reached), following))
    return Optimum(None)


def _way(reached: dict[Bits, tuple[Bits, GroundOperator]], state: Bits) -> tuple[GroundOperator, ...]:
    steps = []
    while state in reached:
        state, operator = reached[state]
        steps.append(operator)
    return tuple(reversed(steps))


def proved(problem: Problem, found: Found, interrupted: Interrupted) -> Found:
    """The same answer, or a cheaper one, with the proof that nothing is cheaper; as it is if that takes too long."""
    if found.optimal or found.plan.cost == 0:
        return replace(found, optimal=True)
    task = ground(problem)
    best = optimum(task, found.plan.cost, interrupted)
    if best is None:
        return found
    if best.steps is None:
        return replace(found, optimal=True)
    return replace(found, plan=accepted(problem, _ordered(task, best.steps)), optimal=True)


def _ordered(task: Task, steps: Sequence[GroundOperator]) -> Plan:
    plain, state = plainly(task, steps), task.initial
    for operator in plain:
        state = progress(state, operator)
    goals = next(goal for goal in task.goals if not goal & ~state)
    return deorder(task, eliminate(task.initial, plain, goals), goals)
