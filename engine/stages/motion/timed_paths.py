"""Paths in time within speed, acceleration and jerk: with a rest at each corner, or smoothed.

The arm stays exactly on the path, so what is proved for the path holds. It therefore rests at each
corner. On a line all joints move in proportion, and the least time from rest to rest has a closed
form of seven phases (Biagiotti & Melchiorri 2008, 3.4).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.ports import MotionScene
from cellwright.engine.stages.motion.path_proofs import lines_too_deep, unproved_lines
from cellwright.engine.stages.motion.upright_planner import UprightLevel

JERK_PHASES = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])  # signs of the jerk
STILL_LINE = 1e-12  # rad or m: a line so short takes no time


@dataclass(frozen=True, slots=True, eq=False)
class JointLimits:
    """What each joint can do (k,): speed per second, acceleration per second squared, jerk per
    second cubed.
    """

    speed: Floats
    acceleration: Floats
    jerk: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A path (m, k) in time: its corners are reached at `corners_s` (m,).

    `phases_s` (m - 1, 7) are the durations of the phases of each line, and `jerks` (m - 1,) the
    greatest jerk of the share of the line that is done.
    """

    path: Floats
    corners_s: Floats
    phases_s: Floats
    jerks: Floats

    def at(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Configurations, speeds and accelerations (n, k) at times (n,); before the start and
        after the end it rests.
        """
        count, shape = len(self.path) - 1, (len(times_s), self.path.shape[1])
        if not count:
            return np.repeat(self.path, len(times_s), axis=0), np.zeros(shape), np.zeros(shape)
        line = np.clip(np.searchsorted(self.corners_s, times_s, side="right") - 1, 0, count - 1)
        share = np.array([self._share(n, t) for n, t in zip(line, times_s, strict=True)]).reshape(
            -1, 3
        )
        direction = (self.path[1:] - self.path[:-1])[line]
        return (
            self.path[line] + share[:, :1] * direction,
            share[:, 1:2] * direction,
            share[:, 2:] * direction,
        )

    def _share(self, n: int, t: float) -> tuple[float, float, float]:
        """How much of line `n` is done at a time, how fast that grows, and how fast this
        changes.
        """
        remaining, done, speed, change = (
            float(np.clip(t, *self.corners_s[n : n + 2]) - self.corners_s[n]),
            0.0,
            0.0,
            0.0,
        )
        for sign, lasts in zip(JERK_PHASES, self.phases_s[n], strict=True):
            dt, jerk = min(remaining, float(lasts)), float(sign * self.jerks[n])
            done += dt * (speed + dt * (change / 2 + dt * jerk / 6))
            speed += dt * (change + dt * jerk / 2)
            change += dt * jerk
            remaining -= dt
        return done, speed, change


def fastest_trajectory(path: Floats, limits: JointLimits) -> Trajectory:
    """The least times on a path (m, k). Raises `ValueError` for limits that are not above 0."""
    if min(limits.speed.min(), limits.acceleration.min(), limits.jerk.min()) <= 0.0:
        raise ValueError("speed, acceleration and jerk must be above 0")
    phases, jerks = [np.zeros((0, 7))], []
    for turns in np.abs(np.diff(path, axis=0)):
        most = [
            _share_limit(limit, turns) for limit in (limits.speed, limits.acceleration, limits.jerk)
        ]
        phases.append(np.array([_jerk_phases(*most)]))
        jerks.append(most[2] if np.isfinite(most[2]) else 0.0)
    lasts = np.concatenate(phases)
    corners = np.append(0.0, np.cumsum(lasts.sum(axis=1)))
    return Trajectory(path, corners, lasts, np.array(jerks))


def _share_limit(limit: Floats, turns: Floats) -> float:
    """What the share of a line may do at most, so that no joint does more than its limit."""
    moves = turns > STILL_LINE
    return float((limit[moves] / turns[moves]).min()) if moves.any() else np.inf


def _jerk_phases(speed: float, acceleration: float, jerk: float) -> list[float]:
    """The durations (s) of the seven phases from 0 to 1, from rest to rest."""
    if not np.isfinite(speed):
        return [0.0] * 7
    rises = acceleration / jerk if speed * jerk >= acceleration**2 else (speed / jerk) ** 0.5
    gains = rises + speed / acceleration if speed * jerk >= acceleration**2 else 2 * rises
    cruises = (1.0 - speed * gains) / speed
    if cruises < 0.0:
        cruises, rises = 0.0, acceleration / jerk
        if 2 * acceleration**3 / jerk**2 <= 1.0:
            gains = rises / 2 + (rises**2 / 4 + 1 / acceleration) ** 0.5
        else:
            rises = (1 / (2 * jerk)) ** (1 / 3)
            gains = 2 * rises
    holds = max(0.0, gains - 2 * rises)
    return [rises, holds, rises, cruises, rises, holds, rises]


def least_times(first: Floats, second: Floats, limits: JointLimits) -> Floats:
    """The least times (n,) from rest to rest on the straight lines between configurations (n, k).

    No path between the same ends is quicker, because each joint needs this long for its own way.
    """
    turns = np.abs(second - first)
    with np.errstate(divide="ignore"):
        speed, acceleration, jerk = (
            np.where(turns > STILL_LINE, limit / np.maximum(turns, STILL_LINE), np.inf).min(axis=1)
            for limit in (limits.speed, limits.acceleration, limits.jerk)
        )
    moves = np.isfinite(speed)
    speed, acceleration, jerk = (
        np.where(moves, limit, 1.0) for limit in (speed, acceleration, jerk)
    )
    full = speed * jerk >= acceleration**2
    gains = np.where(full, acceleration / jerk + speed / acceleration, 2 * np.sqrt(speed / jerk))
    cruises = (1.0 - speed * gains) / speed
    rises = acceleration / jerk
    wide = 2 * acceleration**3 / jerk**2 <= 1.0
    short = np.where(
        wide, rises / 2 + np.sqrt(rises**2 / 4 + 1 / acceleration), 2 * (1 / (2 * jerk)) ** (1 / 3)
    )
    times: Floats = np.where(moves, np.where(cruises < 0.0, 2 * short, 2 * gains + cruises), 0.0)
    return times


STRAY_M = 2e-4  # how far a point may be from the chords with which a smooth path is proved
SMOOTHING_ROUNDS = 12  # proofs, each with more corners at which the arm waits
WAIT_SHARES = np.array([0.0, 0.34, 0.67, 1.0])  # shares of both windows: at 1 the arm rests


@dataclass(frozen=True, slots=True, eq=False)
class EvenPath:
    """A path (m, k) gone through evenly: `knots_s` (n,) are the times of its `points` (n, k), a
    corner at which the arm waits twice.
    """

    points: Floats
    knots_s: Floats
    corners: Longs  # (m,) the last point of each corner


@dataclass(frozen=True, eq=False)
class SmoothedPath:
    """An even motion, averaged over two windows (s)."""

    even: EvenPath
    rise_s: float
    jerk_s: float

    @property
    def window_s(self) -> float:
        """How long before a moment what it averages begins."""
        return self.rise_s + self.jerk_s

    @property
    def duration_s(self) -> float:
        """From rest to rest."""
        return float(self.even.knots_s[-1]) + self.window_s

    @property
    def corners_s(self) -> Floats:
        """When each configuration of the path is passed (m,); the first and the last are where
        the arm rests.
        """
        corners: Floats = self.even.knots_s[self.even.corners] + self.window_s / 2
        corners[0], corners[-1] = 0.0, self.duration_s
        return corners

    @cached_property
    def _sums(self) -> tuple[Floats, Floats]:
        """The first and second integral over time (n, k) at the knots."""
        points, knots = self.even.points, self.even.knots_s
        lasts = np.diff(knots)[:, None]
        once = np.vstack(
            [0 * points[:1], np.cumsum(lasts * (points[1:] + points[:-1]) / 2, axis=0)]
        )
        slopes = (points[1:] - points[:-1]) / np.where(lasts > 0.0, lasts, 1.0)
        parts = lasts * once[:-1] + lasts**2 * points[:-1] / 2 + lasts**3 * slopes / 6
        return once, np.vstack([0 * points[:1], np.cumsum(parts, axis=0)])

    def at(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Configurations, speeds and accelerations (n, k) at times (n,); before the start and
        after the end it rests.
        """
        late = (0.0, self.rise_s, self.jerk_s, self.window_s)
        parts = [self._integrals(times_s - delay) for delay in late]
        area = self.rise_s * self.jerk_s
        values = [(a - b - c + d) / area for a, b, c, d in zip(*parts, strict=True)]
        return values[2], values[1], values[0]

    def _integrals(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """The even motion, and its first and second integral (n, k), at times (n,); it rests
        beyond its ends.
        """
        knots, points = self.even.knots_s, self.even.points
        once, twice = self._sums
        n = np.clip(np.searchsorted(knots, times_s, side="right") - 1, 0, max(len(knots) - 2, 0))
        inside = np.clip(times_s, 0.0, knots[-1])
        dt, beyond = (inside - knots[n])[:, None], (times_s - inside)[:, None]
        lasts = np.diff(knots, append=knots[-1])[n][:, None]
        following = points[np.minimum(n + 1, len(points) - 1)]
        slope = (following - points[n]) / np.where(lasts > 0.0, lasts, 1.0)
        value = points[n] + dt * slope
        first = once[n] + dt * points[n] + dt**2 * slope / 2
        second = twice[n] + dt * once[n] + dt**2 * points[n] / 2 + dt**3 * slope / 6
        return value, first + beyond * value, second + beyond * first + beyond**2 * value / 2


def even_path(path: Floats, limits: JointLimits, waits_s: Floats, slower: Floats) -> EvenPath:
    """A path (m, k) gone through evenly, each line (m - 1,) so much slower than the joints
    could, with waits at corners (m,).
    """
    least = (np.abs(np.diff(path, axis=0)) / limits.speed).max(axis=1, initial=0.0) * slower
    points, knots, corners = [path[0]], [0.0], [0]
    for n, lasts in enumerate(least):
        points.append(path[n + 1])
        knots.append(knots[-1] + float(lasts))
        if waits_s[n + 1] > 0.0 and n + 2 < len(path):
            points.append(path[n + 1])
            knots.append(knots[-1] + float(waits_s[n + 1]))
        corners.append(len(points) - 1)
    return EvenPath(np.array(points), np.array(knots), np.array(corners, dtype=np.int64))


def smooth_path(path: Floats, limits: JointLimits, waits: Floats, slower: Floats) -> SmoothedPath:
    """The smooth motion on a path (m, k), with waits (m,) at the corners, in shares of both
    windows.
    """
    lasts = (np.abs(np.diff(path, axis=0)) / limits.speed).max(axis=1, initial=0.0) * slower
    moves = lasts > STILL_LINE
    speeds = np.zeros((1, path.shape[1]))
    if moves.any():
        speeds = np.diff(path, axis=0)[moves] / lasts[moves][:, None]
    most, least = speeds.max(axis=0).clip(min=0.0), speeds.min(axis=0).clip(max=0.0)
    rise = float(((most - least) / limits.acceleration).max())
    jerk = float(
        (
            2.0
            * np.minimum(limits.acceleration, (most - least) / max(rise, STILL_LINE))
            / limits.jerk
        ).max()
    )
    rise, jerk = max(rise, 1e-6), max(jerk, 1e-6)
    return SmoothedPath(even_path(path, limits, waits * (rise + jerk), slower), rise, jerk)


@dataclass(frozen=True, slots=True, eq=False)
class MotionTube:
    """What a motion must keep: more than `margin_m` on a ground, proved on stretches down to
    `finest_m`.

    The pairs of `meeting`, which may touch, overlap by no more than `depth_m`. With `level`, what
    is in hand stays upright.
    """

    ground: MotionScene
    margin_m: float
    finest_m: float
    meeting: MotionScene | None = None
    depth_m: float = 0.0
    level: UprightLevel | None = None

    def left(self, chords: Floats, stray_m: float) -> Truths:
        """Where a motion that is at most so far from its chords (n, k) is not proved to keep
        all this (n - 1,).
        """
        is_unproved = unproved_lines(self.ground, chords, self.margin_m + stray_m, self.finest_m)
        if self.meeting is not None:
            is_unproved |= lines_too_deep(self.meeting, chords, self.depth_m, stray_m)
        if self.level is not None:
            is_unproved |= ~self.level.holds(chords, self.ground.scene.joints)
        return is_unproved


def certify_smooth_path(
    tube: MotionTube, path: Floats, limits: JointLimits, own: slice, slower: Floats
) -> tuple[SmoothedPath, bool]:
    """The smooth motion on a path (m, all joints) that is proved to stay in a tube, and whether it
    is.

    The arm's joints are `own`; each line takes so many times (m - 1,) as long as the joints need.
    If no other does, the motion that rests at each corner stays on the path.
    """
    levels = np.zeros(len(path), dtype=np.int64)
    for _ in range(SMOOTHING_ROUNDS):
        smooth = smooth_path(path[:, own], limits, WAIT_SHARES[levels], slower)
        times = _chord_times(tube.ground, smooth, limits, path[0], own)
        chords = _all_joints(path[0], own, smooth.at(times)[0])
        outside = tube.left(chords, _chord_stray(tube.ground, limits, path[0], own, times))
        if not outside.any():
            return smooth, True
        touched = _corners_near(smooth, times[:-1][outside], times[1:][outside])
        if not (levels[touched] < len(WAIT_SHARES) - 1).any():
            break
        levels[touched] = np.minimum(levels[touched] + 1, len(WAIT_SHARES) - 1)
    return smooth_path(path[:, own], limits, np.ones(len(path)), slower), False


def _all_joints(like: Floats, own: slice, q: Floats) -> Floats:
    """Configurations of all joints (n, all), with those of one arm (n, k) among them."""
    whole = np.repeat(like[None], len(q), axis=0)
    whole[:, own] = q
    return whole


def _chord_times(
    ground: MotionScene, smooth: SmoothedPath, limits: JointLimits, like: Floats, own: slice
) -> Floats:
    """Times (n,) so close that the chords between them are near the smooth path."""
    swing = _all_joints(np.zeros_like(like), own, limits.acceleration[None])[0]
    metres = ground.travel(np.zeros_like(like), swing)
    step = (8.0 * STRAY_M / max(metres, 1e-9)) ** 0.5
    return np.linspace(0.0, smooth.duration_s, max(2, int(np.ceil(smooth.duration_s / step)) + 1))


def _chord_stray(
    ground: MotionScene, limits: JointLimits, like: Floats, own: slice, times: Floats
) -> float:
    """How far (m) any point can be from where it is on the chords."""
    lasts = float(times[1] - times[0])
    swing = _all_joints(np.zeros_like(like), own, limits.acceleration[None])[0]
    return ground.travel(np.zeros_like(like), swing * lasts**2 / 8.0)


def _corners_near(smooth: SmoothedPath, begins_s: Floats, ends_s: Floats) -> Longs:
    """The corners (c,) that take part in the averages at some stretches of time (n,)."""
    at = smooth.even.knots_s[smooth.even.corners]
    inside = (at[None] <= ends_s[:, None]) & (at[None] >= begins_s[:, None] - smooth.window_s)
    corners: Longs = np.nonzero(inside.any(axis=0))[0]
    if len(corners):
        return corners
    nearest: Longs = np.unique(np.abs(at[None] - begins_s[:, None]).argmin(axis=1))
    return nearest
