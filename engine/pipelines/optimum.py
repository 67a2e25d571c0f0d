"""Is there a cheaper plan? Uniform-cost search over states (Dijkstra 1959), for small tasks."""

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from engine.model.outcome import Found
from engine.model.task import Bits, GroundOperator, Task, progress
from engine.pipelines.gate import accepted
from engine.stages.grounding import ground
from engine.stages.planning.elimination import eliminate
from engine.stages.planning.improvement.deorder import deorder
from engine.stages.planning.variants import plainly
from kb.model.plan import Plan
from kb.model.problem import Problem

MOST = 2_000_000  # tests of an operator in a state; after so many the search gives up

Interrupted = Callable[[], bool]


@dataclass(frozen=True, slots=True)
class Optimum:
    """The steps of a cheapest plan; None if no plan is cheaper than the bound."""

    steps: tuple[GroundOperator, ...] | None


def optimum(task: Task, bound: int, interrupted: Interrupted, most: int = MOST) -> Optimum | None:
    """A cheapest of all plans that cost less than `bound`; None if the search gave up or was interrupted."""
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
    """The same answer or a cheaper one, marked as optimal; the answer unchanged if the proof takes too long."""
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
