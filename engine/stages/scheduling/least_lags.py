"""The least time from one step to another in any plan, and what has to be done meanwhile.

What cannot hold when the first step ends has to be achieved after that, so every way to the second
step takes at least the longest of these achievements, where each one takes the shortest of its ways
(the heuristic h-max of Bonet & Geffner 2001, with durations). Deletions, and that a machine or an
arm does one thing at a time, are looked at for the first step alone. So the bound holds for all
plans of a task, and may be too small.
"""

import heapq
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask

NEVER = 1 << 40  # later than any time


@dataclass(frozen=True, slots=True)
class LeastLag:
    """The least time from the end of a step to the start of another, and the steps in a row that
    need it.
    """

    lasts: int
    steps: tuple[GroundOperator, ...] = ()


@dataclass(frozen=True)
class AfterStep:
    """What may come after any one of some steps, equally long, in plans of a task; after the start
    of plans, if there are none.
    """

    task: GroundTask
    first: tuple[GroundOperator, ...]

    def least(self, needed: Bits, later: GroundOperator | None = None) -> LeastLag:
        """The least time until all that is `needed` holds; `later` then begins, if it is given."""
        late = needed & ~self._possible
        soonest = max(indices(late), key=lambda atom: self._times.get(atom, NEVER), default=None)
        lasts = 0 if soonest is None else self._times.get(soonest, NEVER)
        if not lasts and self.first:
            overlaps = later is None or not self._excludes(later)
            return LeastLag(-self.first[0].duration if overlaps else 0)
        return LeastLag(lasts, tuple(reversed(list(self._way_to(soonest)))))

    def _way_to(self, atom: int | None) -> Iterator[GroundOperator]:
        """The steps that lead to an atom, the last one first."""
        while atom is not None and (step := self._achievers.get(atom)) is not None:
            yield step
            needed = [n for n in indices(step.preconditions) if self._times.get(n, 0)]
            atom = max(needed, key=lambda number: self._times[number], default=None)

    @cached_property
    def _possible(self) -> Bits:
        """What may hold when one of the first steps has ended; what follows from other facts and
        values of quantities always may.
        """
        follows = 0 if self.task.axioms is None else self.task.axioms.derived
        for step in self.task.operators:
            for change in step.changes:
                follows |= change.level.mask
        if not self.first:
            return self.task.initial | follows
        for step in self.first:
            follows |= self._possible_after(step)
        return follows

    def _possible_after(self, step: GroundOperator) -> Bits:
        held = step.adds | (step.preconditions & ~step.deletes)
        gone = step.deletes & ~step.adds
        for group in self.task.mutex_groups:
            if group & held:
                gone |= group & ~held
        every = (1 << len(self.task.atoms)) - 1
        return every & ~gone

    def _excludes(self, step: GroundOperator) -> bool:
        """Whether a step cannot be under way together with any of the first ones."""
        return all(self._are_apart(first, step) for first in self.first)

    def _are_apart(self, first: GroundOperator, step: GroundOperator) -> bool:
        if not set(step.resources).isdisjoint(first.resources):
            return True
        return any(
            group & first.preconditions and group & step.preconditions & ~first.preconditions
            for group in self.task.mutex_groups
        )

    @cached_property
    def _solved(self) -> tuple[dict[int, int], dict[int, GroundOperator]]:
        """When each atom may hold that does not at once, and the step that achieves it first."""
        steps = self.task.operators
        missing = [list(indices(step.preconditions & ~self._possible)) for step in steps]
        waiting: dict[int, list[int]] = defaultdict(list)
        for number, atoms in enumerate(missing):
            for atom in atoms:
                waiting[atom].append(number)
        counts = list(map(len, missing))
        ready = [number for number, count in enumerate(counts) if not count]
        queue = [entry for number in ready for entry in self._achieved(number, 0)]
        heapq.heapify(queue)
        times: dict[int, int] = {}
        achievers: dict[int, GroundOperator] = {}
        while queue:
            time, atom, by = heapq.heappop(queue)
            if atom in times:
                continue
            times[atom], achievers[atom] = time, steps[by]
            for number in waiting[atom]:
                counts[number] -= 1
                for entry in self._achieved(number, time) if not counts[number] else ():
                    heapq.heappush(queue, entry)
        return times, achievers

    def _achieved(self, number: int, start: int) -> Iterator[tuple[int, int, int]]:
        """What a step achieves that may start from then on: the time, the atom and the step."""
        step = self.task.operators[number]
        end = start + step.duration if start or self._excludes(step) else 0
        return ((end, atom, number) for atom in indices(_added_atoms(step) & ~self._possible))

    @property
    def _times(self) -> dict[int, int]:
        return self._solved[0]

    @property
    def _achievers(self) -> dict[int, GroundOperator]:
        return self._solved[1]


def _added_atoms(step: GroundOperator) -> Bits:
    """All that a step may make true."""
    added = step.adds
    for effect in step.conditional:
        added |= effect.adds
    return added


def alike_in_length(
    steps: Iterable[GroundOperator],
) -> list[tuple[GroundOperator, ...]]:
    """The steps in groups that are equally long."""
    groups: dict[int, list[GroundOperator]] = defaultdict(list)
    for step in steps:
        groups[step.duration].append(step)
    return [tuple(group) for group in groups.values()]
