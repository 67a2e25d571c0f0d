"""The task planner: search to a sequence, made cheaper, then freed of every order it does not need."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from engine.model.task import Bits, GroundOperator, Task, progress
from engine.planning.backward import Effort, Interrupted, space
from engine.planning.deorder import deorder
from engine.planning.improve import eliminate, straighten
from engine.planning.mutexes import mutexes
from engine.planning.portfolio import STRATEGIES, Setting
from engine.planning.variants import TooManyVariants, unconditional
from kb.model.plan import Plan

__all__ = ["STRATEGIES", "Limits", "plan"]


@dataclass(frozen=True, slots=True)
class Limits:
    """Work allowed: `expansions` while searching, `improvement` of them once a plan is known.

    `strategy` is one of `STRATEGIES`; `seed` breaks ties where a search breaks them by chance.
    """

    expansions: int = 1_000_000
    improvement: int = 20_000
    interrupted: Interrupted = field(default=lambda: False)
    strategy: str = "auto"
    seed: int = 0


def plan(task: Task, limits: Limits = Limits()) -> Outcome:
    """A partially ordered plan for a ground task, or why there is none."""
    try:
        operators = unconditional(task)
    except TooManyVariants as error:
        return GaveUp(str(error), "expansions")
    effort = Effort(limits.expansions, limits.interrupted)
    if not task.goals:
        return Infeasible("some goal cannot be reached, whatever is done", _statistics(effort))
    setting = Setting(task, operators, mutexes(task), limits.seed)
    answer = STRATEGIES[limits.strategy](setting, effort)
    statistics = _statistics(effort)
    if answer is None:
        stopped = "time" if effort.expanded < effort.limit else "expansions"
        return GaveUp(f"no plan after {effort.expanded} expansions", stopped, statistics)
    if answer.steps is None and not effort.expanded:
        return Infeasible("the goals cannot be reached together, whatever is done", statistics)
    if answer.steps is None:
        return Infeasible("every way to the goals has been tried", statistics)
    steps = [operators[number] for number in answer.steps]
    return Found(_finished(setting, steps, limits), statistics)


def _finished(setting: Setting, steps: list[GroundOperator], limits: Limits) -> Plan:
    task = setting.task
    goals = _reached(task, steps)
    steps = eliminate(task.initial, steps, goals)
    effort = Effort(limits.improvement, limits.interrupted)
    steps = straighten(space(task, setting.operators, setting.excluded), steps, goals, effort)
    return deorder(task, eliminate(task.initial, steps, goals), goals)


def _reached(task: Task, steps: Sequence[GroundOperator]) -> Bits:
    state = task.initial
    for operator in steps:
        state = progress(state, operator)
    return next(goal for goal in task.goals if goal & ~state == 0)


def _statistics(effort: Effort) -> Statistics:
    return Statistics({"expanded": effort.expanded, "generated": effort.generated})
