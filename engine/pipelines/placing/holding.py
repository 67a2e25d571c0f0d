"""With which holds a part can be taken where it lies, and let go where it belongs.

A hold is a grasp with one of its turns. It is possible at a pose of the part where the hand meets nothing, and the arm reaches.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import TypeVar

import numpy as np

from cellwright.engine.kernels.rigid import inverse
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.grasping import Grasp, ParallelJaws, ThreeFingers
from cellwright.engine.model.solid import Solid
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.ports import CollisionChecker, GeometryBackend, Gripper
from cellwright.engine.stages.geometry.reach.hand import ArmHand
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.geometry.world.scenes import scene_of
from cellwright.engine.stages.grasping.blocks import meet
from cellwright.engine.stages.grasping.grasps import grasps
from cellwright.engine.stages.grasping.placements import volume_and_centre
from cellwright.engine.stages.grasping.three_fingers import three_finger_grasps
from cellwright.kb.model.cell import Body, BodyKind, Placement
from cellwright.kb.model.scene import HandEntry, Scene
from cellwright.kb.model.shapes import Box, PlacedShape, Pose

HAND = "the_hand"  # the body that stands for the gripper; no file can name it so, since a scene's cell is checked for it
TURNS = 24
BACK_M = 0.1  # how far the hand backs off
FLIP_RAD = 0.4  # a joint that turns more between two near poses goes over to another posture


@dataclass(frozen=True, eq=False)
class Holds:
    """All holds of a part: its grasps, and for each hold the number of its grasp (h,) and the hand's pose T_part_hand."""

    solid: Solid
    jaws: Gripper
    grasps: tuple[Grasp, ...]

    @cached_property
    def grasp_of(self) -> tuple[int, ...]:
        """The number of each hold's grasp."""
        return tuple(n for n, each in enumerate(self.grasps) for _ in range(int(each.free.sum())))

    @cached_property
    def poses(self) -> Floats:
        """T_part_hand (h, 4, 4) of each hold."""
        found = [each.T_part_hand[each.free] for each in self.grasps]
        return np.concatenate([np.zeros((0, 4, 4)), *found])

    def clear(self, obstacles: Floats, which: Truths, back_m: tuple[float, ...] = (0.0,)) -> Truths:
        """Which of some holds (h,) meet none of the triangles (m, 3, 3) in the part's frame, also backed off."""
        found = which.copy()
        numbers = np.array(self.grasp_of, dtype=int)
        for n, each in enumerate(self.grasps):
            mine = np.nonzero(found & (numbers == n))[0]
            for back in back_m:
                poses = self.poses[mine].copy()
                poses[:, :3, 3] -= back * poses[:, :3, 2]
                mine = mine[~meet(poses, *self.jaws.blocks(each.opening), obstacles)]
            found[numbers == n] = False
            found[mine] = True
        return found


@cache
def _backend() -> GeometryBackend:
    """The backend, found once."""
    return geometry_backend()


Kind = TypeVar("Kind", ParallelJaws, ThreeFingers)


def jaws_of(scene: Scene) -> ParallelJaws:
    """The parallel jaws of a scene."""
    return _made(ParallelJaws, scene.hand)


def gripper_of(scene: Scene) -> ParallelJaws | ThreeFingers:
    """The gripper of a scene, of whichever kind."""
    return jaws_of(scene) if scene.hand.fingers == 2 else _made(ThreeFingers, scene.hand)


def _made(kind: type[Kind], entry: HandEntry) -> Kind:
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


def holds_of(scene: Scene, solid: Solid) -> Holds:
    """The holds of a part by the scene's gripper."""
    hand = gripper_of(scene)
    volume, centre = volume_and_centre(solid)
    mass = volume * scene.density
    if isinstance(hand, ThreeFingers):
        found = three_finger_grasps(solid, hand, scene.inset_m, mass, centre, TURNS)
    else:
        found = grasps(solid, hand, scene.inset_m, mass, centre, TURNS)
    return Holds(solid, hand, tuple(found))


def with_hand(world: World, scene: Scene, jaws: Gripper, opening: Sequence[float]) -> World:
    """The world with the scene's gripper at the tool point, opened for a grasp, as a body that is checked, too."""
    shapes = tuple(
        PlacedShape(Box(tuple(2 * half)), Pose(tuple(middle)))
        for middle, half in zip(*jaws.blocks(opening), strict=True)
    )
    arm = scene.hand.arm
    body = Body(HAND, BodyKind.TOOL, Placement(f"{arm}.tool"), shapes)
    near = [frozenset((HAND, f"{arm}.{link.name}")) for link in world.cell.arms[arm].arm.links[-2:]]
    cell = replace(
        world.cell, bodies={**world.cell.bodies, HAND: body}, allowed=world.cell.allowed | frozenset(near)
    )
    made = replace(world, cell=cell, placed={**world.placed})
    return made.put(HAND, f"{arm}.tool", np.eye(4))


@dataclass(frozen=True, eq=False)
class Reach:
    """The arm of a scene in a world with a hand, and possibly a part in it: which poses of the hand it reaches."""

    world: World
    arm: str
    allowed: frozenset[frozenset[str]] = frozenset()
    leave_out: tuple[str, ...] = ()

    @cached_property
    def checker(self) -> CollisionChecker:
        """What says what collides."""
        return _backend().checker(scene_of(self.world, self.leave_out, self.allowed))

    @cached_property
    def hand(self) -> ArmHand:
        """The arm's hand."""
        tool = inverse(self.world.pose("world", f"{self.arm}.flange")) @ self.world.pose(
            "world", f"{self.arm}.tool"
        )
        return ArmHand(self.world, self.checker.scene, self.arm, tool)

    def configurations(self, T_world_hand: Floats, near: Floats) -> Floats:
        """The free configurations (m, k) with the hand at a pose (4, 4), the nearest to `near` (k,) first."""
        found = self.hand.reaching(T_world_hand[None], near)[0]
        if not len(found):
            return found
        free: Floats = found[~self.checker.collides(found)]
        return free

    def line(self, T_world_hand: Floats, q: Floats, shift: Floats, steps: int = 6) -> Floats | None:
        """Free configurations (steps + 1, k) from q (k,) on, while the hand moves straight by `shift` (3,); None if it cannot."""
        poses = np.repeat(T_world_hand[None], steps + 1, axis=0)
        poses[:, :3, 3] += np.linspace(0, 1, steps + 1)[:, None] * shift
        return self.through(poses, q)

    def through(self, T_world_hand: Floats, q: Floats) -> Floats | None:
        """Free configurations (m, k) from q (k,) on, at the first of some poses of the hand (m, 4, 4), through the others; None if it cannot."""
        path = [q]
        for pose in T_world_hand[1:]:
            found = self.hand.reaching(pose[None], path[-1])[0]
            if not len(found) or np.abs(found[0] - path[-1]).max() > FLIP_RAD:
                return None
            path.append(found[0])
        return None if self.checker.collides(np.array(path[1:])).any() else np.array(path)
