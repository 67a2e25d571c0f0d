"""Times the legs of a motion: fast, with corners cut, and slower in zones of people."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import ConvexPiece
from cellwright.engine.pipelines.motion.motion_legs import MotionLeg
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.shapes.part_shapes import shape_cores
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.motion.timed_paths import (
    JointLimits,
    SmoothedPath,
    Trajectory,
    certify_smooth_path,
    fastest_trajectory,
    smooth_path,
)
from cellwright.engine.stages.motion.upright_planner import UprightLevel

MAX_LINE_PART = 0.1  # rad or m: lines are cut so short before some are slowed
SPEED_STEP_S = 0.01  # between two looks at a speed
MAX_SLOWING_ROUNDS = 50


@dataclass(frozen=True, slots=True, eq=False)
class PeopleZone:
    """A zone of the cell: the arm among nothing but the zone, and the greatest speed of its
    points there (m/s).
    """

    name: str
    ground: PlanningScene
    speed_m_s: float

    def meets(self, path: Floats) -> bool:
        """Whether anything gets into the zone on a path (m, k)."""
        return bool(self.ground.collides(cut_lines(path)).any())


def zones_of(world: GeometricWorld, ground: PlanningScene) -> tuple[PeopleZone, ...]:
    """The zones of a world's cell, for what moves in the scene of a ground."""
    zones = []
    for name, zone in world.cell.zones.items():
        moving = tuple(piece for piece in ground.scene.pieces if piece.carrier > 0)
        below = world.locate(zone.placement.parent)
        T = matmul(below.T_carrier_frame, transforms.of_pose(zone.placement.pose))
        space = tuple(
            ConvexPiece(name, below.carrier, T, core.vertices, core.radius_m, core.box)
            for core in shape_cores(zone.shape)
        )
        pairs = [(i, len(moving) + j) for i in range(len(moving)) for j in range(len(space))]
        scene = replace(
            ground.scene,
            pieces=(*moving, *space),
            pairs=np.array(pairs, dtype=np.int64).reshape(-1, 2),
            bodies=tuple(dict.fromkeys(piece.body for piece in (*moving, *space))),
        )
        zones.append(PeopleZone(name, PlanningScene(BuiltinChecker(scene)), zone.speed_m_s))
    return tuple(zones)


def cut_lines(path: Floats) -> Floats:
    """The path (m, k) with lines cut into parts of at most `PART`."""
    rows = [path[:1]]
    for a, b in pairwise(path):
        count = max(1, int(np.ceil(norm(b - a) / MAX_LINE_PART)))
        rows.append(a + (np.arange(1, count + 1) / count)[:, None] * (b - a))
    return np.concatenate(rows)


def slow_leg(
    leg: MotionLeg,
    limits: JointLimits,
    own: slice,
    zones: Sequence[PeopleZone],
    level: UprightLevel | None,
) -> SmoothedPath:
    """The leg in time, with every line slowed that a moment in a zone depends on, until all
    zones are respected.
    """
    path = cut_lines(leg.path)
    slower = np.ones(len(path) - 1)
    for _ in range(MAX_SLOWING_ROUNDS):
        course, proved = certify_smooth_path(leg.tube(level), path, limits, own, slower)
        if not proved:
            course = smooth_path(path[:, own], limits, np.ones(len(path)), slower)
        factors = np.array([_too_fast(zone, course, path, own) for zone in zones]).max(axis=0)
        if (factors <= 1.0).all():
            break
        slower = slower * factors
    return _told_at(course, _configuration_rows(leg.path))


def _configuration_rows(path: Floats) -> Longs:
    """Where the configurations of a path (m, k) are in the parted one (m,)."""
    counts = [len(cut_lines(path[n : n + 2])) - 1 for n in range(len(path) - 1)]
    return np.append(0, np.cumsum(np.array(counts, dtype=np.int64)))


def _told_at(course: SmoothedPath, rows: Longs) -> SmoothedPath:
    """The motion, with the times of some of its corners alone."""
    return replace(course, even=replace(course.even, corners=course.even.corners[rows]))


