"""Task planner: searches a sequence of steps, makes it cheaper, and drops every needless order.

It searches for a sequence of steps, makes the sequence cheaper, and then drops every order that the
plan does not need.
"""

from dataclasses import replace

from cellwright.engine.kernels.bits import indices
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import NO_OFFER, Found, GaveUp, Infeasible, Outcome, Statistics
from cellwright.engine.model.workflow_replay import said_of
from cellwright.engine.stages.planning.composites import NO_MACROS, Macros
from cellwright.engine.stages.planning.effect_variants import TooManyVariants
from cellwright.engine.stages.planning.improvement.anytime_improvement import best_plan
from cellwright.engine.stages.planning.improvement.plan_reordering import is_internal
from cellwright.engine.stages.planning.portfolio import STRATEGIES, SearchSetting
from cellwright.engine.stages.planning.search_control import (
    RESTARTS,
    SMALL_STATE_ROOM,
    STATE_ROOM,
    UNLIMITED,
    Effort,
    OutOfRange,
    SearchLimits,
    SearchResult,
    expansions_within,
)
from cellwright.engine.stages.planning.shortage import shortages

__all__ = [
    "NO_MACROS",
    "RACE",
    "RESTARTS",
    "SMALL_STATE_ROOM",
    "STATE_ROOM",
    "STRATEGIES",
    "UNLIMITED",
    "Macros",
    "SearchLimits",
    "expansions_within",
    "plan_task",
]

# goals that are looked at by themselves, and expansions for each
MAX_ALONE, FEW_EXPANSIONS = 12, 200
NO_GOALS = "some goal cannot be reached, whatever is done"
RACE = "race"  # all strategies at the same time


def plan_task(
    task: GroundTask, limits: SearchLimits = SearchLimits(), macros: Macros = NO_MACROS
) -> Outcome:
    """A partially ordered plan for a ground task, or the reason why there is none.

    Searches use instances of `macros` as operators, except in a race. The plan contains their
    steps.
    """
    if limits.strategy == RACE:
        from cellwright.engine.stages.planning.strategy_race import race_strategies

        return race_strategies(task, limits, plan_task)
    effort = limits.searching()
    if why := "; ".join(map(str, shortages(task))) if task.goals else NO_GOALS:
        return Infeasible(why, _search_statistics(effort))
    setting = SearchSetting(task, limits.seed, macros)
    try:
        first = setting.proof.run(effort) if limits.doubtful else None
        answer = first or STRATEGIES[limits.strategy](setting, effort)
    except (TooManyVariants, OutOfRange) as error:
        return GaveUp(str(error), "expansions", _search_statistics(effort))
    except MemoryError:
        return GaveUp(
            "out of memory: raise the memory limit, or make the problem smaller", "memory"
        )
    statistics = _search_statistics(effort, answer)
    if answer is None:
        stopped = "time" if effort.expanded < effort.limit else "expansions"
        return GaveUp(f"no plan after {effort.expanded} expansions", stopped, statistics)
    if answer.steps is None and not effort.expanded:
        return Infeasible(_out_of_reach(task, limits), statistics)
    if answer.steps is None:
        return Infeasible("every way to the goals has been tried", statistics)
    best, proved = best_plan(setting, answer.steps, limits)
    return Found(
        best,
        statistics,
        optimal=proved or (limits.strategy == "shortest" and _has_uniform_costs(task)),
    )


def _out_of_reach(task: GroundTask, limits: SearchLimits) -> str:
    """Which goal cannot be reached by itself; only if none is found, that they cannot be
    reached together.
    """
    wanted = indices(task.goals[0]) if len(task.goals) == 1 else []
    for each in wanted if 1 < len(wanted) <= MAX_ALONE else []:
        single = SearchSetting(replace(task, goals=(1 << each,)), limits.seed, NO_MACROS)
        answer = STRATEGIES[limits.strategy](
            single, replace(limits, expansions=FEW_EXPANSIONS).searching()
        )
        if answer is not None and answer.steps is None:
            return f"{said_of(task.atoms[each])} cannot be reached, whatever is done"
    if len(wanted) == 1:
        return "the goal cannot be reached, whatever is done"
    return "the goals cannot be reached together, whatever is done"


def _has_uniform_costs(task: GroundTask) -> bool:
    """Whether a plan with fewest steps is cheapest.

    Every plan has as many internal steps, which are free.
    """
    return (
        len({operator.cost for operator in task.operators if not is_internal(operator.instance)})
        == 1
    )


def _search_statistics(effort: Effort, answer: SearchResult | None = None) -> Statistics:
    counts = {"expanded": effort.expanded, "generated": effort.generated}
    return Statistics(counts, offer=answer.offer if answer else NO_OFFER)
