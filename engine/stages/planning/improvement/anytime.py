"""Improvement of a first plan, as far as the work allows. Each plan is better than the one before."""

from collections.abc import Iterator, Sequence

from engine.model.replay import early
from engine.model.task import GroundOperator, Task
from engine.stages.planning.effort import Effort, OutOfRange
from engine.stages.planning.elimination import eliminate, reached
from engine.stages.planning.improvement.batches import fewer
from engine.stages.planning.improvement.deorder import deorder
from engine.stages.planning.improvement.exact import optimum
from engine.stages.planning.improvement.rounds import Improvement, Steps, cost
from engine.stages.planning.limits import Limits
from engine.stages.planning.portfolio import CLIMB, STRATEGIES
from engine.stages.planning.setting import Setting
from engine.stages.planning.variants import TooManyVariants, plainly
from kb.model.plan import Plan
from kb.stopping import Stopped

OTHERS = (
    ("asp", 20_000),
    ("landmarks", 10_000),
    ("forward", 10_000),
)  # (strategy, expansions that it may take to find a plan of its own)


PATIENT, PATIENCE = (
    (1, 2),
    10_000,
)  # how greedy best-first searches for other plans are, and nodes that each may generate


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
    effort = limits.improving()
    best = _needed(setting, steps)
    yield best, False
    least = _cheapest(setting, best, limits)
    if least is not None:
        yield least, True
        return
    cheaper = (
        _cheaper(setting, best, limits, effort)
        if setting.regression is not None
        else _batched(setting, steps, limits)
    )
    for better in cheaper:
        if cost(better) < cost(best):
            best = better
            yield best, False


def _cheaper(setting: Setting, best: Steps, limits: Limits, effort: Effort) -> Iterator[Steps]:
    """Plans from windows of a plan, of other plans, and from ever wider windows of the cheapest of all."""
    found = [best]
    for better in _improved(setting, best, effort):
        found.append(better)
        yield better
    for steps in _others(setting, limits):
        for better in _improved(setting, steps, limits.improving()):
            found.append(better)
            yield better
    if limits.thorough:
        for name, most in OTHERS:
            for better in _improved(setting, _other(setting, name, most, effort), effort):
                found.append(better)
                yield better
        best = min(found, key=cost)
        yield from Improvement(setting.task, setting.regression, reached(setting.task, best)).wide(
            best, effort
        )


def _batched(setting: Setting, steps: Sequence[GroundOperator], limits: Limits) -> Iterator[Steps]:
    """Plans with fewer batches, for tasks that only forward searches can plan: from a plan, and if there is time from those of
    other strategies, and from the cheapest of all by ever longer searches."""
    task, found = setting.task, list[Steps]()
    for better in fewer(task, steps, limits.batching()):
        found.append(better)
        yield plainly(task, better)
    if limits.thorough:
        for name, most in OTHERS:
            other = _other(setting, name, most, limits.improving())
            for better in fewer(task, other, limits.batching()) if other is not None else ():
                found.append(better)
                yield plainly(task, better)
        best = min(found, key=cost, default=list(steps))
        for better in fewer(task, best, limits.improving(), growing=True):
            yield plainly(task, better)


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


def _other(setting: Setting, name: str, most: int, effort: Effort) -> Sequence[GroundOperator] | None:
    """The steps that another strategy finds within `most` expansions; None if it finds none."""
    try:
        answer = None if effort.over() else STRATEGIES[name](setting, Effort(most, effort.interrupted))
    except (TooManyVariants, OutOfRange):
        return None
    return answer.steps if answer else None


def _deordered(task: Task, steps: Sequence[GroundOperator]) -> Plan:
    return deorder(task, steps, reached(task, steps))
