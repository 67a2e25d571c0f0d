"""Anytime improvement of a first plan: ever better plans, as far as the work allows."""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from time import process_time
from typing import TYPE_CHECKING

from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.workflow_replay import reach_stages_early
from cellwright.engine.stages.planning.action_elimination import achieved_goal, eliminate_actions
from cellwright.engine.stages.planning.effect_variants import TooManyVariants, plain_steps
from cellwright.engine.stages.planning.improvement.batch_reduction import reduce_batches
from cellwright.engine.stages.planning.improvement.exact_optimum import find_cheapest_plan
from cellwright.engine.stages.planning.improvement.plan_reordering import deorder_steps
from cellwright.engine.stages.planning.improvement.window_optimisation import (
    Cheaper,
    GrowingWindows,
    PlanImprovement,
    Steps,
    by_search,
    steps_cost,
)
from cellwright.engine.stages.planning.portfolio import CLIMB_NODES, STRATEGIES, SearchSetting
from cellwright.engine.stages.planning.search_control import (
    Effort,
    OutOfRange,
    SearchLimits,
    SearchResult,
)
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.stopping import StoppedByCaller

if TYPE_CHECKING:
    from cellwright.engine.stages.planning.forward.weighted_search import WeightedSearch

ESTIMATE_WEIGHTS = (5, 3, 2, 1)  # how much the estimate counts, beside what a way has cost
FIRST, MOST = (
    2_000,
    4_000_000,
)  # expansions of a search in the first round; they double until they reach the most
LONG_SEARCH_EXPANSIONS = 50_000  # expansions of a search that takes seconds
NODES_PER_EXPANSION = 100  # nodes that may be generated for each expansion
SEED_STRIDE = 1_000_003


class PlanPool:
    """All plans that were found, and whether the best one is proved to be cheapest."""

    def __init__(self, steps: Sequence[Steps]) -> None:
        self._plans, self.proved = list(steps), False

    def add(self, steps: Steps) -> None:
        """Take one more plan."""
        self._plans.append(steps)

    @property
    def best(self) -> Steps:
        """The cheapest one."""
        return min(self._plans, key=steps_cost)


class WeightedSearches:
    """Weighted searches, with and without landmarks in turn, and with ties broken in another way in
    each round.

    A round begins with the weight at which a plan was found last. The bound is the cost of the best
    plan in `pool`: when all ways below it are followed to their ends, that plan is proved to be
    cheapest.
    """

    def __init__(self, setting: SearchSetting, pool: PlanPool) -> None:
        self._setting, self._pool = setting, pool
        self._rounds = self._place = 0

    @property
    def ended(self) -> bool:
        """Whether further rounds are not worth their time."""
        return self._pool.proved or FIRST << self._rounds > MOST

    @property
    def long(self) -> bool:
        """Whether a search of the next round takes as long as many small ones."""
        return FIRST << self._rounds > LONG_SEARCH_EXPANSIONS

    def round(self, interrupted: Callable[[], bool]) -> Iterator[Sequence[GroundOperator]]:
        """The plans of the next round.

        The caller puts them into the pool, with what makes them cheaper.
        """
        expansions, place = FIRST << self._rounds, max(self._place - 1, 0)
        self._rounds += 1
        while place < len(ESTIMATE_WEIGHTS) and not self._pool.proved:
            effort = Effort(expansions, interrupted, most=expansions * NODES_PER_EXPANSION)
            answer = None if effort.over() else self._search(ESTIMATE_WEIGHTS[place], effort)
            if answer is None:
                place += 1
            elif answer.steps is None:
                self._pool.proved = True
            else:
                yield answer.steps
                self._place = place = min(place + 1, len(ESTIMATE_WEIGHTS) - 1)

    def _search(self, weight: int, effort: Effort) -> SearchResult | None:
        seed = self._setting.seed * SEED_STRIDE + self._rounds - 1
        kind = self._layered if self._rounds % 2 else self._plain
        try:
            return kind.anew(weight, steps_cost(self._pool.best)[0], seed).run(effort)
        except OutOfRange:
            return None

    @cached_property
    def _layered(self) -> "WeightedSearch":
        from cellwright.engine.stages.planning.forward.weighted_search import (
            start_weighted_search,  # loads compiled kernels
        )

        return start_weighted_search(self._setting.task, landmarks=True)

    @cached_property
    def _plain(self) -> "WeightedSearch":
        from cellwright.engine.stages.planning.forward.weighted_search import start_weighted_search

        return start_weighted_search(self._setting.task)


