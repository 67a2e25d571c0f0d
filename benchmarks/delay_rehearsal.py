"""Rehearses a plan of several arms with delays: whether any two collide, and how near they come."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.model.motion_values import LegKind, MovedStep, StepLeg
from cellwright.engine.pipelines.motion.arm_conflicts import (
    ArmEncounters,
    ArmPassage,
    ArmRider,
    Key,
    OccupiedSpace,
    StepMoment,
    occupied_tracks,
)
from cellwright.kb.model.plan_model import Plan, StepId

PEAK_SPEED_RATIO = 15 / 8  # the greatest speed on a line from rest to rest, in terms of the mean


@dataclass(frozen=True, slots=True)
class ArmLines:
    """Lines (n,) of one arm with k joints; where it rests, a line leads nowhere.

    `first` and `way` (n, k) are where a line begins and where it leads. The line belongs to a step
    by its place `number` in the track of the arm, begins and ends so long after the step
    (`begins_s`, `ends_s`), unless it is a `rest` before the step. `rider` numbers what moves with
    the arm (`riders`), and `step` is the number of the step, 0 for a rest between steps.
    `turned_before` (n, k) is how much each joint has turned before the line.
    """

    steps: tuple[StepId, ...]
    riders: tuple[ArmRider, ...]
    first: Floats
    way: Floats
    begins_s: Floats
    ends_s: Floats
    rest: Truths
    number: Longs
    rider: Longs
    step: Longs
    turned_before: Floats

    def begun(self, starts: Mapping[StepId, float], until_s: float) -> "ArmLines":
        """The course with times from the beginning of the plan, if steps begin then."""
        begun = np.array([*(starts[step] for step in self.steps), until_s])
        own = np.zeros(len(self.steps))
        np.maximum.at(own, self.number[~self.rest], self.ends_s[~self.rest])
        ended = np.concatenate([[0.0], begun[:-1] + own])
        begins = np.where(self.rest, ended[self.number], begun[self.number] + self.begins_s)
        ends = np.where(self.rest, begun[self.number], begun[self.number] + self.ends_s)
        return replace(self, begins_s=begins, ends_s=np.maximum(begins, ends))

    @property
    def times(self) -> Floats:
        """When lines begin and end."""
        return np.concatenate([self.begins_s, self.ends_s[-1:]])

    @property
    def speeds(self) -> Floats:
        """The greatest speed of a joint on each line (n,)."""
        lasts = np.maximum(self.ends_s - self.begins_s, 1e-9)
        peaks: Floats = np.abs(self.way).max(axis=1) / lasts * PEAK_SPEED_RATIO
        return peaks

    def line_at(self, times: Floats) -> Longs:
        """The line at each of some times (n,)."""
        positions = np.searchsorted(self.begins_s, times, side="right") - 1
        return np.maximum(positions, 0).astype(np.int64)

    def at(self, times: Floats) -> Floats:
        """The configurations (n, k) at some times (n,)."""
        line = self.line_at(times)
        return self.first[line] + self._share(line, times)[:, None] * self.way[line]

    def turned(self, times: Floats) -> Floats:
        """How much each joint has turned till then (n, k), all ways added up."""
        line = self.line_at(times)
        return self.turned_before[line] + self._share(line, times)[:, None] * np.abs(self.way[line])

    def _share(self, line: Longs, times: Floats) -> Floats:
        """How far along its line the arm is: from rest to rest, as `Leg.at` says."""
        lasts = np.maximum(self.ends_s[line] - self.begins_s[line], 1e-12)
        s = np.clip((times - self.begins_s[line]) / lasts, 0.0, 1.0)
        share: Floats = s**3 * (10 - 15 * s + 6 * s * s)
        return share


@dataclass(frozen=True, slots=True, eq=False)
class _ArmLine:
    """A line before all of a course are put together; `step` is the number of the step, 0 for a
    rest before it.
    """

    number: int
    step: int
    rider: ArmRider
    first: Floats
    last: Floats
    begins_s: float = 0.0
    ends_s: float = 0.0


def courses_of(moments: Sequence[StepMoment]) -> dict[str, ArmLines]:
    """The course of each arm in a plan."""
    if not moments:
        return {}
    world = moments[0].before
    homes = {
        arm: ArmPassage(ArmRider(world, arm), q[None]) for arm, q in world.configurations.items()
    }
    moved = {moment.step: moment.moved for moment in moments}
    return {
        arm: _arm_lines(homes[arm], track, [moved[occupied.step] for occupied in track])
        for arm, track in occupied_tracks(moments, world.configurations).items()
    }


def _arm_lines(
    home: ArmPassage, track: Sequence[OccupiedSpace], moved: Sequence[MovedStep | None]
) -> ArmLines:
    lines, rest = list[_ArmLine](), home
    for number, (occupied, done) in enumerate(zip(track, moved, strict=True)):
        assert done is not None
        lines.append(_ArmLine(number, 0, rest.rider, rest.path[-1], rest.path[-1]))
        lines += _of_step(number, occupied, done)
        rest = occupied.rest
    lines.append(_ArmLine(len(track), 0, rest.rider, rest.path[-1], rest.path[-1]))
    riders = _RiderNumbers()
    first, last = (np.array([getattr(line, end) for line in lines]) for end in ("first", "last"))
    turned = np.cumsum(np.abs(last - first), axis=0)
    rider = np.array([riders.number(line.rider) for line in lines], np.int64)
    return ArmLines(
        tuple(occupied.step for occupied in track),
        tuple(riders.known),
        first,
        last - first,
        np.array([line.begins_s for line in lines]),
        np.array([line.ends_s for line in lines]),
        np.array([line.step == 0 for line in lines]),
        np.array([line.number for line in lines], np.int64),
        rider,
        np.array([line.step for line in lines], np.int64),
        turned - np.abs(last - first),
    )


@dataclass(slots=True)
class _RiderNumbers:
    """Riders by number: those that carry the same have one number."""

    known: list[ArmRider] = field(default_factory=list)
    numbers: dict[Key, int] = field(default_factory=dict)

    def number(self, rider: ArmRider) -> int:
        if rider.key not in self.numbers:
            self.numbers[rider.key] = len(self.known)
            self.known.append(rider)
        return self.numbers[rider.key]


def _of_step(number: int, occupied: OccupiedSpace, moved: MovedStep) -> Iterator[_ArmLine]:
    """What one arm does in a step, one leg after the other; it rests while another arm moves."""
    now, passages, entered = 0.0, list(occupied.passages), False
    at = passages.pop(0)

    def resting(seconds: float) -> _ArmLine:
        q = at.path[-1]
        return _ArmLine(number, int(occupied.step), at.rider, q, q, now, now + seconds)

    for leg in moved.legs:
        lasts = moved.takes_s if leg.kind is LegKind.DRIVE else leg.seconds
        own = next((own_leg for own_leg in (leg, *leg.beside) if own_leg.arm == occupied.arm), None)
        if own is None:
            yield resting(lasts)
        else:
            at = passages.pop(0)
            yield from _of_leg(number, int(occupied.step), at.rider, own, now)
            if lasts > own.seconds:
                yield replace(resting(lasts), begins_s=now + own.seconds)
        now += lasts
        if leg.kind is LegKind.IN and not entered:
            entered = True
            yield resting(moved.takes_s)
            now += moved.takes_s


def _of_leg(
    number: int, step: int, rider: ArmRider, leg: StepLeg, begins_s: float
) -> Iterator[_ArmLine]:
    for n in range(len(leg.path) - 1):
        since, until = (begins_s + float(leg.corners_s[m]) for m in (n, n + 1))
        yield _ArmLine(number, step, rider, leg.path[n], leg.path[n + 1], since, until)


CHECKING_STEP = 1 / 32  # rad or m: how often the planner of motions looks


@dataclass(frozen=True, slots=True)
class RehearsalLooks:
    """How many moments were decided, by how many looks, and how near two arms came at the least
    (m, at most 1).
    """

    moments: int
    looks: int
    least_m: float

    def and_also(self, more: "RehearsalLooks") -> "RehearsalLooks":
        """Both together."""
        return RehearsalLooks(
            self.moments + more.moments, self.looks + more.looks, min(self.least_m, more.least_m)
        )


NO_LOOKS = RehearsalLooks(0, 0, 1.0)


def delayed_begins(
    plan: Plan, steps: Sequence[MovedStep], unit_s: float, late_s: Mapping[StepId, float]
) -> tuple[dict[StepId, float], float]:
    """When each step begins (s), if each is so late, and when all is done."""
    lasts = {step.step: step.seconds for step in steps}
    starts, ends = dict[StepId, float](), dict[StepId, float]()
    for step in plan.steps:
        soonest = max((ends[earlier] for earlier in step.after), default=0.0)
        starts[step.id] = soonest + late_s.get(step.id, 0.0)
        ends[step.id] = starts[step.id] + lasts.get(step.id, step.duration * unit_s)
    return starts, max(ends.values(), default=0.0)


@dataclass(frozen=True)
class DelayRehearsal:
    """The steps of a plan with the cell before and after each, and what is known of arms that
    meet.
    """

    moments: Sequence[StepMoment]
    encounters: ArmEncounters

    @cached_property
    def courses(self) -> Mapping[str, ArmLines]:
        """What each arm does."""
        return courses_of(self.moments)

    def seen(
        self,
        starts: Mapping[StepId, float],
        until_s: float,
        step: float = CHECKING_STEP / 100,
        least_m: float = 1.0,
    ) -> RehearsalLooks:
        """Look at all arms so often that no joint moves by more than `step` (rad, m) between two
        moments.

        Arms in one step are left out: their contact is meant, and proved when the step is planned.
        Where arms are farther apart than `least_m`, nobody looks how far.
        """
        looks = RehearsalLooks(0, 0, least_m)
        timed = {arm: course.begun(starts, until_s) for arm, course in self.courses.items()}
        for first, second in combinations(timed.values(), 2):
            both = _TwoArms(first, second, self.encounters, step)
            looks = both.seen(looks)
        return looks


@dataclass(frozen=True)
class _TwoArms:
    """Two arms at once. Time is cut where either begins another line; moments are numbered
    through all pieces.
    """

    one: ArmLines
    other: ArmLines
    encounters: ArmEncounters
    step: float

    @cached_property
    def cuts(self) -> Floats:
        """When a piece begins, and when the last one ends (p + 1,)."""
        edges = np.concatenate([arm_lines.times for arm_lines in (self.one, self.other)])
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
        times: Floats = self.cuts[piece] + share * (self.cuts[piece + 1] - self.cuts[piece])
        return times

    def stretches(self) -> list[tuple[ArmRider, ArmRider, int, int]]:
        """First and last moments of the stretches on which both arms carry the same, and are
        not in one step.
        """
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

    def seen(self, before: RehearsalLooks) -> RehearsalLooks:
        """What is seen of both, with what was seen before."""
        groups: dict[
            tuple[str, object, str, object], list[tuple[ArmRider, ArmRider, int, int]]
        ] = {}
        for stretch in self.stretches():
            groups.setdefault(
                (stretch[0].arm, stretch[0].key, stretch[1].arm, stretch[1].key), []
            ).append(stretch)
        looks = before
        for own in groups.values():
            ranges = np.array([span[2:] for span in own], np.int64)
            looks = self._halved(own[0][0], own[0][1], ranges, looks)
        return looks

    def _halved(
        self, a: ArmRider, b: ArmRider, ranges: Longs, looks_so_far: RehearsalLooks
    ) -> RehearsalLooks:
        """All moments of some ranges (n, 2) decided."""
        moments = looks_so_far.moments + int((ranges[:, 1] - ranges[:, 0] + 1).sum())
        looks, least = looks_so_far.looks, looks_so_far.least_m
        low, high = ranges[:, 0], ranges[:, 1]
        while len(low):
            middle = (low + high) // 2
            clear, moved = self._looked(a, b, low, middle, high)
            looks, least = looks + len(low), min(least, float(clear.min()))
            open_ = clear - moved < least
            low, middle, high = low[open_], middle[open_], high[open_]
            low, high = np.concatenate([low, middle + 1]), np.concatenate([middle - 1, high])
            low, high = low[low <= high], high[low <= high]
        return RehearsalLooks(moments, looks, least)

    def _looked(
        self, a: ArmRider, b: ArmRider, low: Longs, middle: Longs, high: Longs
    ) -> tuple[Floats, Floats]:
        """How far apart the arms are at the middles (n,), and how far both move from there to
        the ends at most.
        """
        first, at, last = (self.times(pieces) for pieces in (low, middle, high))
        turns = [
            np.maximum(own.turned(at) - own.turned(first), own.turned(last) - own.turned(at))
            for own in (self.one, self.other)
        ]
        return self.encounters.apart(
            (a, self.one.at(at), turns[0]), (b, self.other.at(at), turns[1])
        )
