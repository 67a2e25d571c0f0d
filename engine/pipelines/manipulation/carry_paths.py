"""Paths of one carry: approach to the part, grasp, lift, motion over, lowering, and retreat.

The plane is that of `cellwright.engine.stages.grasping.grasp_approach`: the hand moves in it across
its closing direction, and turns about that. A way is found outwards, from the grasp to where the
hand is free of what stands around. The arm follows it by inverse kinematics.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.kernels.rigid import apply, inverse, rotation, transform
from cellwright.engine.model.manipulation_values import ApproachAnswer, HandApproach, NoApproach
from cellwright.engine.model.motion_values import FINEST_M, Moved, PathQuery, Strategy
from cellwright.engine.pipelines.manipulation.part_grasps import (
    HAND_BACK_OFF_M,
    HAND_BODY,
    ArmReach,
    with_hand,
)
from cellwright.engine.pipelines.manipulation.place_answers import Carry, NotPlaced, PathLeg
from cellwright.engine.pipelines.manipulation.workspace import (
    UNKNOWN_BODY,
    HandApproachKind,
    PlaceTask,
)
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.grasping.grasp_approach import (
    ApproachGrid,
    GraspPlane,
    approach_by_potential,
    plan_approach,
)
from cellwright.engine.stages.motion.path_planner import try_path
from cellwright.kb.model.part_scene import Scene

REACH_M = 0.3  # around the grasp, in which obstacles count
APART_M = 0.004  # between the points that stand for surfaces
PLANE_START_M = 0.18  # how far from the grasp a way in the plane begins
# of the hand there, about the closing direction
HAND_TILTS = np.radians([0, -25, 25, -50, 50, -75, 75])
STEP_M, STEP_RAD = 0.012, float(np.radians(6))  # between poses that the arm goes through
MAX_PLANE_STARTS = 3  # that are tried
PLANE_GRID = ApproachGrid(reach_m=0.24, step_m=0.004)


@dataclass(frozen=True, eq=False)
class ApproachPath:
    """From a hold of the part at a pose T_world_part to where the hand is free, in the manner
    of the task.
    """

    task: PlaceTask
    hold: int
    T_world_part: Floats

    def configurations(self, reach: ArmReach, q: Floats) -> Floats | None:
        """Free configurations (m, k) from the grasp at q (k,) outwards; None if there is no way."""
        T_world_hand = self.T_world_part @ self.task.holds.poses[self.hold]
        if self.task.manner.coming is HandApproachKind.STRAIGHT:
            return reach.line(T_world_hand, q, -HAND_BACK_OFF_M * T_world_hand[:3, 2])
        if isinstance(self.in_plane, NoApproach):
            return None
        return reach.through(T_world_hand @ plane_poses(self.in_plane.poses[::-1]), q)

    def stuck(self) -> str:
        """Why there is no way in the plane; empty where there is one, or none was looked for."""
        answer = None if self.task.manner.coming is HandApproachKind.STRAIGHT else self.in_plane
        return answer.reason if isinstance(answer, NoApproach) else ""

    @cached_property
    def in_plane(self) -> ApproachAnswer:
        """The way to the grasp in its plane; else why there is none, from the last start that
        was tried.
        """
        holds = self.task.holds
        grasp = holds.grasps[holds.grasp_of[self.hold]]
        plane = _grasp_plane(self.task, grasp.opening, holds.poses[self.hold], self.T_world_part)
        starts = np.array(
            [
                [PLANE_START_M * np.sin(tilt), -PLANE_START_M * np.cos(tilt), tilt]
                for tilt in HAND_TILTS
            ]
        )
        answer: ApproachAnswer = NoApproach(
            "wherever it could come from, the hand meets something", starts[0]
        )
        for start in starts[plane.free(starts)][:MAX_PLANE_STARTS]:
            potential = self.task.manner.coming is HandApproachKind.POTENTIAL
            answer = (
                approach_by_potential(plane, start)
                if potential
                else plan_approach(plane, start, PLANE_GRID)
            )
            if isinstance(answer, HandApproach):
                return HandApproach(_shorten_path(plane, answer.poses))
        return answer


def plane_of(task: PlaceTask, carry: Carry) -> GraspPlane:
    """What stands around the grasp with which a carry takes a part."""
    return _grasp_plane(task, carry.grasp.opening, carry.T_part_hand, carry.T_world_from)


def way_in(world: GeometricWorld, scene: Scene, carry: Carry) -> Floats:
    """The poses (n, 3) of the hand in the grasp plane on a carry's approach, as y, z and the
    turn; the last is the grasp.
    """
    path = next(leg.path for leg in carry.legs if leg.what == "approach")
    back, arm = inverse(carry.T_world_from @ carry.T_part_hand), scene.hand.arm
    first, count = world.first_carriers[arm], len(world.configurations[arm])
    hands = [
        back @ world.moved(arm, q[first : first + count]).pose("world", f"{arm}.tool") for q in path
    ]
    return np.array([[T[1, 3], T[2, 3], np.arctan2(T[2, 1], T[2, 2])] for T in hands])


def _grasp_plane(
    task: PlaceTask, opening: tuple[float, ...], T_part_hand: Floats, T_world_part: Floats
) -> GraspPlane:
    """Points on all surfaces near a grasp, of the part itself too, in the frame of the hand at
    the grasp.
    """
    corners = np.concatenate([task.obstacles(T_world_part), task.holds.solid.corners])
    local = apply(inverse(T_part_hand), corners.reshape(-1, 3)).reshape(-1, 3, 3)
    near = (local.min(axis=1) < REACH_M).all(axis=1) & (local.max(axis=1) > -REACH_M).all(axis=1)
    points = [_spread_points(triangle) for triangle in local[near]]
    every = np.concatenate([np.zeros((0, 3)), *points])
    every = every[(np.abs(every) < REACH_M).all(axis=1)]
    cells = np.unique(np.rint(every / (APART_M / 2)).astype(np.int64), axis=0, return_index=True)[1]
    return GraspPlane(every[np.sort(cells)], task.holds.jaws, opening)


def _spread_points(corners: Floats) -> Floats:
    """Points (n, 3) on a triangle (3, 3), or on the line that it is."""
    a, b, c = corners
    sides = [np.linalg.norm(b - a), np.linalg.norm(c - a)]
    counts = [int(np.ceil(side / APART_M)) + 1 for side in sides]
    u, v = (
        coordinate.ravel()
        for coordinate in np.meshgrid(*(np.linspace(0, 1, n) for n in counts), indexing="ij")
    )
    if np.linalg.norm(np.cross(b - a, c - a)) < 1e-12:
        t = np.linspace(0, 1, max(counts))[:, None]
        return np.asarray(a + t * ((b if sides[0] > sides[1] else c) - a))
    inside = u + v <= 1 + 1e-9
    u, v = u[inside, None], v[inside, None]
    return np.asarray(a + u * (b - a) + v * (c - a))


def _shorten_path(plane: GraspPlane, poses: Floats) -> Floats:
    """Fewer corners of a way (n, 3) in the plane: from each the farthest that can be reached
    straight.
    """
    corners, at = [0], 0
    while at < len(poses) - 1:
        ahead = range(len(poses) - 1, at, -1)
        at = next(
            n for n in ahead if n == at + 1 or plane.free(_poses_between(poses[[at, n]])).all()
        )
        corners.append(at)
    return poses[corners]


def _poses_between(poses: Floats) -> Floats:
    """Poses (m, 3) on a way in the plane, a step apart; turns go the short way."""
    parts = [poses[:1]]
    for first, second in pairwise(poses):
        by = second - first
        by[2] = (by[2] + np.pi) % (2 * np.pi) - np.pi
        steps = int(np.ceil(max(np.linalg.norm(by[:2]) / STEP_M, abs(by[2]) / STEP_RAD, 1.0)))
        parts.append(first + np.linspace(0, 1, steps + 1)[1:, None] * by)
    return np.concatenate(parts)


def plane_poses(way: Floats | Sequence[Floats]) -> Floats:
    """Poses T_grasp_hand (m, 4, 4) on a way (n, 3) in the plane, as y, z and the turn."""
    return np.array(
        [
            transform(rotation((1.0, 0.0, 0.0), turn), np.array([0.0, y, z]))
            for y, z, turn in _poses_between(np.array(way))
        ]
    )


LIFT_M = 0.08
MAX_MOTION_CONFIGURATIONS = 20_000  # configurations that the search for one motion looks at
# from everything, on motions between: servos lag a little, and a part may sit askew in the hand
MOTION_MARGIN_M = 0.005
MARGIN_BUDGET = 5_000  # configurations that a search with the margin looks at
MAX_END_CONFIGURATIONS = 3  # configurations that are tried for an end


def carry_part(
    task: PlaceTask, hold: int, poses: tuple[Floats, Floats], near: Floats, rest: str
) -> Carry | NotPlaced:
    """Take the part with a hold at one pose, and let it go at another, from a configuration
    (k,) on.
    """
    T_from, T_to = poses
    grasp, T = task.holds.grasps[task.holds.grasp_of[hold]], task.holds.poses[hold]
    empty, above, full, free, after = _carry_reaches(task, grasp.opening, T, poses)
    out = ApproachPath(task, hold, T_from), ApproachPath(task, hold, T_to)
    up, strategy = np.array([0.0, 0.0, LIFT_M]), task.manner.strategy
    for q in end_configurations(empty, T_from @ T, near):
        taken = out[0].configurations(empty, q)
        lifted = full.line(T_from @ T, q, up)
        if taken is None or lifted is None:
            continue
        for end in end_configurations(after, T_to @ T, q):
            lowered = full.line(T_to @ T, end, up)
            away = out[1].configurations(after, end)
            if lowered is None or away is None:
                continue
            first = gross_motion(above, near, taken[-1], strategy)
            second = gross_motion(free, lifted[-1], lowered[-1], strategy)
            if first is None or second is None:
                continue
            legs = (
                PathLeg("to the part", first.path, False, first.proved),
                straight_leg("approach", taken[::-1], False, empty),
                straight_leg("lift", lifted, True, full),
                PathLeg("carry", second.path, True, second.proved),
                straight_leg("lower", lowered[::-1], True, full),
                straight_leg("withdraw", away, False, after),
            )
            return Carry(grasp, T, T_from, T_to, rest, legs)
    hint = "move what stands between, or the table where parts are taken anew"
    stuck = " ".join(dict.fromkeys(why for leg in out if (why := leg.stuck())))
    reason = f"no motion carries {task.part} with the grasps that are possible"
    return NotPlaced("motion", f"{reason}; in the grasp plane {stuck}" if stuck else reason, hint)


def _carry_reaches(
    task: PlaceTask, opening: Sequence[float], T_part_hand: Floats, poses: tuple[Floats, Floats]
) -> tuple[ArmReach, ...]:
    """What the arm meets with the part where it lies (near, far), in the hand (near, far), and put
    down (near).

    It keeps away from what is only seen. Near what is taken or put down, the hand and the part may
    pass through the blocks that stand for that: they are coarse, and holds were compared with all
    that is seen.
    """
    crowded, arm = (
        with_hand(task.crowded, task.scene, task.holds.jaws, opening),
        task.scene.hand.arm,
    )
    (T_from, T_to), T_hand_part = poses, inverse(T_part_hand)
    with_part = crowded.put(task.part, f"{arm}.tool", T_hand_part)
    near = through_unknown(task)
    return (
        ArmReach(crowded.put(task.part, "world", T_from), arm, near),
        ArmReach(crowded.put(task.part, "world", T_from), arm),
        ArmReach(with_part, arm, may_touch(task) | near),
        ArmReach(with_part, arm, frozenset([frozenset((HAND_BODY, task.part))])),
        ArmReach(crowded.put(task.part, "world", T_to), arm, near),
    )


def through_unknown(task: PlaceTask) -> frozenset[frozenset[str]]:
    """The hand and the part may pass through the blocks for what is only seen."""
    return frozenset(frozenset((body, UNKNOWN_BODY)) for body in (HAND_BODY, task.part))


def straight_leg(what: str, path: Floats, carries: bool, reach: ArmReach) -> PathLeg:
    """A straight line of the hand, and whether it is free all along."""
    proof = PlanningScene(reach.checker).proof(0.0, FINEST_M)
    return PathLeg(what, path, carries, proved(proof, np.ascontiguousarray(path)) == len(path) - 1)


def may_touch(task: PlaceTask) -> frozenset[frozenset[str]]:
    """While it is lifted and lowered, the part may touch what it lies on, and the hand that
    holds it.
    """
    other_bodies = [name for name in task.world.cell.bodies if name != task.part]
    return frozenset(frozenset((task.part, name)) for name in [*other_bodies, HAND_BODY])


def end_configurations(reach: ArmReach, T_world_hand: Floats, near: Floats) -> Floats:
    """Some free configurations (m, k) with the hand at a pose, the nearest first."""
    return reach.configurations(T_world_hand, near)[:MAX_END_CONFIGURATIONS]


def gross_motion(
    reach: ArmReach, start: Floats, goal: Floats, strategy: Strategy = Strategy.CONNECT
) -> Moved | None:
    """A motion between two configurations (k,) that keeps a margin where there is room for it;
    None if none is found at all.
    """
    own, ground = reach.hand.own, PlanningScene(reach.checker)
    query = PathQuery(
        start,
        goal[None],
        budget=MAX_MOTION_CONFIGURATIONS,
        moving=tuple(range(own.start, own.stop)),
        strategy=strategy,
    )
    wide = try_path(
        ground, replace(query, margin_m=MOTION_MARGIN_M, budget=MARGIN_BUDGET), reach.hand
    )
    if isinstance(wide, Moved) and wide.proved:
        return wide
    motion = try_path(ground, query, reach.hand)
    return motion if isinstance(motion, Moved) else None