OTHER_STRATEGIES = (
    ("asp", 20_000),
    ("landmarks", 10_000),
    ("forward", 10_000),
)  # (strategy, expansions that it may take to find a plan of its own)


PATIENT, PATIENCE = (
    (1, 2),
    10_000,
)  # how greedy best-first searches for other plans are, and nodes that each may generate
# seconds before which windows by searches, and by a solver, have no turn
WINDOW_DELAYS_S = (0.0, 2.0)


def best_plan(
    setting: SearchSetting, steps: Sequence[GroundOperator], limits: SearchLimits
) -> tuple[Plan, bool]:
    """The best partially ordered plan that is found from a sequence of steps on, in the memory and
    the time that there are, and whether it is proved that none is cheaper."""
    best, proved = _deorder_plan(setting.task, plain_steps(setting.task, steps)), False
    try:
        for better, least in _improve_plan(setting, steps, limits):
            best, proved = _deorder_plan(setting.task, better), least
            limits.improved(best)
    except MemoryError:
        pass
    except StoppedByCaller:  # the grounding of a window heard it first
        limits.interrupted()
    return best, proved


def _improve_plan(
    setting: SearchSetting, steps: Sequence[GroundOperator], limits: SearchLimits
) -> Iterator[tuple[Steps, bool]]:
    """The steps that are needed, and every cheaper plan found; the last one with whether it is
    proved to be cheapest.
    """
    best = _needed_steps(setting, steps)
    yield best, False
    least = _cheapest_plan(setting, best, limits)
    if least is not None:
        yield least, True
        return
    pool = PlanPool([best])
    cheaper = (
        _batched_plans(setting, steps, pool, limits)
        if setting.regression is None
        else _cheaper_plans(setting, pool, limits)
    )
    for better in cheaper:
        pool.add(better)
        if steps_cost(better) < steps_cost(best):
            best = better
            yield best, False
    if pool.proved:
        yield best, True


def _cheaper_plans(setting: SearchSetting, pool: PlanPool, limits: SearchLimits) -> Iterator[Steps]:
    """Plans from windows of a plan, of other plans, and from ever wider windows of the cheapest
    of all.
    """
    yield from _improve_windows(setting, pool.best, limits.improving())
    for steps in _other_plans(setting, limits):
        yield from _improve_windows(setting, steps, limits.improving())
    if limits.thorough:
        searches = WeightedSearches(setting, pool)
        yield from _search_round(setting, searches, limits)
        for name, most in OTHER_STRATEGIES:
            yield from _improve_windows(
                setting, _other_strategy_plan(setting, name, most, limits), limits.improving()
            )
        yield from _alternate_searches(setting, pool, searches, limits)


def _alternate_searches(
    setting: SearchSetting, pool: PlanPool, searches: WeightedSearches, limits: SearchLimits
) -> Iterator[Steps]:
    """Plans from ever longer searches and from ever wider windows of the cheapest plan.

    Whoever has used least time is next.
    """
    effort, growing = limits.improving(), _growing_windows(setting)
    used: dict[WeightedSearches | GrowingWindows, float] = {searches: 0.0}
    used.update(zip(growing, WINDOW_DELAYS_S, strict=True))
    while used and not effort.over() and not pool.proved:
        turn, since = min(used, key=used.__getitem__), process_time()
        if isinstance(turn, WeightedSearches):
            yield from _search_round(setting, turn, limits)
        else:
            yield from turn.round(pool.best, achieved_goal(setting.task, pool.best), effort)
        used[turn] += process_time() - since
        if turn.ended:
            del used[turn]


def _growing_windows(setting: SearchSetting) -> list[GrowingWindows]:
    """Windows that searches plan anew, and windows that a solver plans anew."""
    from cellwright.engine.stages.planning.forward.weighted_search import (
        search_between,  # loads compiled kernels
    )
    from cellwright.engine.stages.planning.stable_models import WindowReplanner

    task, regression = setting.task, setting.regression
    if regression is None:
        return []
    operators, size = regression.operators, len(regression.excluded)
    search = search_between(operators, size)
    planners: list[Callable[[int], Cheaper]] = [
        lambda expansions: by_search(search, expansions),
        lambda conflicts: WindowReplanner(operators, task.mutex_groups, size, conflicts),
    ]
    return [GrowingWindows(task, regression, planner, setting.seed) for planner in planners]


