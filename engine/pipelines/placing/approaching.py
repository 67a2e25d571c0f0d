"""The last way of the hand to a part: straight along its own axis, or round what stands there, in the grasp plane.

The plane is that of `cellwright.engine.stages.grasping.approach`: the hand moves in it across its closing direction, and turns about that.
A way is found outwards, from the grasp to where the hand is free of what stands around. The arm follows it by inverse kinematics.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.rigid import apply, inverse, rotation, transform
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.grasping import Approach, ApproachAnswer, NoApproach
from cellwright.engine.pipelines.placing.answers import Carry
from cellwright.engine.pipelines.placing.holding import BACK_M, Reach
from cellwright.engine.pipelines.placing.task import Coming, Task
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.grasping.approach import GraspPlane, Grid, by_potential, complete
from cellwright.kb.model.scene import Scene

REACH_M = 0.3  # around the grasp, in which obstacles count
APART_M = 0.004  # between the points that stand for surfaces
FAR_M = 0.18  # how far from the grasp a way in the plane begins
TILTS = np.radians([0, -25, 25, -50, 50, -75, 75])  # of the hand there, about the closing direction
STEP_M, STEP_RAD = 0.012, float(np.radians(6))  # between poses that the arm goes through
STARTS = 3  # that are tried
GRID = Grid(reach_m=0.24, step_m=0.004)


@dataclass(frozen=True, eq=False)
class WayOut:
    """From a hold of the part at a pose T_world_part to where the hand is free, in the manner of the task."""

    task: Task
    hold: int
    T_world_part: Floats

    def configurations(self, reach: Reach, q: Floats) -> Floats | None:
        """Free configurations (m, k) from the grasp at q (k,) outwards; None if there is no way."""
        T_world_hand = self.T_world_part @ self.task.holds.poses[self.hold]
        if self.task.manner.coming is Coming.STRAIGHT:
            return reach.line(T_world_hand, q, -BACK_M * T_world_hand[:3, 2])
        if isinstance(self.in_plane, NoApproach):
            return None
        return reach.through(T_world_hand @ poses_of(self.in_plane.poses[::-1]), q)

    def stuck(self) -> str:
        """Why there is no way in the plane; empty where there is one, or none was looked for."""
        answer = None if self.task.manner.coming is Coming.STRAIGHT else self.in_plane
        return answer.reason if isinstance(answer, NoApproach) else ""

    @cached_property
    def in_plane(self) -> ApproachAnswer:
        """The way to the grasp in its plane; else why there is none, from the last start that was tried."""
        holds = self.task.holds
        grasp = holds.grasps[holds.grasp_of[self.hold]]
        plane = _plane(self.task, grasp.opening, holds.poses[self.hold], self.T_world_part)
        starts = np.array([[FAR_M * np.sin(each), -FAR_M * np.cos(each), each] for each in TILTS])
        answer: ApproachAnswer = NoApproach(
            "wherever it could come from, the hand meets something", starts[0]
        )
        for start in starts[plane.free(starts)][:STARTS]:
            potential = self.task.manner.coming is Coming.POTENTIAL
            answer = by_potential(plane, start) if potential else complete(plane, start, GRID)
            if isinstance(answer, Approach):
                return Approach(_shortened(plane, answer.poses))
        return answer


def plane_of(task: Task, carry: Carry) -> GraspPlane:
    """What stands around the grasp with which a carry takes a part."""
    return _plane(task, carry.grasp.opening, carry.T_part_hand, carry.T_world_from)


def way_in(world: World, scene: Scene, carry: Carry) -> Floats:
    """The poses (n, 3) of the hand in the grasp plane on a carry's approach, as y, z and the turn; the last is the grasp."""
    path = next(leg.path for leg in carry.legs if leg.what == "approach")
    back, arm = inverse(carry.T_world_from @ carry.T_part_hand), scene.hand.arm
    first, count = world.first_carriers[arm], len(world.configurations[arm])
    hands = [back @ world.moved(arm, q[first : first + count]).pose("world", f"{arm}.tool") for q in path]
    return np.array([[T[1, 3], T[2, 3], np.arctan2(T[2, 1], T[2, 2])] for T in hands])


def _plane(task: Task, opening: tuple[float, ...], T_part_hand: Floats, T_world_part: Floats) -> GraspPlane:
    """Points on all surfaces near a grasp, of the part itself too, in the frame of the hand at the grasp."""
    corners = np.concatenate([task.obstacles(T_world_part), task.holds.solid.corners])
    local = apply(inverse(T_part_hand), corners.reshape(-1, 3)).reshape(-1, 3, 3)
    near = (local.min(axis=1) < REACH_M).all(axis=1) & (local.max(axis=1) > -REACH_M).all(axis=1)
    points = [_spread(each) for each in local[near]]
    every = np.concatenate([np.zeros((0, 3)), *points])
    every = every[(np.abs(every) < REACH_M).all(axis=1)]
    cells = np.unique(np.rint(every / (APART_M / 2)).astype(np.int64), axis=0, return_index=True)[1]
    return GraspPlane(every[np.sort(cells)], task.holds.jaws, opening)


def _spread(corners: Floats) -> Floats:
    """Points (n, 3) on a triangle (3, 3), or on the line that it is."""
    a, b, c = corners
    sides = [np.linalg.norm(b - a), np.linalg.norm(c - a)]
    counts = [int(np.ceil(side / APART_M)) + 1 for side in sides]
    u, v = (each.ravel() for each in np.meshgrid(*(np.linspace(0, 1, n) for n in counts), indexing="ij"))
    if np.linalg.norm(np.cross(b - a, c - a)) < 1e-12:
        t = np.linspace(0, 1, max(counts))[:, None]
        return np.asarray(a + t * ((b if sides[0] > sides[1] else c) - a))
    inside = u + v <= 1 + 1e-9
    u, v = u[inside, None], v[inside, None]
    return np.asarray(a + u * (b - a) + v * (c - a))


def _shortened(plane: GraspPlane, poses: Floats) -> Floats:
    """Fewer corners of a way (n, 3) in the plane: from each the farthest that can be reached straight."""
    kept, at = [0], 0
    while at < len(poses) - 1:
        ahead = range(len(poses) - 1, at, -1)
        at = next(n for n in ahead if n == at + 1 or plane.free(_between(poses[[at, n]])).all())
        kept.append(at)
    return poses[kept]


def _between(poses: Floats) -> Floats:
    """Poses (m, 3) on a way in the plane, a step apart; turns go the short way."""
    found = [poses[:1]]
    for one, other in pairwise(poses):
        by = other - one
        by[2] = (by[2] + np.pi) % (2 * np.pi) - np.pi
        steps = int(np.ceil(max(np.linalg.norm(by[:2]) / STEP_M, abs(by[2]) / STEP_RAD, 1.0)))
        found.append(one + np.linspace(0, 1, steps + 1)[1:, None] * by)
    return np.concatenate(found)


def poses_of(way: Floats | Sequence[Floats]) -> Floats:
    """Poses T_grasp_hand (m, 4, 4) on a way (n, 3) in the plane, as y, z and the turn."""
    return np.array(
        [
            transform(rotation((1.0, 0.0, 0.0), turn), np.array([0.0, y, z]))
            for y, z, turn in _between(np.array(way))
        ]
    )
