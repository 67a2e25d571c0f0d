"""Hands in MuJoCo: parallel jaws that mirror each other, and three fingers that close singly.

A hand has drives that its fingers follow, each with a force; what it presses on decides where they
stop. The last of its bodies to be told about is the palm, `HAND`, with the cross-piece and the
sensor.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.manipulation_values import ParallelJaws, ThreeFingers
from cellwright.engine.pipelines.manipulation.part_grasps import HAND_BODY, gripper_of
from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_stage import MujocoStage
from cellwright.kb.model.body_shapes import Box, Cylinder, PlacedShape, Pose
from cellwright.kb.model.cell_model import Body, BodyKind, Guide, JointKind, Placement
from cellwright.kb.model.part_scene import Scene

LEFT, RIGHT = f"{HAND_BODY}_left", f"{HAND_BODY}_right"
ONE, TWO, THREE = (f"{HAND_BODY}_finger_{n}" for n in (1, 2, 3))
KNUCKLE_JOINTS = (f"{HAND_BODY}_knuckle_2", f"{HAND_BODY}_knuckle_3")
FINGER_KG, PALM_KG = 0.1, 0.5
CLOSE_S, SETTLES_S = 0.7, 0.3  # until jaws have opened or closed, and until three fingers rest
STIFF_N_M, DAMPED = 60_000.0, 700.0  # N/m and N s/m: worm gears hardly give way
SPEED_M_S, LOOK_S = 0.015, 0.01  # of fingers that close
LOOKS, STOPPED_M = 8, 0.0002  # a finger that went less far in so many looks has met something
STIFF_NM_RAD, DAMPED_TURNING = 2_000.0, 40.0  # of the knuckles
STRONG_FACTOR = 3.0  # times the force of a pad: what a finger bears that the others press against
MISSED_M = 0.002  # a finger that still closes so far beyond its place has met nothing there


class MujocoHand(Protocol):
    """What of a gripper is in physics, and what it is told to do.

    Times pass in the shop, not here.
    """

    fingers: tuple[str, ...]

    def bodies(self, at: Placement) -> Iterator[Body]:
        """The palm, and all that moves on it, at a place on an arm."""
        ...

    def prepare(self, stage: MujocoStage) -> None:
        """Give the drives their forces."""
        ...

    def open_for(self, stage: MujocoStage, opening: Sequence[float]) -> None:
        """Aim at being open for a grasp (`Grasp.opening`), with the clearance beside it."""
        ...

    def closing(self, stage: MujocoStage) -> Iterator[float]:
        """Close on what is between the fingers: each item is for how long (s) to go on before
        the next aim.
        """
        ...

    def width_m(self, stage: MujocoStage) -> float:
        """How far apart the fingers are, as their sensors read it."""
        ...

    @property
    def wide(self) -> tuple[float, ...]:
        """The opening of a hand that lets go of whatever it holds."""
        ...


def scene_hand(scene: Scene) -> MujocoHand:
    """The hand of a scene."""
    gripper = gripper_of(scene)
    return TwoJaws(gripper) if isinstance(gripper, ParallelJaws) else ThreeClosing(gripper)


@dataclass
class TwoJaws:
    """Parallel jaws: the one goes as far as the other, so what they hold is in the middle."""

    jaws: ParallelJaws
    fingers: tuple[str, ...] = (LEFT, RIGHT)

    @property
    def wide(self) -> tuple[float, ...]:
        """Open as far as can be."""
        return (self.jaws.opening_m,)

    def bodies(self, at: Placement) -> Iterator[Body]:
        """The palm and two blocks that slide."""
        left, right, *palm = _box_shapes(self.jaws.blocks(self.wide))
        yield Body(HAND_BODY, BodyKind.TOOL, at, tuple(palm), mass_kg=PALM_KG)
        most = self.jaws.opening_m / 2 + self.jaws.clearance_m
        for name, block, along in ((LEFT, left, 1.0), (RIGHT, right, -1.0)):
            follows = "" if name == LEFT else LEFT
            guide = Guide(JointKind.PRISMATIC, (along, 0.0, 0.0), 0.0, most, follows)
            yield _finger_body(name, at, block, guide, self.jaws.friction)

    def prepare(self, stage: MujocoStage) -> None:
        """Both press as hard as a pad may."""
        for name in self.fingers:
            _press_with(stage, name, self.jaws.force_n)

    def open_for(self, stage: MujocoStage, opening: Sequence[float]) -> None:
        """Both jaws aim at half of what is left of the width."""
        self._aim(stage, self.jaws.opening_m / 2 - opening[0] / 2)

    def closing(self, stage: MujocoStage) -> Iterator[float]:
        """Both jaws aim at each other."""
        self._aim(stage, self.jaws.opening_m / 2 + self.jaws.clearance_m)
        yield CLOSE_S

    def width_m(self, stage: MujocoStage) -> float:
        """How far the jaws are apart."""
        return self.jaws.opening_m + 2 * self.jaws.clearance_m - 2 * stage.value(LEFT)

    def _aim(self, stage: MujocoStage, way_m: float) -> None:
        for name in self.fingers:
            stage.aim(name, max(way_m, 0.0))


@dataclass
class ThreeClosing:
    """Three fingers: the first goes to its place and stays, the others press what is between them
    against it.

    The two others share the force so that it balances along the closing direction. When they have
    met the part, they keep their places by springs about as stiff as gears, which press as hard as
    before.
    """

    hand: ThreeFingers
    fingers: tuple[str, ...] = (ONE, TWO, THREE)
    opening: tuple[float, ...] = ()

    @property
    def wide(self) -> tuple[float, ...]:
        """Every finger as far out as can be, the spread as it is."""
        most = self.hand.opening_m
        return (2 * most, most, most, most, self.opening[4] if self.opening else 0.0)

    def bodies(self, at: Placement) -> Iterator[Body]:
        """The palm, the knuckles on which two fingers spread, and three round fingers that
        slide outwards on their ways.
        """
        hand = self.hand
        middles, halves = hand.blocks((0.0, 0.0, 0.0, 0.0, 0.0))
        yield Body(
            HAND_BODY,
            BodyKind.TOOL,
            at,
            tuple(_box_shapes((middles[3:], halves[3:]))),
            mass_kg=PALM_KG,
        )
        begins, _ = hand.ways(0.0)
        spread = max(hand.spreads_rad)
        turned = Pose((0.0, 0.0, 0.0), (0.0, 0.0, np.pi))
        places = [Placement(HAND_BODY, turned)]
        for name, begin, sense in zip(KNUCKLE_JOINTS, begins[1:], (1.0, -1.0), strict=True):
            guide = Guide(JointKind.REVOLUTE, (0.0, 0.0, sense), 0.0, spread)
            yield Body(
                name,
                BodyKind.TOOL,
                Placement(HAND_BODY, Pose((*begin.tolist(), 0.0))),
                (),
                guide=guide,
                mass_kg=FINGER_KG,
            )
            places.append(Placement(name))
        most = hand.opening_m + hand.clearance_m
        out = most + hand.thick_m / 2
        shape = Cylinder(hand.thick_m / 2, hand.finger_m)
        block = PlacedShape(shape, Pose((out, 0.0, hand.pad_m / 2 - hand.finger_m / 2)))
        for name, place in zip(self.fingers, places, strict=True):
            guide = Guide(JointKind.PRISMATIC, (-1.0, 0.0, 0.0), 0.0, most + MISSED_M)
            yield _finger_body(name, place, block, guide, hand.friction)

    def prepare(self, stage: MujocoStage) -> None:
        """The drives are gears."""
        for name in self.fingers:
            _gear_drive(stage, name, STIFF_N_M, DAMPED)
            _press_with(stage, name, STRONG_FACTOR * self.hand.force_n)
        for name in KNUCKLE_JOINTS:
            _gear_drive(stage, name, STIFF_NM_RAD, DAMPED_TURNING)
            _press_with(stage, name, STRONG_FACTOR * self.hand.force_n * self.hand.opening_m)

    def open_for(self, stage: MujocoStage, opening: Sequence[float]) -> None:
        """Each finger aims at its way, and the knuckles at the spread."""
        self.opening = tuple(opening)
        for name in self.fingers:
            _press_with(stage, name, STRONG_FACTOR * self.hand.force_n)
        for name, opening_m in zip(self.fingers, opening[1:4], strict=True):
            stage.aim(name, max(self.hand.opening_m - opening_m, 0.0))
        for name in KNUCKLE_JOINTS:
            stage.aim(name, opening[4])

    def closing(self, stage: MujocoStage) -> Iterator[float]:
        """The first finger goes to its place, then the others until they meet something; then
        all press.
        """
        first, *other_fingers = self.fingers
        most = self.hand.opening_m + self.hand.clearance_m
        place = most - (self.opening[1] if self.opening else 0.0)
        share = self.hand.force_n / (2 * np.cos(self.opening[4] if self.opening else 0.0))
        yield from self._led(stage, (first,), place, self.hand.force_n)
        for name in other_fingers:
            _press_with(stage, name, share)
        yield from self._led(stage, other_fingers, most + MISSED_M, share)
        stage.aim(first, place + self.hand.force_n / STIFF_N_M)
        yield SETTLES_S
        for name in other_fingers:
            met = stage.value(name)
            _press_with(stage, name, STRONG_FACTOR * self.hand.force_n)
            stage.aim(name, met + share / STIFF_N_M)
        yield SETTLES_S

    def _led(
        self, stage: MujocoStage, fingers: Sequence[str], goal: float, force_n: float
    ) -> Iterator[float]:
        """Fingers go on slowly until they are at a goal or have met something.

        Their aim is never farther ahead than they press.
        """
        ahead, before = 2 * force_n / STIFF_N_M, {name: -np.inf for name in fingers}
        going = set(fingers)
        while going:
            for name in sorted(going):
                at = stage.value(name)
                if at - before[name] < STOPPED_M or goal - at < STOPPED_M:
                    going.discard(name)
                before[name] = at
            for _ in range(LOOKS):
                for name in fingers:
                    at = stage.value(name)
                    target = float(stage.data.ctrl[stage.model.actuator(name).id])
                    stage.aim(name, min(target + SPEED_M_S * LOOK_S, at + ahead, goal))
                yield LOOK_S

    def width_m(self, stage: MujocoStage) -> float:
        """The way of the first finger, and the longer one of the others."""
        most = self.hand.opening_m + self.hand.clearance_m
        first, *other_fingers = (most - stage.value(name) for name in self.fingers)
        return first + max(other_fingers)


def _box_shapes(blocks: tuple[Floats, Floats]) -> list[PlacedShape]:
    return [
        PlacedShape(Box(tuple(2 * half)), Pose(tuple(middle)))
        for middle, half in zip(*blocks, strict=True)
    ]


def _finger_body(
    name: str, at: Placement, shape: PlacedShape, guide: Guide, friction: float
) -> Body:
    return Body(
        name, BodyKind.TOOL, at, (shape,), guide=guide, mass_kg=FINGER_KG, friction=friction
    )


def _gear_drive(stage: MujocoStage, name: str, stiff: float, damped: float) -> None:
    number = stage.model.actuator(name).id
    stage.model.actuator_gainprm[number, 0] = stiff
    stage.model.actuator_biasprm[number, 1:3] = -stiff, -damped


def _press_with(stage: MujocoStage, name: str, force_n: float) -> None:
    """How hard a drive presses at most."""
    stage.model.actuator_forcerange[stage.model.actuator(name).id] = -force_n, force_n
