"""Paths in time without a rest at each corner: the lines are gone through evenly, and then averaged over a moving window.

An even motion along straight lines is averaged over a window of `rise_s`, and the result over one of `jerk_s`. An average
is never faster than what it averages. So if the even motion is within the speeds of the joints, so is the smooth one; the first
window is long enough for their accelerations, the second for their jerks. The arm cuts each corner by a little: how much the
planner allows is decided by a proof of the smooth path: that it keeps clear, and that what touches by intention goes no
deeper than it may. Where it fails, the arm waits at the corner, at last for so long
that it rests there, and nothing is cut.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.ports import MotionGround
from cellwright.engine.stages.motion.proving import unproved
from cellwright.engine.stages.motion.touching import too_deep
from cellwright.engine.stages.motion.trajectory import STILL, Limits
from cellwright.engine.stages.motion.upright import Level

STRAY_M = 2e-4  # how far a point may be from the chords with which a smooth path is proved
ROUNDS = 12  # proofs, each with more corners at which the arm waits
WAITS = np.array([0.0, 0.34, 0.67, 1.0])  # shares of both windows: at 1 the arm rests


@dataclass(frozen=True, slots=True, eq=False)
class Even:
    """A path (m, k) gone through evenly: `knots_s` (n,) are the times of its `points` (n, k), a corner at which the arm waits twice."""

    points: Floats
    knots_s: Floats
    corners: Longs  # (m,) the last point of each corner


@dataclass(frozen=True, eq=False)
class Smoothed:
    """An even motion, averaged over two windows (s)."""

    even: Even
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
        """When each configuration of the path is passed (m,); the first and the last are where the arm rests."""
        found: Floats = self.even.knots_s[self.even.corners] + self.window_s / 2
        found[0], found[-1] = 0.0, self.duration_s
        return found

    @cached_property
    def _sums(self) -> tuple[Floats, Floats]:
        """The first and second integral over time (n, k) at the knots."""
        points, knots = self.even.points, self.even.knots_s
        lasts = np.diff(knots)[:, None]
        once = np.vstack([0 * points[:1], np.cumsum(lasts * (points[1:] + points[:-1]) / 2, axis=0)])
        slopes = (points[1:] - points[:-1]) / np.where(lasts > 0.0, lasts, 1.0)
        parts = lasts * once[:-1] + lasts**2 * points[:-1] / 2 + lasts**3 * slopes / 6
        return once, np.vstack([0 * points[:1], np.cumsum(parts, axis=0)])

    def at(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Configurations, speeds and accelerations (n, k) at times (n,); before the start and after the end it rests."""
        late = (0.0, self.rise_s, self.jerk_s, self.window_s)
        parts = [self._integrals(times_s - each) for each in late]
        area = self.rise_s * self.jerk_s
        values = [(a - b - c + d) / area for a, b, c, d in zip(*parts, strict=True)]
        return values[2], values[1], values[0]

    def _integrals(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """The even motion, and its first and second integral (n, k), at times (n,); it rests beyond its ends."""
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


def even(path: Floats, limits: Limits, waits_s: Floats, slower: Floats) -> Even:
    """A path (m, k) gone through evenly, each line (m - 1,) so much slower than the joints could, with waits at corners (m,)."""
    least = (np.abs(np.diff(path, axis=0)) / limits.speed).max(axis=1, initial=0.0) * slower
    points, knots, corners = [path[0]], [0.0], [0]
    for n, lasts in enumerate(least):
        points.append(path[n + 1])
        knots.append(knots[-1] + float(lasts))
        if waits_s[n + 1] > 0.0 and n + 2 < len(path):
            points.append(path[n + 1])
            knots.append(knots[-1] + float(waits_s[n + 1]))
        corners.append(len(points) - 1)
    return Even(np.array(points), np.array(knots), np.array(corners, dtype=np.int64))


def smoothed(path: Floats, limits: Limits, waits: Floats, slower: Floats) -> Smoothed:
    """The smooth motion on a path (m, k), with waits (m,) at the corners, in shares of both windows."""
    lasts = (np.abs(np.diff(path, axis=0)) / limits.speed).max(axis=1, initial=0.0) * slower
    moves = lasts > STILL
    speeds = np.zeros((1, path.shape[1]))
    if moves.any():
        speeds = np.diff(path, axis=0)[moves] / lasts[moves][:, None]
    most, least = speeds.max(axis=0).clip(min=0.0), speeds.min(axis=0).clip(max=0.0)
    rise = float(((most - least) / limits.acceleration).max())
    jerk = float(
        (2.0 * np.minimum(limits.acceleration, (most - least) / max(rise, STILL)) / limits.jerk).max()
    )
    rise, jerk = max(rise, 1e-6), max(jerk, 1e-6)
    return Smoothed(even(path, limits, waits * (rise + jerk), slower), rise, jerk)


@dataclass(frozen=True, slots=True, eq=False)
class Tube:
    """What a motion must keep: more than `margin_m` on a ground, proved on stretches down to `finest_m`.

    The pairs of `meeting`, which may touch, overlap by no more than `depth_m`. With `level`, what is in hand stays upright.
    """

    ground: MotionGround
    margin_m: float
    finest_m: float
    meeting: MotionGround | None = None
    depth_m: float = 0.0
    level: Level | None = None

    def left(self, chords: Floats, stray_m: float) -> Truths:
        """Where a motion that is at most so far from its chords (n, k) is not proved to keep all this (n - 1,)."""
        found = unproved(self.ground, chords, self.margin_m + stray_m, self.finest_m)
        if self.meeting is not None:
            found |= too_deep(self.meeting, chords, self.depth_m, stray_m)
        if self.level is not None:
            found |= ~self.level.holds(chords, self.ground.scene.joints)
        return found


def certified(tube: Tube, path: Floats, limits: Limits, own: slice, slower: Floats) -> tuple[Smoothed, bool]:
    """The smooth motion on a path (m, all joints) that is proved to stay in a tube, and whether it is.

    The arm's joints are `own`; each line takes so many times (m - 1,) as long as the joints need. If no other does, the motion
    that rests at each corner stays on the path.
    """
    levels = np.zeros(len(path), dtype=np.int64)
    for _ in range(ROUNDS):
        found = smoothed(path[:, own], limits, WAITS[levels], slower)
        times = _moments(tube.ground, found, limits, path[0], own)
        chords = _whole(path[0], own, found.at(times)[0])
        left = tube.left(chords, _stray(tube.ground, limits, path[0], own, times))
        if not left.any():
            return found, True
        touched = _corners_near(found, times[:-1][left], times[1:][left])
        if not (levels[touched] < len(WAITS) - 1).any():
            break
        levels[touched] = np.minimum(levels[touched] + 1, len(WAITS) - 1)
    return smoothed(path[:, own], limits, np.ones(len(path)), slower), False


def _whole(like: Floats, own: slice, q: Floats) -> Floats:
    """Configurations of all joints (n, all), with those of one arm (n, k) among them."""
    whole = np.repeat(like[None], len(q), axis=0)
    whole[:, own] = q
    return whole


def _moments(ground: MotionGround, found: Smoothed, limits: Limits, like: Floats, own: slice) -> Floats:
    """Times (n,) so close that the chords between them are near the smooth path."""
    swing = _whole(np.zeros_like(like), own, limits.acceleration[None])[0]
    metres = ground.travel(np.zeros_like(like), swing)
    step = (8.0 * STRAY_M / max(metres, 1e-9)) ** 0.5
    return np.linspace(0.0, found.duration_s, max(2, int(np.ceil(found.duration_s / step)) + 1))


def _stray(ground: MotionGround, limits: Limits, like: Floats, own: slice, times: Floats) -> float:
    """How far (m) any point can be from where it is on the chords."""
    lasts = float(times[1] - times[0])
    swing = _whole(np.zeros_like(like), own, limits.acceleration[None])[0]
    return ground.travel(np.zeros_like(like), swing * lasts**2 / 8.0)


def _corners_near(found: Smoothed, begins_s: Floats, ends_s: Floats) -> Longs:
    """The corners (c,) that take part in the averages at some stretches of time (n,)."""
    at = found.even.knots_s[found.even.corners]
    inside = (at[None] <= ends_s[:, None]) & (at[None] >= begins_s[:, None] - found.window_s)
    corners: Longs = np.nonzero(inside.any(axis=0))[0]
    if len(corners):
        return corners
    nearest: Longs = np.unique(np.abs(at[None] - begins_s[:, None]).argmin(axis=1))
    return nearest
