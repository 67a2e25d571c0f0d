"""All that one arm does in a plan as lines between configurations, one after the other, so that many moments are looked up at once."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.model.moves import Leg, LegKind, MovedStep
from cellwright.engine.pipelines.moves.tracks import Key, Moment, Occupied, Passage, Rider, tracks
from cellwright.kb.model.plan import StepId

FASTEST = 15 / 8  # the greatest speed on a line from rest to rest, in terms of the mean


@dataclass(frozen=True, slots=True)
class Course:
    """Lines (n,) of one arm with k joints; where it rests, a line leads nowhere.

    `first` and `way` (n, k) are where a line begins and where it leads. The line belongs to a step by its place `number` in the track
    of the arm, begins and ends so long after the step (`begins_s`, `ends_s`), unless it is a `rest` before the step. `rider` numbers what
    moves with the arm (`riders`), and `step` is the number of the step, 0 for a rest between steps. `turned_before` (n, k)
    is how much each joint has turned before the line.
    """

    steps: tuple[StepId, ...]
    riders: tuple[Rider, ...]
    first: Floats
    way: Floats
    begins_s: Floats
    ends_s: Floats
    rest: Truths
    number: Longs
    rider: Longs
    step: Longs
    turned_before: Floats

    def begun(self, starts: Mapping[StepId, float], until_s: float) -> "Course":
        """The course with times from the beginning of the plan, if steps begin then."""
        begun = np.array([*(starts[each] for each in self.steps), until_s])
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
        found: Floats = np.abs(self.way).max(axis=1) / lasts * FASTEST
        return found

    def line_at(self, times: Floats) -> Longs:
        """The line at each of some times (n,)."""
        found = np.searchsorted(self.begins_s, times, side="right") - 1
        return np.maximum(found, 0).astype(np.int64)

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
        found: Floats = s**3 * (10 - 15 * s + 6 * s * s)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """A line before all of a course are put together; `step` is the number of the step, 0 for a rest before it."""

    number: int
    step: int
    rider: Rider
    first: Floats
    last: Floats
    begins_s: float = 0.0
    ends_s: float = 0.0


def courses_of(moments: Sequence[Moment]) -> dict[str, Course]:
    """The course of each arm in a plan."""
    if not moments:
        return {}
    world = moments[0].before
    homes = {arm: Passage(Rider(world, arm), q[None]) for arm, q in world.configurations.items()}
    moved = {each.step: each.moved for each in moments}
    return {
        arm: _course(homes[arm], track, [moved[each.step] for each in track])
        for arm, track in tracks(moments, world.configurations).items()
    }


def _course(home: Passage, track: Sequence[Occupied], moved: Sequence[MovedStep | None]) -> Course:
    lines, rest = list[_Line](), home
    for number, (each, done) in enumerate(zip(track, moved, strict=True)):
        assert done is not None
        lines.append(_Line(number, 0, rest.rider, rest.path[-1], rest.path[-1]))
        lines += _of_step(number, each, done)
        rest = each.rest
    lines.append(_Line(len(track), 0, rest.rider, rest.path[-1], rest.path[-1]))
    riders = _Riders()
    first, last = (np.array([getattr(each, end) for each in lines]) for end in ("first", "last"))
    turned = np.cumsum(np.abs(last - first), axis=0)
    rider = np.array([riders.number(each.rider) for each in lines], np.int64)
    return Course(
        tuple(each.step for each in track),
        tuple(riders.known),
        first,
        last - first,
        np.array([each.begins_s for each in lines]),
        np.array([each.ends_s for each in lines]),
        np.array([each.step == 0 for each in lines]),
        np.array([each.number for each in lines], np.int64),
        rider,
        np.array([each.step for each in lines], np.int64),
        turned - np.abs(last - first),
    )


@dataclass(slots=True)
class _Riders:
    """Riders by number: those that carry the same have one number."""

    known: list[Rider] = field(default_factory=list)
    numbers: dict[Key, int] = field(default_factory=dict)

    def number(self, rider: Rider) -> int:
        if rider.key not in self.numbers:
            self.numbers[rider.key] = len(self.known)
            self.known.append(rider)
        return self.numbers[rider.key]


def _of_step(number: int, occupied: Occupied, moved: MovedStep) -> Iterator[_Line]:
    """What one arm does in a step, one leg after the other; it rests while another arm moves."""
    now, passages, entered = 0.0, list(occupied.passages), False
    at = passages.pop(0)

    def resting(seconds: float) -> _Line:
        q = at.path[-1]
        return _Line(number, int(occupied.step), at.rider, q, q, now, now + seconds)

    for leg in moved.legs:
        lasts = moved.takes_s if leg.kind is LegKind.DRIVE else leg.seconds
        own = next((each for each in (leg, *leg.beside) if each.arm == occupied.arm), None)
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


def _of_leg(number: int, step: int, rider: Rider, leg: Leg, begins_s: float) -> Iterator[_Line]:
    for n in range(len(leg.path) - 1):
        since, until = (begins_s + float(leg.corners_s[m]) for m in (n, n + 1))
        yield _Line(number, step, rider, leg.path[n], leg.path[n + 1], since, until)
