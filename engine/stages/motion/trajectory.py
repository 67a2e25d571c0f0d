"""When an arm is where on a path: the least time on each line, within speed, acceleration and jerk of every joint.

The arm stays exactly on the path, so what is proved for the path holds. It therefore rests at each corner. On a line all joints
move in proportion, and the least time from rest to rest has a closed form of seven phases (Biagiotti & Melchiorri 2008, 3.4).
"""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.geometry import Floats

PHASES = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])  # signs of the jerk
STILL = 1e-12  # rad or m: a line so short takes no time


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """What each joint can do (k,): speed per second, acceleration per second squared, jerk per second cubed."""

    speed: Floats
    acceleration: Floats
    jerk: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A path (m, k) in time: its corners are reached at `corners_s` (m,).

    `phases_s` (m - 1, 7) are the durations of the phases of each line, and `jerks` (m - 1,) the greatest jerk of the share of
    the line that is done.
    """

    path: Floats
    corners_s: Floats
    phases_s: Floats
    jerks: Floats

    def at(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Configurations, speeds and accelerations (n, k) at times (n,); before the start and after the end it rests."""
        count, shape = len(self.path) - 1, (len(times_s), self.path.shape[1])
        if not count:
            return np.repeat(self.path, len(times_s), axis=0), np.zeros(shape), np.zeros(shape)
        line = np.clip(np.searchsorted(self.corners_s, times_s, side="right") - 1, 0, count - 1)
        share = np.array([self._share(n, t) for n, t in zip(line, times_s, strict=True)]).reshape(-1, 3)
        way = (self.path[1:] - self.path[:-1])[line]
        return self.path[line] + share[:, :1] * way, share[:, 1:2] * way, share[:, 2:] * way

    def _share(self, n: int, t: float) -> tuple[float, float, float]:
        """How much of line `n` is done at a time, how fast that grows, and how fast this changes."""
        left, done, speed, change = (
            float(np.clip(t, *self.corners_s[n : n + 2]) - self.corners_s[n]),
            0.0,
            0.0,
            0.0,
        )
        for sign, lasts in zip(PHASES, self.phases_s[n], strict=True):
            dt, jerk = min(left, float(lasts)), float(sign * self.jerks[n])
            done += dt * (speed + dt * (change / 2 + dt * jerk / 6))
            speed += dt * (change + dt * jerk / 2)
            change += dt * jerk
            left -= dt
        return done, speed, change


def fastest(path: Floats, limits: Limits) -> Trajectory:
    """The least times on a path (m, k). Raises `ValueError` for limits that are not above 0."""
    if min(limits.speed.min(), limits.acceleration.min(), limits.jerk.min()) <= 0.0:
        raise ValueError("speed, acceleration and jerk must be above 0")
    phases, jerks = [np.zeros((0, 7))], []
    for way in np.abs(np.diff(path, axis=0)):
        most = [_most(limit, way) for limit in (limits.speed, limits.acceleration, limits.jerk)]
        phases.append(np.array([_phases(*most)]))
        jerks.append(most[2] if np.isfinite(most[2]) else 0.0)
    lasts = np.concatenate(phases)
    corners = np.append(0.0, np.cumsum(lasts.sum(axis=1)))
    return Trajectory(path, corners, lasts, np.array(jerks))


def _most(limit: Floats, way: Floats) -> float:
    """What the share of a line may do at most, so that no joint does more than its limit."""
    moves = way > STILL
    return float((limit[moves] / way[moves]).min()) if moves.any() else np.inf


def _phases(speed: float, acceleration: float, jerk: float) -> list[float]:
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


def least_times(first: Floats, second: Floats, limits: Limits) -> Floats:
    """The least times (n,) from rest to rest on the straight lines between configurations (n, k).

    No path between the same ends is quicker, because each joint needs this long for its own way.
    """
    way = np.abs(second - first)
    with np.errstate(divide="ignore"):
        speed, acceleration, jerk = (
            np.where(way > STILL, limit / np.maximum(way, STILL), np.inf).min(axis=1)
            for limit in (limits.speed, limits.acceleration, limits.jerk)
        )
    moves = np.isfinite(speed)
    speed, acceleration, jerk = (np.where(moves, each, 1.0) for each in (speed, acceleration, jerk))
    full = speed * jerk >= acceleration**2
    gains = np.where(full, acceleration / jerk + speed / acceleration, 2 * np.sqrt(speed / jerk))
    cruises = (1.0 - speed * gains) / speed
    rises = acceleration / jerk
    wide = 2 * acceleration**3 / jerk**2 <= 1.0
    short = np.where(
        wide, rises / 2 + np.sqrt(rises**2 / 4 + 1 / acceleration), 2 * (1 / (2 * jerk)) ** (1 / 3)
    )
    found: Floats = np.where(moves, np.where(cruises < 0.0, 2 * short, 2 * gains + cruises), 0.0)
    return found
