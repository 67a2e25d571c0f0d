"""A motion in time: each leg as fast as the joints can, corners cut as far as a proof allows, slower where people may be."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.motion.legs import Leg
from cellwright.engine.pipelines.motion.zones import Zone, slowed
from cellwright.engine.stages.motion.smoothing import Smoothed, certified
from cellwright.engine.stages.motion.trajectory import Limits, Trajectory, fastest
from cellwright.engine.stages.motion.upright import Level


@dataclass(frozen=True, slots=True, eq=False)
class Timed:
    """Legs in time: each begins at rest when the one before it ends. `begins_s` (n,) says when."""

    legs: tuple[Smoothed | Trajectory, ...]
    begins_s: tuple[float, ...]
    duration_s: float
    slow: tuple[str, ...] = ()

    @property
    def cuts(self) -> bool:
        """Whether corners are cut."""
        return any(isinstance(leg, Smoothed) for leg in self.legs)

    def corners_s(self) -> Floats:
        """When each configuration of the whole path is passed (m,)."""
        parts = [leg.corners_s + begins for leg, begins in zip(self.legs, self.begins_s, strict=True)]
        return np.concatenate([parts[0][:1], *(part[1:] for part in parts)]) if parts else np.zeros(0)

    def at(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Configurations, speeds and accelerations (n, k) at times (n,)."""
        number = np.clip(np.searchsorted(self.begins_s, times_s, side="right") - 1, 0, len(self.legs) - 1)
        rows = [np.nonzero(number == n)[0] for n in range(len(self.legs))]
        parts = [
            leg.at(times_s[own] - begins)
            for leg, own, begins in zip(self.legs, rows, self.begins_s, strict=True)
        ]
        back = np.argsort(np.concatenate(rows), kind="stable")
        q, v, a = (np.concatenate(part)[back] for part in zip(*parts, strict=True))
        return q, v, a


def timed(
    legs: Sequence[Leg],
    limits: Limits,
    own: slice,
    zones: Sequence[Zone] = (),
    smooth: bool = True,
    level: Level | None = None,
) -> Timed:
    """The legs of one arm, whose joints are `own`, in time; with `smooth` corners are cut where that is proved and quicker."""
    found: list[Smoothed | Trajectory] = []
    begins, slow = [0.0], []
    for leg in legs:
        within = [zone for zone in zones if zone.meets(leg.path)]
        slow += [zone.name for zone in within]
        found.append(
            slowed(leg, limits, own, within, level) if within else _quickest(leg, limits, own, smooth, level)
        )
        begins.append(begins[-1] + float(found[-1].corners_s[-1]))
    return Timed(tuple(found), tuple(begins[:-1]), begins[-1], tuple(dict.fromkeys(slow)))


def _quickest(
    leg: Leg, limits: Limits, own: slice, smooth: bool, level: Level | None
) -> Smoothed | Trajectory:
    """The quicker one of resting at each corner and of cutting corners, if that is proved."""
    resting = fastest(leg.path[:, own], limits)
    if not smooth or len(leg.path) < 3 or not leg.proved:
        return resting
    even = np.ones(len(leg.path) - 1)
    cut, proved = certified(leg.tube(level), leg.path, limits, own, even)
    return cut if proved and cut.duration_s < resting.corners_s[-1] else resting
