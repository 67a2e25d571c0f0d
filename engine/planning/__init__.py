"""The task planner: search to a sequence, made cheaper, then freed of every order it does not need."""

from collections.abc import Sequence

from engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from engine.model.task import Bits, GroundOperator, Task, progress
from engine.planning.deorder import deorder
from engine.planning.effort import Effort
from engine.planning.improvement import improvements
from engine.planning.limits import Limits
from engine.planning.portfolio import STRATEGIES, Setting
from engine.planning.variants import TooManyVariants, plainly
from kb.model.plan import Plan

__all__ = ["STRATEGIES", "Limits", "plan"]


def plan(task: Task, limits: Limits = Limits()) -> Outcome:
    """A partially ordered plan for a ground task, or why there is none."""
    effort = limits.searching()
    if not task.goals:
        return Infeasible("some goal cannot be reached, whatever is done", _statistics(effort))
    setting = Setting(task, limits.seed)
    try:
        answer = STRATEGIES[limits.strategy](setting, effort)
    except TooManyVariants as error:
        return GaveUp(str(error), "expansions", _statistics(effort))
    statistics = _statistics(effort)
    if answer is None:
        stopped = "time" if effort.expanded < effort.limit else "expansions"
        return GaveUp(f"no plan after {effort.expanded} expansions", stopped, statistics)
    if answer.steps is None and not effort.expanded:
        return Infeasible("the goals cannot be reached together, whatever is done", statistics)
    if answer.steps is None:
        return Infeasible("every way to the goals has been tried", statistics)
    return Found(_finished(setting, answer.steps, limits), statistics)


def _finished(setting: Setting, steps: Sequence[GroundOperator], limits: Limits) -> Plan:
    """The best partially ordered plan that improvement makes of a sequence of steps."""
    task = setting.task
    goals = _reached(task, steps)
    found: list[Plan] = []
    for better in improvements(task, setting.regression, plainly(task, steps), goals, limits.improving()):
        found.append(deorder(task, better, goals))
        limits.improved(found[-1])
    return found[-1]


def _reached(task: Task, steps: Sequence[GroundOperator]) -> Bits:
    state = task.initial
    for operator in steps:
        state = progress(state, operator)
    return next(goal for goal in task.goals if goal & ~state == 0)


def _statistics(effort: Effort) -> Statistics:
    return Statistics({"expanded": effort.expanded, "generated": effort.generated})
