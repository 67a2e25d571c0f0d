"""The task planner.

It searches for a sequence of steps, makes the sequence cheaper, and then drops every order that the plan does
not need.
"""

from cellwright.engine.model.outcome import NO_OFFER, Found, GaveUp, Infeasible, Outcome, Statistics
from cellwright.engine.model.task import Task
from cellwright.engine.stages.planning.composites import NO_MACROS, Macros
from cellwright.engine.stages.planning.effort import Effort, OutOfRange, SearchResult
from cellwright.engine.stages.planning.improvement.anytime import best_plan
from cellwright.engine.stages.planning.improvement.deorder import is_internal
from cellwright.engine.stages.planning.limits import LITTLE, RESTARTS, ROOM, Limits
from cellwright.engine.stages.planning.portfolio import STRATEGIES
from cellwright.engine.stages.planning.setting import Setting
from cellwright.engine.stages.planning.variants import TooManyVariants

__all__ = ["LITTLE", "NO_MACROS", "RACE", "RESTARTS", "ROOM", "STRATEGIES", "Limits", "Macros", "plan"]

RACE = "race"  # all strategies at the same time


def plan(task: Task, limits: Limits = Limits(), macros: Macros = NO_MACROS) -> Outcome:
    """A partially ordered plan for a ground task, or the reason why there is none.

    Searches use instances of `macros` as operators, except in a race. The plan contains their steps.
    """
    if limits.strategy == RACE:
        from cellwright.engine.stages.planning.race import race

        return race(task, limits, plan)
    effort = limits.searching()
    if not task.goals:
        return Infeasible("some goal cannot be reached, whatever is done", _statistics(effort))
    setting = Setting(task, limits.seed, macros)
    try:
        first = setting.proof.run(effort) if limits.doubtful else None
        answer = first or STRATEGIES[limits.strategy](setting, effort)
    except (TooManyVariants, OutOfRange) as error:
        return GaveUp(str(error), "expansions", _statistics(effort))
    except MemoryError:
        return GaveUp("out of memory: raise the memory limit, or make the problem smaller", "memory")
    statistics = _statistics(effort, answer)
    if answer is None:
        stopped = "time" if effort.expanded < effort.limit else "expansions"
        return GaveUp(f"no plan after {effort.expanded} expansions", stopped, statistics)
    if answer.steps is None and not effort.expanded:
        return Infeasible("the goals cannot be reached together, whatever is done", statistics)
    if answer.steps is None:
        return Infeasible("every way to the goals has been tried", statistics)
    best, proved = best_plan(setting, answer.steps, limits)
    return Found(best, statistics, optimal=proved or (limits.strategy == "shortest" and _uniform(task)))


def _uniform(task: Task) -> bool:
    """Whether a plan with fewest steps is cheapest. Every plan has as many internal steps, which are free."""
    return len({each.cost for each in task.operators if not is_internal(each.instance)}) == 1


def _statistics(effort: Effort, answer: SearchResult | None = None) -> Statistics:
    counts = {"expanded": effort.expanded, "generated": effort.generated}
    return Statistics(counts, offer=answer.offer if answer else NO_OFFER)
