"""Improvement of a first plan, as far as the work allows. Each plan is better than the one before."""

from collections.abc import Callable, Iterator, Sequence
from time import process_time

from cellwright.engine.model.replay import early
from cellwright.engine.model.task import GroundOperator, Task
from cellwright.engine.stages.planning.effort import Effort, OutOfRange
from cellwright.engine.stages.planning.elimination import eliminate, reached
from cellwright.engine.stages.planning.improvement.batches import fewer
from cellwright.engine.stages.planning.improvement.bounded import Pool, Searches
from cellwright.engine.stages.planning.improvement.deorder import deorder
from cellwright.engine.stages.planning.improvement.exact import optimum
from cellwright.engine.stages.planning.improvement.rounds import Growing, Improvement, Steps, cost
from cellwright.engine.stages.planning.improvement.straighten import Cheaper, by_search
from cellwright.engine.stages.planning.limits import Limits
from cellwright.engine.stages.planning.portfolio import CLIMB, STRATEGIES
from cellwright.engine.stages.planning.setting import Setting
from cellwright.engine.stages.planning.variants import TooManyVariants, plainly
from cellwright.kb.model.plan import Plan
from cellwright.kb.stopping import Stopped

OTHERS = (
    ("asp", 20_000),
    ("landmarks", 10_000),
    ("forward", 10_000),
)  # (strategy, expansions that it may take to find a plan of its own)


PATIENT, PATIENCE = (
    (1, 2),
    10_000,
)  # how greedy best-first searches for other plans are, and nodes that each may generate
HANDICAPS = (0.0, 2.0)  # seconds before which windows by searches, and by a solver, have no turn


def best_plan(setting: Setting, steps: Sequence[GroundOperator], limits: Limits) -> tuple[Plan, bool]:
    """The best partially ordered plan that is found from a sequence of steps on, in the memory and the time that there are,
    and whether it is proved that none is cheaper."""
    best, proved = _deordered(setting.task, plainly(setting.task, steps)), False
    try:
        for better, least in _better(setting, steps, limits):
            best, proved = _deordered(setting.task, better), least
            limits.improved(best)
    except MemoryError:
        pass
    except Stopped:  # the grounding of a window heard it first
        limits.interrupted()
    return best, proved


def _better(
    setting: Setting, steps: Sequence[GroundOperator], limits: Limits
) -> Iterator[tuple[Steps, bool]]:
    """The steps that are needed, and every cheaper plan found; the last one with whether it is proved to be cheapest."""
    best = _needed(setting, steps)
    yield best, False
    least = _cheapest(setting, best, limits)
    if least is not None:
        yield least, True
        return
    pool = Pool([best])
    cheaper = (
        _batched(setting, steps, pool, limits)
        if setting.regression is None
        else _cheaper(setting, pool, limits)
    )
    for better in cheaper:
        pool.add(better)
        if cost(better) < cost(best):
            best = better
            yield best, False
    if pool.proved:
        yield best, True


def _cheaper(setting: Setting, pool: Pool, limits: Limits) -> Iterator[Steps]:
    """Plans from windows of a plan, of other plans, and from ever wider windows of the cheapest of all."""
    yield from _improved(setting, pool.best, limits.improving())
    for steps in _others(setting, limits):
        yield from _improved(setting, steps, limits.improving())
    if limits.thorough:
        searches = Searches(setting, pool)
        yield from _round(setting, searches, limits)
        for name, most in OTHERS:
            yield from _improved(setting, _other(setting, name, most, limits), limits.improving())
        yield from _alternating(setting, pool, searches, limits)


def _alternating(setting: Setting, pool: Pool, searches: Searches, limits: Limits) -> Iterator[Steps]:
    """Plans from ever longer searches and from ever wider windows of the cheapest plan. Whoever has used least time is next."""
    effort, growing = limits.improving(), _windows(setting)
    used: dict[Searches | Growing, float] = {searches: 0.0}
    used.update(zip(growing, HANDICAPS, strict=True))
    while used and not effort.over() and not pool.proved:
        turn, since = min(used, key=used.__getitem__), process_time()
        if isinstance(turn, Searches):
            yield from _round(setting, turn, limits)
        else:
            yield from turn.round(pool.best, reached(setting.task, pool.best), effort)
        used[turn] += process_time() - since
        if turn.ended:
            del used[turn]