def _search_round(
    setting: SearchSetting, searches: WeightedSearches, limits: SearchLimits
) -> Iterator[Steps]:
    for steps in searches.round(limits.interrupted):
        yield from _improve_windows(setting, steps, limits.improving())


def _batched_plans(
    setting: SearchSetting, first: Sequence[GroundOperator], pool: PlanPool, limits: SearchLimits
) -> Iterator[Steps]:
    """Plans with fewer batches, for tasks that only forward searches can plan: from a plan, and if
    there is time from those of other strategies, and from the cheapest of all by ever longer
    searches."""
    yield from _fewer_batches(setting, first, limits)
    if limits.thorough:
        for name, most in OTHER_STRATEGIES:
            other_steps = _other_strategy_plan(setting, name, most, limits)
            yield from (
                _fewer_batches(setting, other_steps, limits) if other_steps is not None else ()
            )
        searches = WeightedSearches(setting, pool)
        while not (limits.interrupted() or searches.ended or searches.long):
            for steps in searches.round(limits.interrupted):
                yield from _fewer_batches(setting, steps, limits)
        if not pool.proved:
            for better in reduce_batches(setting.task, pool.best, limits.improving(), growing=True):
                yield plain_steps(setting.task, better)


def _fewer_batches(
    setting: SearchSetting, steps: Sequence[GroundOperator], limits: SearchLimits
) -> Iterator[Steps]:
    for better in reduce_batches(setting.task, steps, limits.batching()):
        yield plain_steps(setting.task, better)


def _needed_steps(setting: SearchSetting, steps: Sequence[GroundOperator]) -> Steps:
    settled = reach_stages_early(setting.task, plain_steps(setting.task, steps))
    return eliminate_actions(setting.task.initial, settled, achieved_goal(setting.task, settled))


def _cheapest_plan(setting: SearchSetting, best: Steps, limits: SearchLimits) -> Steps | None:
    """A cheapest plan, if the task is so small that all its states can be looked at; `best` if
    none is cheaper.
    """
    task, regression = setting.task, setting.regression
    if regression is None or limits.room is None:
        return None
    size, bound = len(task.atoms), steps_cost(best)[0]
    optimal = find_cheapest_plan(
        regression.operators, size, task.initial, task.goals, bound, limits.interrupted, limits.room
    )
    if optimal is None:
        return None
    return best if optimal.steps is None else _needed_steps(setting, optimal.steps)


def _other_plans(
    setting: SearchSetting, limits: SearchLimits
) -> Iterator[Sequence[GroundOperator]]:
    """Plans that patient searches find soon, and hill climbing with other ties."""
    if setting.regression is None or not limits.restarts:
        return
    chaining = setting.backward
    searches = [(chaining.patient(greed).run, PATIENCE) for greed in PATIENT]
    for run, most in (*searches, *[(chaining.restart, CLIMB_NODES)] * limits.restarts):
        effort = Effort(1 << 60, limits.interrupted, most=most)
        answer = None if effort.over() else run(effort)
        if answer is not None and answer.steps is not None:
            yield answer.steps


def _improve_windows(
    setting: SearchSetting, steps: Sequence[GroundOperator] | None, effort: Effort
) -> Iterator[list[GroundOperator]]:
    if steps is not None:
        plain = plain_steps(setting.task, steps)
        yield from PlanImprovement(
            setting.task, setting.regression, achieved_goal(setting.task, plain)
        ).near(plain, effort)


def _other_strategy_plan(
    setting: SearchSetting, name: str, most: int, limits: SearchLimits
) -> Sequence[GroundOperator] | None:
    """The steps that another strategy finds within `most` expansions; None if it finds none."""
    effort = Effort(most, limits.interrupted)
    try:
        answer = None if effort.over() else STRATEGIES[name](setting, effort)
    except (TooManyVariants, OutOfRange):
        return None
    return answer.steps if answer else None


def _deorder_plan(task: GroundTask, steps: Sequence[GroundOperator]) -> Plan:
    return deorder_steps(task, steps, achieved_goal(task, steps))
