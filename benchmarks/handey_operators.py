"""Scripted operators: half of them bring a wheel to its goal, the others spoil that on the way,
each in one of three ways.
"""

from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply, rotation, transform
from cellwright.engine.pipelines.manipulation.arm_monitoring import (
    BodyShifted,
    Event,
    JawsAct,
    OperatorAct,
    WatchedWorld,
)
from cellwright.engine.pipelines.manipulation.part_grasps import ArmReach, with_hand
from cellwright.engine.pipelines.manipulation.place_answers import Placed
from cellwright.engine.pipelines.manipulation.place_operation import place_part
from cellwright.engine.pipelines.manipulation.regrasp_paths import possible_holds
from cellwright.engine.pipelines.manipulation.scene_camera import look_for_parts
from cellwright.engine.pipelines.manipulation.workspace import AssemblySite
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.facet_solids import solid_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.grasping.stable_placements import stable_placements, volume_and_centre
from cellwright.kb.loader.scene_file import load_scene
from cellwright.kb.model.cell_model import Placement
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.targets import BUNDLED_DOMAINS

SCENE = load_scene(BUNDLED_DOMAINS / "handey" / "scenes" / "turning.yaml")
WHEEL = solid_of(SCENE.cell.bodies["wheel"])
RESTS = {
    each.facet: each.T_table_part for each in stable_placements(WHEEL, volume_and_centre(WHEEL)[1])
}
SPOILS = ("a grasp that cannot place", "laid down wrongly", "something on the goal")


@dataclass(frozen=True)
class Script:
    """The world at first, and what happens then; `spoils` says how it is spoilt (empty: it is
    not).
    """

    state: WatchedWorld
    events: tuple[Event, ...]
    spoils: str


def script(seed: int) -> Script:
    """An operator's run; every other seed spoils."""
    random = np.random.default_rng(seed)
    while True:
        scene = lying(random, str(random.choice(["south", "south_east"])))
        found, _ = place_part(scene, "wheel", "base", seed)
        if isinstance(found, Placed) and len(found.carries) == 1:
            break
    world = GeometricWorld.of(scene.cell)
    site = AssemblySite.of(
        scene, world, look_for_parts(scene, world, (), seed), {"wheel": found.T_world_part}
    )
    state = WatchedWorld(site, "wheel", found.T_world_goal, found.T_world_part)
    legs = found.carries[0].legs
    taken, let_go = (
        OperatorAct(legs[1].path[-1], JawsAct.CLOSE),
        OperatorAct(legs[4].path[-1], JawsAct.OPEN),
    )
    above = OperatorAct(legs[3].path[len(legs[3].path) // 2])
    spoils = SPOILS[seed // 2 % 3] if seed % 2 else ""
    way: tuple[Event, ...] = (taken, above, let_go)
    if spoils == "a grasp that cannot place":
        q = _useless(state)
        spoils, way = (SPOILS[1], way) if q is None else (spoils, (OperatorAct(q, JawsAct.CLOSE),))
    if spoils == "laid down wrongly":
        way = (taken, above, BodyShifted("wheel", _table(random) @ RESTS["north"]))
    if spoils == "something on the goal":
        at = apply(state.T_goal, volume_and_centre(WHEEL)[1][None])[0]
        at += [random.uniform(-0.02, 0.02), random.uniform(-0.02, 0.02), 0.0]
        way = (
            taken,
            BodyShifted(
                "brick", transform(np.eye(3), np.array([*at[:2], state.T_goal[2, 3] + 0.04]))
            ),
            above,
        )
    return Script(state, way, spoils)


def _table(random: np.random.Generator) -> Floats:
    T = rotation((0, 0, 1), float(random.uniform(-0.6, 0.6)))
    return transform(T, np.array([random.uniform(0.4, 0.48), random.uniform(0.1, 0.17), 0.0]))


def lying(random: np.random.Generator, facet: str) -> Scene:
    """The scene with the wheel on one of its facets, in a drawn place."""
    bodies = SCENE.cell.bodies
    at = Placement("world", transforms.to_pose(_table(random) @ RESTS[facet]))
    return replace(
        SCENE,
        cell=replace(
            SCENE.cell, bodies={**bodies, "wheel": replace(bodies["wheel"], placement=at)}
        ),
    )


def _useless(state: WatchedWorld) -> Floats | None:
    """A configuration with which the wheel is held so that it cannot be let go at its goal;
    None if all grasps can.
    """
    task = state.site.task("wheel", (state.T_world_part, state.T_goal))
    useless = possible_holds(task, state.T_world_part) & ~possible_holds(task, state.T_goal)
    for n in np.nonzero(useless)[0]:
        width = task.holds.grasps[task.holds.grasp_of[n]].opening
        reach = ArmReach(
            with_hand(task.world, task.scene, task.holds.jaws, width), task.scene.hand.arm
        )
        found = reach.configurations(
            state.T_world_part @ task.holds.poses[n], task.world.configuration
        )
        if len(found):
            return found[0]
    return None