def _windows(setting: Setting) -> list[Growing]:
    """Windows that searches plan anew, and windows that a solver plans anew."""
    from cellwright.engine.stages.planning.forward.weighted import within  # loads compiled kernels
    from cellwright.engine.stages.planning.stable_models.windows import Windows

    task, regression = setting.task, setting.regression
    if regression is None:
        return []
    operators, size = regression.operators, len(regression.excluded)
    search = within(operators, size)
    planners: list[Callable[[int], Cheaper]] = [
        lambda expansions: by_search(search, expansions),
        lambda conflicts: Windows(operators, task.mutex_groups, size, conflicts),
    ]
    return [Growing(task, regression, planner, setting.seed) for planner in planners]


def _round(setting: Setting, searches: Searches, limits: Limits) -> Iterator[Steps]:
    for steps in searches.round(limits.interrupted):
        yield from _improved(setting, steps, limits.improving())


def _batched(
    setting: Setting, first: Sequence[GroundOperator], pool: Pool, limits: Limits
) -> Iterator[Steps]:
    """Plans with fewer batches, for tasks that only forward searches can plan: from a plan, and if there is time from those of
    other strategies, and from the cheapest of all by ever longer searches."""
    yield from _fewer(setting, first, limits)
    if limits.thorough:
        for name, most in OTHERS:
            other = _other(setting, name, most, limits)
            yield from _fewer(setting, other, limits) if other is not None else ()
        searches = Searches(setting, pool)
        while not (limits.interrupted() or searches.ended or searches.long):
            for steps in searches.round(limits.interrupted):
                yield from _fewer(setting, steps, limits)
        if not pool.proved:
            for better in fewer(setting.task, pool.best, limits.improving(), growing=True):
                yield plainly(setting.task, better)


def _fewer(setting: Setting, steps: Sequence[GroundOperator], limits: Limits) -> Iterator[Steps]:
    for better in fewer(setting.task, steps, limits.batching()):
        yield plainly(setting.task, better)


def _needed(setting: Setting, steps: Sequence[GroundOperator]) -> Steps:
    settled = early(setting.task, plainly(setting.task, steps))
    return eliminate(setting.task.initial, settled, reached(setting.task, settled))


def _cheapest(setting: Setting, best: Steps, limits: Limits) -> Steps | None:
    """A cheapest plan, if the task is so small that all its states can be looked at; `best` if none is cheaper."""
    task, regression = setting.task, setting.regression
    if regression is None or limits.room is None:
        return None
    size, bound = len(task.atoms), cost(best)[0]
    found = optimum(
        regression.operators, size, task.initial, task.goals, bound, limits.interrupted, limits.room
    )
    if found is None:
        return None
    return best if found.steps is None else _needed(setting, found.steps)


def _others(setting: Setting, limits: Limits) -> Iterator[Sequence[GroundOperator]]:
    """Plans that patient searches find soon, and hill climbing with other ties."""
    if setting.regression is None or not limits.restarts:
        return
    chaining = setting.backward
    searches = [(chaining.patient(greed).run, PATIENCE) for greed in PATIENT]
    for run, most in (*searches, *[(chaining.restart, CLIMB)] * limits.restarts):
        effort = Effort(1 << 60, limits.interrupted, most=most)
        answer = None if effort.over() else run(effort)
        if answer is not None and answer.steps is not None:
            yield answer.steps


def _improved(
    setting: Setting, steps: Sequence[GroundOperator] | None, effort: Effort
) -> Iterator[list[GroundOperator]]:
    if steps is not None:
        plain = plainly(setting.task, steps)
        yield from Improvement(setting.task, setting.regression, reached(setting.task, plain)).near(
            plain, effort
        )


def _other(setting: Setting, name: str, most: int, limits: Limits) -> Sequence[GroundOperator] | None:
    """The steps that another strategy finds within `most` expansions; None if it finds none."""
    effort = Effort(most, limits.interrupted)
    try:
        answer = None if effort.over() else STRATEGIES[name](setting, effort)
    except (TooManyVariants, OutOfRange):
        return None
    return answer.steps if answer else None


def _deordered(task: Task, steps: Sequence[GroundOperator]) -> Plan:
    return deorder(task, steps, reached(task, steps))
