"""Views of a placement before anything moves: its regrasp graph, and the film of its carries."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.rigid import inverse, translation
from cellwright.engine.model.motion_values import LegKind
from cellwright.engine.model.motion_values import StepLeg as Move
from cellwright.engine.pipelines.manipulation.part_grasps import HAND_BODY, gripper_of
from cellwright.engine.pipelines.manipulation.place_answers import Carry, Placed
from cellwright.engine.pipelines.manipulation.regrasp_paths import (
    possible_holds,
    serving_holds,
    table_rests,
)
from cellwright.engine.pipelines.manipulation.workspace import PlaceTask
from cellwright.engine.pipelines.motion.arm_progress import corners_s
from cellwright.engine.pipelines.motion.step_film import FilmShot
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.body_shapes import Box, PlacedShape
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, Placement
from cellwright.kb.model.part_scene import Scene

START, GOAL = "start", "goal"


@dataclass(frozen=True, slots=True)
class RegraspGraph:
    """`holds` counts the holds that serve at the start, at the goal, and where the part lies on a
    facet at its best turn there.

    `ways` counts the holds that serve at both of two, and `taken` are the places of the plan from
    the start to the goal. Whether the arm reaches is asked at the start and at the goal only.
    """

    holds: Mapping[str, int]
    ways: Mapping[tuple[str, str], int]
    taken: tuple[str, ...]


def regrasp_graph(task: PlaceTask, placed: Placed) -> RegraspGraph:
    """The graph of a task, and the way that its plan takes through it."""
    lying = list(table_rests(task))
    names = [START, *(rest.facet for rest, _ in lying), GOAL]
    table = serving_holds(task, [T for _, T in lying])
    serves = np.column_stack(
        [possible_holds(task, task.T_start), table, possible_holds(task, task.T_goal)]
    )
    holds = {name: int(serves[:, _places_named(names, name)].sum(axis=0).max()) for name in names}
    common = serves.astype(np.int64).T @ serves.astype(np.int64)
    ways = {
        (start, end): int(
            common[np.ix_(_places_named(names, start), _places_named(names, end))].max()
        )
        for start, end in combinations(dict.fromkeys(names), 2)
    }
    taken = (START, *(carry.rest.removeprefix("on ") for carry in placed.carries))
    return RegraspGraph(holds, {pair: count for pair, count in ways.items() if count}, taken)


def _places_named(names: list[str], name: str) -> Truths:
    truths: Truths = np.array([place == name for place in names])
    return truths


EVERY_S = 0.1
CLOSES_S = 0.7
SPEED_SHARE = 0.3  # of the full speed


def film_shots(scene: Scene, part: str, placed: Placed) -> Iterator[FilmShot]:
    """The cell while a part is placed."""
    world = GeometricWorld.of(_with_blocks(scene)).put(part, "world", placed.T_world_part)
    hand, now = scene.hand.arm, 0.0
    first = world.first_carriers[hand]
    for carry in placed.carries:
        world = _open_hand(world, scene, carry.grasp.opening)
        for leg in carry.legs:
            own = leg.path[:, first : first + len(world.configurations[hand])]
            for at, q in _follow_path(world, hand, own):
                yield FilmShot(now + at, world.moved(hand, q))
            now, world = now + at, world.moved(hand, own[-1])
            if leg.what in ("approach", "lower"):
                now += CLOSES_S
                world = _world_with_part(world, hand, part, carry, leg.what == "approach")
                yield FilmShot(now, world)


def _follow_path(world: GeometricWorld, arm: str, path: Floats) -> Iterator[tuple[float, Floats]]:
    """When an arm is where on a path (m, k), at even times from 0 to the end."""
    leg = Move(LegKind.WAY, arm, path, corners_s(world.cell.arms[arm].arm, path, SPEED_SHARE), True)
    count = max(1, int(np.ceil(leg.seconds / EVERY_S)))
    for n in range(count + 1):
        at = leg.seconds * n / count
        yield at, leg.at(at)


def _world_with_part(
    world: GeometricWorld, arm: str, part: str, carry: Carry, takes: bool
) -> GeometricWorld:
    """The part in the hand, or put down."""
    if takes:
        return world.put(part, f"{arm}.tool", inverse(carry.T_part_hand))
    return world.put(part, "world", carry.T_world_to)


def _with_blocks(scene: Scene) -> Cell:
    """The scene's cell with the hand's blocks as bodies at the tool point."""
    arm, gripper = scene.hand.arm, gripper_of(scene)
    _, halves = gripper.blocks((0.0,) * 5)
    blocks = {
        name: Body(
            name, BodyKind.TOOL, Placement(f"{arm}.tool"), (PlacedShape(Box(tuple(2 * half))),)
        )
        for n, half in enumerate(halves)
        for name in [f"{HAND_BODY}_{n}"]
    }
    return replace(scene.cell, bodies={**scene.cell.bodies, **blocks})


def _open_hand(world: GeometricWorld, scene: Scene, opening: tuple[float, ...]) -> GeometricWorld:
    """The hand opened for a grasp."""
    middles, _ = gripper_of(scene).blocks(opening)
    for n, middle in enumerate(middles):
        world = world.put(f"{HAND_BODY}_{n}", f"{scene.hand.arm}.tool", translation(*middle))
    return world