def _too_fast(zone: PeopleZone, course: SmoothedPath, path: Floats, own: slice) -> Floats:
    """By how much each line (m - 1,) must be slower than now, because an average in the zone
    depends on it.
    """
    times = np.linspace(0.0, course.duration_s, max(2, int(course.duration_s / SPEED_STEP_S) + 1))
    q = np.repeat(path[:1], len(times), axis=0)
    q[:, own] = course.at(times)[0]
    inside = (
        zone.ground.clearance(q, zone.speed_m_s * SPEED_STEP_S + 1e-3)
        <= zone.speed_m_s * SPEED_STEP_S
    )
    factors = np.ones(len(path) - 1)
    knots = course.even.knots_s[course.even.corners]
    for n, lasts in enumerate(np.diff(knots)):
        met = inside & (times >= knots[n]) & (times - course.window_s <= knots[n + 1])
        if met.any() and lasts > 0.0:
            factors[n] = max(1.0, zone.ground.travel(path[n], path[n + 1]) / lasts / zone.speed_m_s)
    return np.where(factors > 1.0 + 1e-9, factors, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class TimedLegs:
    """Legs in time: each begins at rest when the one before it ends. `begins_s` (n,) says when."""

    legs: tuple[SmoothedPath | Trajectory, ...]
    begins_s: tuple[float, ...]
    duration_s: float
    slow: tuple[str, ...] = ()

    @property
    def cuts(self) -> bool:
        """Whether corners are cut."""
        return any(isinstance(leg, SmoothedPath) for leg in self.legs)

    def corners_s(self) -> Floats:
        """When each configuration of the whole path is passed (m,)."""
        parts = [
            leg.corners_s + begins for leg, begins in zip(self.legs, self.begins_s, strict=True)
        ]
        return (
            np.concatenate([parts[0][:1], *(part[1:] for part in parts)]) if parts else np.zeros(0)
        )

    def at(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Configurations, speeds and accelerations (n, k) at times (n,)."""
        number = np.clip(
            np.searchsorted(self.begins_s, times_s, side="right") - 1, 0, len(self.legs) - 1
        )
        rows = [np.nonzero(number == n)[0] for n in range(len(self.legs))]
        parts = [
            leg.at(times_s[own] - begins)
            for leg, own, begins in zip(self.legs, rows, self.begins_s, strict=True)
        ]
        back = np.argsort(np.concatenate(rows), kind="stable")
        q, v, a = (np.concatenate(part)[back] for part in zip(*parts, strict=True))
        return q, v, a


def time_legs(
    legs: Sequence[MotionLeg],
    limits: JointLimits,
    own: slice,
    zones: Sequence[PeopleZone] = (),
    smooth: bool = True,
    level: UprightLevel | None = None,
) -> TimedLegs:
    """The legs of one arm, whose joints are `own`, in time; with `smooth` corners are cut where
    that is proved and quicker.
    """
    trajectories: list[SmoothedPath | Trajectory] = []
    begins, slow = [0.0], []
    for leg in legs:
        within = [zone for zone in zones if zone.meets(leg.path)]
        slow += [zone.name for zone in within]
        trajectories.append(
            slow_leg(leg, limits, own, within, level)
            if within
            else _quickest_course(leg, limits, own, smooth, level)
        )
        begins.append(begins[-1] + float(trajectories[-1].corners_s[-1]))
    return TimedLegs(
        tuple(trajectories), tuple(begins[:-1]), begins[-1], tuple(dict.fromkeys(slow))
    )


def _quickest_course(
    leg: MotionLeg, limits: JointLimits, own: slice, smooth: bool, level: UprightLevel | None
) -> SmoothedPath | Trajectory:
    """The quicker one of resting at each corner and of cutting corners, if that is proved."""
    resting = fastest_trajectory(leg.path[:, own], limits)
    if not smooth or len(leg.path) < 3 or not leg.proved:
        return resting
    even = np.ones(len(leg.path) - 1)
    cut, proved = certify_smooth_path(leg.tube(level), leg.path, limits, own, even)
    return cut if proved and cut.duration_s < resting.corners_s[-1] else resting
