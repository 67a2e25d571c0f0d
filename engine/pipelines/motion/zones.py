"""Zones in which people may be: while any part of the arm is in one, no point of it moves faster than the zone allows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import Floats, Longs, Piece
from cellwright.engine.pipelines.motion.legs import Leg
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.ground import Ground
from cellwright.engine.stages.geometry.shapes.parts import cores
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.motion.smoothing import Smoothed, certified, smoothed
from cellwright.engine.stages.motion.trajectory import Limits
from cellwright.engine.stages.motion.upright import Level

PART = 0.1  # rad or m: lines are cut so short before some are slowed
STEP_S = 0.01  # between two looks at a speed
ROUNDS = 50


@dataclass(frozen=True, slots=True, eq=False)
class Zone:
    """A zone of the cell: the arm among nothing but the zone, and the greatest speed of its points there (m/s)."""

    name: str
    ground: Ground
    speed_m_s: float

    def meets(self, path: Floats) -> bool:
        """Whether anything gets into the zone on a path (m, k)."""
        return bool(self.ground.collides(parted(path)).any())


def zones_of(world: World, ground: Ground) -> tuple[Zone, ...]:
    """The zones of a world's cell, for what moves in the scene of a ground."""
    found = []
    for name, zone in world.cell.zones.items():
        moving = tuple(piece for piece in ground.scene.pieces if piece.carrier > 0)
        below = world.locate(zone.placement.parent)
        T = matmul(below.T_carrier_frame, transforms.of_pose(zone.placement.pose))
        space = tuple(
            Piece(name, below.carrier, T, core.vertices, core.radius_m, core.box)
            for core in cores(zone.shape)
        )
        pairs = [(i, len(moving) + j) for i in range(len(moving)) for j in range(len(space))]
        scene = replace(
            ground.scene,
            pieces=(*moving, *space),
            pairs=np.array(pairs, dtype=np.int64).reshape(-1, 2),
            bodies=tuple(dict.fromkeys(piece.body for piece in (*moving, *space))),
        )
        found.append(Zone(name, Ground(BuiltinChecker(scene)), zone.speed_m_s))
    return tuple(found)


def parted(path: Floats) -> Floats:
    """The path (m, k) with lines cut into parts of at most `PART`."""
    rows = [path[:1]]
    for a, b in pairwise(path):
        count = max(1, int(np.ceil(norm(b - a) / PART)))
        rows.append(a + (np.arange(1, count + 1) / count)[:, None] * (b - a))
    return np.concatenate(rows)


def slowed(leg: Leg, limits: Limits, own: slice, zones: Sequence[Zone], level: Level | None) -> Smoothed:
    """The leg in time, with every line slowed that a moment in a zone depends on, until all zones are respected."""
    path = parted(leg.path)
    slower = np.ones(len(path) - 1)
    for _ in range(ROUNDS):
        found, proved = certified(leg.tube(level), path, limits, own, slower)
        if not proved:
            found = smoothed(path[:, own], limits, np.ones(len(path)), slower)
        factors = np.array([_too_fast(zone, found, path, own) for zone in zones]).max(axis=0)
        if (factors <= 1.0).all():
            break
        slower = slower * factors
    return _told_at(found, _rows(leg.path))


def _rows(path: Floats) -> Longs:
    """Where the configurations of a path (m, k) are in the parted one (m,)."""
    counts = [len(parted(path[n : n + 2])) - 1 for n in range(len(path) - 1)]
    return np.append(0, np.cumsum(np.array(counts, dtype=np.int64)))


def _told_at(found: Smoothed, rows: Longs) -> Smoothed:
    """The motion, with the times of some of its corners alone."""
    return replace(found, even=replace(found.even, corners=found.even.corners[rows]))


def _too_fast(zone: Zone, found: Smoothed, path: Floats, own: slice) -> Floats:
    """By how much each line (m - 1,) must be slower than now, because an average in the zone depends on it."""
    times = np.linspace(0.0, found.duration_s, max(2, int(found.duration_s / STEP_S) + 1))
    q = np.repeat(path[:1], len(times), axis=0)
    q[:, own] = found.at(times)[0]
    inside = zone.ground.clearance(q, zone.speed_m_s * STEP_S + 1e-3) <= zone.speed_m_s * STEP_S
    factors = np.ones(len(path) - 1)
    knots = found.even.knots_s[found.even.corners]
    for n, lasts in enumerate(np.diff(knots)):
        met = inside & (times >= knots[n]) & (times - found.window_s <= knots[n + 1])
        if met.any() and lasts > 0.0:
            factors[n] = max(1.0, zone.ground.travel(path[n], path[n + 1]) / lasts / zone.speed_m_s)
    return np.where(factors > 1.0 + 1e-9, factors, 1.0)
