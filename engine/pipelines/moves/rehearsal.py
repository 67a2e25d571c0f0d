"""A plan of several arms with delays: whether looks at all moments find two arms in collision, and how near they come.

Steps begin as soon as those that they wait for have ended, each as late as is asked. Moments are so close that no joint moves by more
than a small step from one to the next. A stretch of moments is decided by one look in its middle, if the arms are farther apart there
than both can move on the stretch, and as far as some look has seen them; else it is halved. So what comes out is what a look at each moment
would say. It shares with the proof of the plan (`meetings`) what an arm is, what is a collision, and how far a joint moves a body.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from cellwright.engine.model.geometry import Floats, Longs
from cellwright.engine.model.moves import MovedStep
from cellwright.engine.pipelines.moves.courses import Course, courses_of
from cellwright.engine.pipelines.moves.meetings import Encounters
from cellwright.engine.pipelines.moves.tracks import Moment, Rider
from cellwright.kb.model.plan import Plan, StepId

CHECKING = 1 / 32  # rad or m: how often the planner of motions looks


@dataclass(frozen=True, slots=True)
class Seen:
    """How many moments were decided, by how many looks, and how near two arms came at the least (m, at most 1)."""

    moments: int
    looks: int
    least_m: float

    def and_also(self, other: "Seen") -> "Seen":
        """Both together."""
        return Seen(self.moments + other.moments, self.looks + other.looks, min(self.least_m, other.least_m))


NOTHING = Seen(0, 0, 1.0)


def delayed(
    plan: Plan, steps: Sequence[MovedStep], unit_s: float, late_s: Mapping[StepId, float]
) -> tuple[dict[StepId, float], float]:
    """When each step begins (s), if each is so late, and when all is done."""
    lasts = {each.step: each.seconds for each in steps}
    starts, ends = dict[StepId, float](), dict[StepId, float]()
    for step in plan.steps:
        soonest = max((ends[one] for one in step.after), default=0.0)
        starts[step.id] = soonest + late_s.get(step.id, 0.0)
        ends[step.id] = starts[step.id] + lasts.get(step.id, step.duration * unit_s)
    return starts, max(ends.values(), default=0.0)


@dataclass(frozen=True)
class Rehearsal:
    """The steps of a plan with the cell before and after each, and what is known of arms that meet."""

    moments: Sequence[Moment]
    encounters: Encounters

    @cached_property
    def courses(self) -> Mapping[str, Course]:
        """What each arm does."""
        return courses_of(self.moments)

    def seen(
        self,
        starts: Mapping[StepId, float],
        until_s: float,
        step: float = CHECKING / 100,
        least_m: float = 1.0,
    ) -> Seen:
        """Look at all arms so often that no joint moves by more than `step` (rad, m) between two moments.

        Arms in one step are left out: their contact is meant, and proved when the step is planned. Where arms are farther apart than
        `least_m`, nobody looks how far.
        """
        found = Seen(0, 0, least_m)
        timed = {arm: course.begun(starts, until_s) for arm, course in self.courses.items()}
        for one, other in combinations(timed.values(), 2):
            both = _Both(one, other, self.encounters, step)
            found = both.seen(found)
        return found


@dataclass(frozen=True)
class _Both:
    """Two arms at once. Time is cut where either begins another line; moments are numbered through all pieces."""

    one: Course
    other: Course
    encounters: Encounters
    step: float

    @cached_property
    def cuts(self) -> Floats:
        """When a piece begins, and when the last one ends (p + 1,)."""
        edges = np.concatenate([each.times for each in (self.one, self.other)])
        return np.unique(edges)

    @cached_property
    def lines(self) -> tuple[Longs, Longs]:
        """The line of each arm in each piece (p,)."""
        middles = (self.cuts[:-1] + self.cuts[1:]) / 2
        return self.one.line_at(middles), self.other.line_at(middles)

    @cached_property
    def firsts(self) -> Longs:
        """The number of the first moment of each piece, and how many there are (p + 1,)."""
        a, b = self.lines
        speed = np.maximum(self.one.speeds[a], self.other.speeds[b])
        counts = np.ceil(np.diff(self.cuts) * speed / self.step).astype(np.int64) + 2
        return np.concatenate([[0], np.cumsum(counts)])

    def times(self, moments: Longs) -> Floats:
        """When some moments are (n,)."""
        piece = np.searchsorted(self.firsts, moments, side="right") - 1
        share = (moments - self.firsts[piece]) / (self.firsts[piece + 1] - self.firsts[piece] - 1)
        found: Floats = self.cuts[piece] + share * (self.cuts[piece + 1] - self.cuts[piece])
        return found

    def stretches(self) -> list[tuple[Rider, Rider, int, int]]:
        """First and last moments of the stretches on which both arms carry the same, and are not in one step."""
        a, b = self.lines
        apart = (self.one.step[a] != self.other.step[b]) | (self.one.step[a] == 0)
        kind = np.where(apart, self.one.rider[a] * len(self.other.riders) + self.other.rider[b], -1)
        ends = np.flatnonzero(np.diff(kind, append=-2))
        begins = np.concatenate([[0], ends[:-1] + 1])
        return [
            (
                self.one.riders[self.one.rider[a[first]]],
                self.other.riders[self.other.rider[b[first]]],
                int(self.firsts[first]),
                int(self.firsts[last + 1]) - 1,
            )
            for first, last in zip(begins, ends, strict=True)
            if kind[first] >= 0
        ]

    def seen(self, before: Seen) -> Seen:
        """What is seen of both, with what was seen before."""
        groups: dict[tuple[str, object, str, object], list[tuple[Rider, Rider, int, int]]] = {}
        for each in self.stretches():
            groups.setdefault((each[0].arm, each[0].key, each[1].arm, each[1].key), []).append(each)
        found = before
        for own in groups.values():
            ranges = np.array([each[2:] for each in own], np.int64)
            found = self._halved(own[0][0], own[0][1], ranges, found)
        return found

    def _halved(self, a: Rider, b: Rider, ranges: Longs, found: Seen) -> Seen:
        """All moments of some ranges (n, 2) decided."""
        moments = found.moments + int((ranges[:, 1] - ranges[:, 0] + 1).sum())
        looks, least = found.looks, found.least_m
        low, high = ranges[:, 0], ranges[:, 1]
        while len(low):
            middle = (low + high) // 2
            clear, moved = self._looked(a, b, low, middle, high)
            looks, least = looks + len(low), min(least, float(clear.min()))
            open_ = clear - moved < least
            low, middle, high = low[open_], middle[open_], high[open_]
            low, high = np.concatenate([low, middle + 1]), np.concatenate([middle - 1, high])
            low, high = low[low <= high], high[low <= high]
        return Seen(moments, looks, least)

    def _looked(self, a: Rider, b: Rider, low: Longs, middle: Longs, high: Longs) -> tuple[Floats, Floats]:
        """How far apart the arms are at the middles (n,), and how far both move from there to the ends at most."""
        first, at, last = (self.times(each) for each in (low, middle, high))
        turns = [
            np.maximum(own.turned(at) - own.turned(first), own.turned(last) - own.turned(at))
            for own in (self.one, self.other)
        ]
        return self.encounters.apart((a, self.one.at(at), turns[0]), (b, self.other.at(at), turns[1]))
