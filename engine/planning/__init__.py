"""The task planner: backward chaining to a sequence, made cheaper, then freed of every order it does not need."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from engine.model.task import Bits, GroundOperator, Task, progress
from engine.planning.backward import Answer, Backward, Effort, Interrupted, Node, space
from engine.planning.deorder import deorder
from engine.planning.improve import eliminate, straighten
from engine.planning.mutexes import mutexes
from engine.planning.variants import TooManyVariants, unconditional
from kb.model.plan import Plan

CLIMB = 500  # expansions given to hill climbing before best-first search takes over
GREED = 5


@dataclass(frozen=True, slots=True)
class Limits:
    """Work allowed: `expansions` while searching, `improvement` of them once a plan is known."""

    expansions: int = 200_000
    improvement: int = 20_000
    interrupted: Interrupted = field(default=lambda: False)


def plan(task: Task, limits: Limits = Limits()) -> Outcome:
    """A partially ordered plan for a ground task, or why there is none."""
    try:
        operators = unconditional(task)
    except TooManyVariants as error:
        return GaveUp(str(error), "expansions")
    excluded = mutexes(task)
    backward = space(task, operators, excluded)
    roots = [root for goal in task.goals if (root := backward.root(goal)) is not None]
    effort = Effort(limits.expansions, limits.interrupted)
    if not roots:
        return Infeasible("the goals cannot be reached together, whatever is done", _statistics(effort))
    answer = _search(backward, roots, effort)
    statistics = _statistics(effort)
    if answer.steps is None and answer.exhausted:
        return Infeasible("every way back from the goals has been tried", statistics)
    if answer.steps is None:
        stopped = "time" if effort.expanded < effort.limit else "expansions"
        return GaveUp(f"no plan after {effort.expanded} expansions", stopped, statistics)
    steps = [operators[number] for number in answer.steps]
    return Found(_finished(task, backward, steps, limits), statistics)


def _search(backward: Backward, roots: Sequence[Node], effort: Effort) -> Answer:
    """Hill climbing while it is quick, then best first, which is complete."""
    total = effort.limit
    effort.limit = min(CLIMB, total)
    answer = backward.climb(roots[0], effort)
    effort.limit = total
    if answer.steps is not None or (answer.exhausted and len(roots) == 1):
        return answer
    return backward.best_first(roots, effort, GREED)


def _finished(task: Task, backward: Backward, steps: list[GroundOperator], limits: Limits) -> Plan:
    goals = _reached(task, steps)
    steps = eliminate(task.initial, steps, goals)
    steps = straighten(backward, steps, goals, Effort(limits.improvement, limits.interrupted))
    return deorder(task, eliminate(task.initial, steps, goals), goals)


def _reached(task: Task, steps: Sequence[GroundOperator]) -> Bits:
    state = task.initial
    for operator in steps:
        state = progress(state, operator)
    return next(goal for goal in task.goals if goal & ~state == 0)


def _statistics(effort: Effort) -> Statistics:
    return Statistics({"expanded": effort.expanded, "generated": effort.generated})
