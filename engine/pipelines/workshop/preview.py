"""What a plan will look like: the cell from moment to moment, with a hand that opens and closes, before anything moves."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.rigid import inverse, translation
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.moves import Leg as Move
from cellwright.engine.model.moves import LegKind
from cellwright.engine.pipelines.moves.film import Shot
from cellwright.engine.pipelines.moves.hands import corners_s
from cellwright.engine.pipelines.placing.answers import Carry, Placed
from cellwright.engine.pipelines.placing.holding import HAND, gripper_of
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import Body, BodyKind, Cell, Placement
from cellwright.kb.model.scene import Scene
from cellwright.kb.model.shapes import Box, PlacedShape

EVERY_S = 0.1
CLOSES_S = 0.7
FACTOR = 0.3  # of the full speed


def shots(scene: Scene, part: str, found: Placed) -> Iterator[Shot]:
    """The cell while a part is placed."""
    world = World.of(_with_blocks(scene)).put(part, "world", found.T_world_part)
    hand, now = scene.hand.arm, 0.0
    first = world.first_carriers[hand]
    for carry in found.carries:
        world = _opened(world, scene, carry.grasp.opening)
        for leg in carry.legs:
            own = leg.path[:, first : first + len(world.configurations[hand])]
            for at, q in _followed(world, hand, own):
                yield Shot(now + at, world.moved(hand, q))
            now, world = now + at, world.moved(hand, own[-1])
            if leg.what in ("approach", "lower"):
                now += CLOSES_S
                world = _taken(world, hand, part, carry, leg.what == "approach")
                yield Shot(now, world)


def _followed(world: World, arm: str, path: Floats) -> Iterator[tuple[float, Floats]]:
    """When an arm is where on a path (m, k), at even times from 0 to the end."""
    leg = Move(LegKind.WAY, arm, path, corners_s(world.cell.arms[arm].arm, path, FACTOR), True)
    count = max(1, int(np.ceil(leg.seconds / EVERY_S)))
    for n in range(count + 1):
        at = leg.seconds * n / count
        yield at, leg.at(at)


def _taken(world: World, arm: str, part: str, carry: Carry, takes: bool) -> World:
    """The part in the hand, or put down."""
    if takes:
        return world.put(part, f"{arm}.tool", inverse(carry.T_part_hand))
    return world.put(part, "world", carry.T_world_to)


def _with_blocks(scene: Scene) -> Cell:
    """The scene's cell with the hand's blocks as bodies at the tool point."""
    arm, gripper = scene.hand.arm, gripper_of(scene)
    _, halves = gripper.blocks((0.0,) * 5)
    blocks = {
        name: Body(name, BodyKind.TOOL, Placement(f"{arm}.tool"), (PlacedShape(Box(tuple(2 * half))),))
        for n, half in enumerate(halves)
        for name in [f"{HAND}_{n}"]
    }
    return replace(scene.cell, bodies={**scene.cell.bodies, **blocks})


def _opened(world: World, scene: Scene, opening: tuple[float, ...]) -> World:
    """The hand opened for a grasp."""
    middles, _ = gripper_of(scene).blocks(opening)
    for n, middle in enumerate(middles):
        world = world.put(f"{HAND}_{n}", f"{scene.hand.arm}.tool", translation(*middle))
    return world
