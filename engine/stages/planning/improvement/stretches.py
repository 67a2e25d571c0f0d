"""The stretches of a plan in which a step is done twice."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from cellwright.engine.model.task import Bits, GroundOperator, Task
from cellwright.engine.stages.planning.elimination import reached
from cellwright.engine.stages.planning.improvement.deorder import is_internal
from cellwright.engine.stages.planning.variants import plainly
from cellwright.kb.terms import Function


class Stretch(NamedTuple):
    """The steps from `first` to before `end`; `goals` are the fluents that later steps and the goals need of them."""

    first: int
    end: int
    goals: Bits


def stretches(task: Task, steps: Sequence[GroundOperator]) -> list[Stretch]:
    """Around each two times that a step is done, the dearest steps first.

    What serves both is within as many steps before and after them as are between them. A stretch begins and ends there where
    least is handed over: before a batch is begun, and after it is put away.
    """
    goals, wanted = _goals(task, steps)
    size = [(each & ~wanted).bit_count() for each in goals]
    found = []
    for before, one, two, after in _pairs(steps):
        near = two - one
        first = min(range(max(before + 1, one - near), one + 1), key=size.__getitem__)
        end = min(range(two + 1, min(after, two + near) + 1), key=size.__getitem__)
        found.append((-steps[one].cost, Stretch(first, end, goals[end])))
    return list(dict.fromkeys(stretch for _, stretch in sorted(found)))


def _goals(task: Task, steps: Sequence[GroundOperator]) -> tuple[list[Bits], Bits]:
    """The fluents that are needed before each step and at the end, and the last ones. Values of quantities are left out:
    later steps do not need just these."""
    fluents = -1 if task.axioms is None else (1 << task.axioms.size) - 1
    last = reached(task, steps) & fluents
    found = [last]
    for step in reversed(plainly(task, steps)):
        found.append((found[-1] & ~step.adds | step.preconditions) & fluents)
    return found[::-1], last


def _pairs(steps: Sequence[GroundOperator]) -> Iterator[tuple[int, int, int, int]]:
    """The places of each two times that a step is done, between those of the time before and the time after.

    Steps that serve many at once count as the same if they have the same operator.
    """
    places: dict[Function | str, list[int]] = {}
    for place, step in enumerate(steps):
        if not is_internal(step.instance):
            places.setdefault(step.instance.name if step.conditional else step.instance, []).append(place)
    for own in places.values():
        around = [-1, *own, len(steps)]
        for number, (one, two) in enumerate(pairwise(own)):
            yield around[number], one, two, around[number + 3]
