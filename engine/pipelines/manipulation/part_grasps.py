"""Grasps of a part: with which holds it can be taken where it lies and let go at its goal.

A hold is a grasp with one of its turns. It is possible at a pose of the part where the hand meets
nothing, and the arm reaches.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import TypeVar

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.rigid import inverse
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.manipulation_values import Grasp, ParallelJaws, ThreeFingers
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.ports import CollisionChecker, GeometryBackend, Gripper
from cellwright.engine.stages.geometry.reach.arm_hand import ArmHand
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.grasping.grasp_synthesis import (
    blocks_meet,
    jaw_grasps,
    three_finger_grasps,
)
from cellwright.engine.stages.grasping.stable_placements import volume_and_centre
from cellwright.kb.model.body_shapes import Box, PlacedShape, Pose
from cellwright.kb.model.cell_model import Body, BodyKind, Placement
from cellwright.kb.model.part_scene import HandEntry, Scene

# the body that stands for the gripper; no file can name it so, since a scene's cell is checked for
# it
HAND_BODY = "the_hand"
HOLD_TURNS = 24
HAND_BACK_OFF_M = 0.1  # how far the hand backs off
FLIP_RAD = 0.4  # a joint that turns more between two near poses goes over to another posture


@dataclass(frozen=True, eq=False)
class PartHolds:
    """All holds of a part: its grasps, and for each hold the number of its grasp (h,) and the
    hand's pose T_part_hand.
    """

    solid: Solid
    jaws: Gripper
    grasps: tuple[Grasp, ...]

    @cached_property
    def grasp_of(self) -> tuple[int, ...]:
        """The number of each hold's grasp."""
        return tuple(n for n, grasp in enumerate(self.grasps) for _ in range(int(grasp.free.sum())))

    @cached_property
    def poses(self) -> Floats:
        """T_part_hand (h, 4, 4) of each hold."""
        hold_poses = [grasp.T_part_hand[grasp.free] for grasp in self.grasps]
        return np.concatenate([np.zeros((0, 4, 4)), *hold_poses])

    def clear(self, obstacles: Floats, which: Truths, back_m: tuple[float, ...] = (0.0,)) -> Truths:
        """Which of some holds (h,) meet none of the triangles (m, 3, 3) in the part's frame,
        also backed off.
        """
        clear_holds = which.copy()
        numbers = np.array(self.grasp_of, dtype=int)
        for n, grasp in enumerate(self.grasps):
            mine = np.nonzero(clear_holds & (numbers == n))[0]
            for back in back_m:
                poses = self.poses[mine].copy()
                poses[:, :3, 3] -= back * poses[:, :3, 2]
                mine = mine[~blocks_meet(poses, *self.jaws.blocks(grasp.opening), obstacles)]
            clear_holds[numbers == n] = False
            clear_holds[mine] = True
        return clear_holds


@cache
def _hand_backend() -> GeometryBackend:
    """The backend, found once."""
    return geometry_backend()


Kind = TypeVar("Kind", ParallelJaws, ThreeFingers)


def jaws_of(scene: Scene) -> ParallelJaws:
    """The parallel jaws of a scene."""
    return _make_hand(ParallelJaws, scene.hand)


def gripper_of(scene: Scene) -> ParallelJaws | ThreeFingers:
    """The gripper of a scene, of whichever kind."""
    return jaws_of(scene) if scene.hand.fingers == 2 else _make_hand(ThreeFingers, scene.hand)


def _make_hand(kind: type[Kind], entry: HandEntry) -> Kind:
    return kind(
        entry.opening_m,
        entry.pad_m,
        entry.finger_m,
        entry.thick_m,
        entry.cross_m,
        entry.sensor_m,
        entry.friction,
        entry.force_n,
    )


def part_holds(scene: Scene, solid: Solid) -> PartHolds:
    """The holds of a part by the scene's gripper."""
    hand = gripper_of(scene)
    volume, centre = volume_and_centre(solid)
    mass = volume * scene.density
    if isinstance(hand, ThreeFingers):
        grasps_found = three_finger_grasps(solid, hand, scene.inset_m, mass, centre, HOLD_TURNS)
    else:
        grasps_found = jaw_grasps(solid, hand, scene.inset_m, mass, centre, HOLD_TURNS)
    return PartHolds(solid, hand, tuple(grasps_found))


def with_hand(
    world: GeometricWorld, scene: Scene, jaws: Gripper, opening: Sequence[float]
) -> GeometricWorld:
    """The world with the scene's gripper at the tool point, opened for a grasp, as a body that
    is checked, too.
    """
    shapes = tuple(
        PlacedShape(Box(tuple(2 * half)), Pose(tuple(middle)))
        for middle, half in zip(*jaws.blocks(opening), strict=True)
    )
    arm = scene.hand.arm
    body = Body(HAND_BODY, BodyKind.TOOL, Placement(f"{arm}.tool"), shapes)
    near = [
        frozenset((HAND_BODY, f"{arm}.{link.name}")) for link in world.cell.arms[arm].arm.links[-2:]
    ]
    cell = replace(
        world.cell,
        bodies={**world.cell.bodies, HAND_BODY: body},
        allowed=world.cell.allowed | frozenset(near),
    )
    with_jaws = replace(world, cell=cell, placed={**world.placed})
    return with_jaws.put(HAND_BODY, f"{arm}.tool", np.eye(4))


@dataclass(frozen=True, eq=False)
class ArmReach:
    """The arm of a scene in a world with a hand, and possibly a part in it: which poses of the
    hand it reaches.
    """

    world: GeometricWorld
    arm: str
    allowed: frozenset[frozenset[str]] = frozenset()
    leave_out: tuple[str, ...] = ()

    @cached_property
    def checker(self) -> CollisionChecker:
        """What says what collides."""
        return _hand_backend().checker(collision_scene_of(self.world, self.leave_out, self.allowed))

    @cached_property
    def hand(self) -> ArmHand:
        """The arm's hand."""
        tool = inverse(self.world.pose("world", f"{self.arm}.flange")) @ self.world.pose(
            "world", f"{self.arm}.tool"
        )
        return ArmHand(self.world, self.checker.scene, self.arm, tool)

    def configurations(self, T_world_hand: Floats, near: Floats) -> Floats:
        """The free configurations (m, k) with the hand at a pose (4, 4), the nearest to `near`
        (k,) first.
        """
        reached = self.hand.reaching(T_world_hand[None], near)[0]
        if not len(reached):
            return reached
        free: Floats = reached[~self.checker.collides(reached)]
        return free

    def line(self, T_world_hand: Floats, q: Floats, shift: Floats, steps: int = 6) -> Floats | None:
        """Free configurations (steps + 1, k) from q (k,) on, while the hand moves straight by
        `shift` (3,); None if it cannot.
        """
        poses = np.repeat(T_world_hand[None], steps + 1, axis=0)
        poses[:, :3, 3] += np.linspace(0, 1, steps + 1)[:, None] * shift
        return self.through(poses, q)

    def through(self, T_world_hand: Floats, q: Floats) -> Floats | None:
        """Free configurations (m, k) from q (k,) on, at the first of some poses of the hand (m,
        4, 4), through the others; None if it cannot.
        """
        path = [q]
        for pose in T_world_hand[1:]:
            reached = self.hand.reaching(pose[None], path[-1])[0]
            if not len(reached) or np.abs(reached[0] - path[-1]).max() > FLIP_RAD:
                return None
            path.append(reached[0])
        return None if self.checker.collides(np.array(path[1:])).any() else np.array(path)
