"""Improvement of a first plan, as far as the work allows. Each plan is better than the one before."""

from collections.abc import Iterator, Sequence

from engine.model.task import GroundOperator, Task
from engine.stages.planning.effort import Effort
from engine.stages.planning.elimination import reached
from engine.stages.planning.improvement.deorder import deorder
from engine.stages.planning.improvement.rounds import Improvement, Steps, cost
from engine.stages.planning.limits import Limits
from engine.stages.planning.portfolio import STRATEGIES, Setting
from engine.stages.planning.variants import TooManyVariants, plainly
from kb.model.plan import Plan

OTHERS = (
    ("asp", 20_000),
    ("landmarks", 10_000),
    ("forward", 10_000),
)  # (strategy, expansions that it may take to find a plan of its own)


def best_plan(setting: Setting, steps: Sequence[GroundOperator], limits: Limits) -> Plan:
    """The best partially ordered plan that improvement finds from a sequence of steps.

    If memory runs out, it is the best plan found until then.
    """
    best = _deordered(setting.task, plainly(setting.task, steps))
    try:
        for better in _better(setting, steps, limits):
            best = _deordered(setting.task, better)
            limits.improved(best)
    except MemoryError:
        pass
    return best


def _better(setting: Setting, steps: Sequence[GroundOperator], limits: Limits) -> Iterator[Steps]:
    """The needed steps of the plan, then every cheaper plan that is found."""
    effort = limits.improving()
    best: Steps = []
    for better in _improved(setting, steps, effort):
        best = better
        yield best
    if not limits.thorough:
        return
    for name, most in OTHERS:
        for better in _improved(setting, _other(setting, name, most, effort), effort):
            if cost(better) < cost(best):
                best = better
                yield best
    yield from Improvement(setting.task, setting.regression, reached(setting.task, best)).wide(best, effort)


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
    except TooManyVariants:
        return None
    return answer.steps if answer else None


def _deordered(task: Task, steps: Sequence[GroundOperator]) -> Plan:
    return deorder(task, steps, reached(task, steps))
