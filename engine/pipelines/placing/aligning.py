"""A named portion of a task: a part is found, taken, and brought to where one relation holds; there it stays in the hand."""

from dataclasses import dataclass, replace
from itertools import islice
from typing import TypeAlias

import numpy as np

from cellwright.engine.kernels.rigid import inverse
from cellwright.engine.model.assembly import Assembled, Contradiction
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.grasping import Grasp
from cellwright.engine.model.vision import NotLocated
from cellwright.engine.pipelines.placing.answers import Leg, NotPlaced
from cellwright.engine.pipelines.placing.carrying import LIFT_M, ends, gross, straight, touching
from cellwright.engine.pipelines.placing.goals import goal_of
from cellwright.engine.pipelines.placing.holding import BACK_M, HAND, Reach, with_hand
from cellwright.engine.pipelines.placing.looking import look
from cellwright.engine.pipelines.placing.placing import contradicted, unseen
from cellwright.engine.pipelines.placing.site import Site
from cellwright.engine.pipelines.placing.task import Task
from cellwright.engine.pipelines.placing.ways import most_vertical, possible
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.scene import SaidRelation, Scene

HIGH_M = 0.25  # how high above where it lies the part is, if the relation does not say otherwise
TRIED = 12


@dataclass(frozen=True, slots=True, eq=False)
class Brought:
    """The part is held where the relation holds: its pose in the world, what is still free in it, the grasp, and the legs."""

    goal: Assembled
    T_world_from: Floats
    T_world_part: Floats
    grasp: Grasp
    legs: tuple[Leg, ...]


Portion: TypeAlias = Brought | NotPlaced


def bring(scene: Scene, said: SaidRelation, seed: int = 0, image: Floats | None = None) -> Portion:
    """The motions that make one relation between a part and another body hold. Raises `InvalidInput` for unknown names."""
    world, part, base = World.of(scene.cell), said.first[0], said.second[0]
    only = replace(scene, relations=(said,))
    goal_of(only, world, (part,), base)  # names are refused before anything is looked for
    looked = look(only, world, (part,), seed, image)
    sighting = looked.sightings[part]
    if isinstance(sighting, NotLocated):
        return unseen(part, sighting)
    T_start = looked.T_world_camera @ sighting.best.T_camera_part
    lifted = T_start.copy()
    lifted[2, 3] += HIGH_M
    goal = goal_of(only, world.put(part, "world", lifted), (part,), base)
    if isinstance(goal, Contradiction):
        return contradicted(goal)
    T_goal = world.pose("world", base) @ goal.poses[part]
    task = Site.of(scene, world, looked, {part: T_start}).task(part, (T_start, T_goal))
    which = possible(task, T_start)
    for hold in islice(most_vertical(task, which), TRIED):
        legs = _held_out(task, hold, world.configuration)
        if legs is not None:
            return Brought(goal, T_start, T_goal, task.holds.grasps[task.holds.grasp_of[hold]], legs)
    reason = f"no grasp with which {part} can be taken brings it to where the relation holds"
    return NotPlaced("motion", reason, "relate it to something that the arm reaches better")


def _held_out(task: Task, hold: int, near: Floats) -> tuple[Leg, ...] | None:
    """The legs that take the part with a hold and bring it to the task's goal, where it stays in the hand; None if there are none."""
    arm, T = task.scene.hand.arm, task.holds.poses[hold]
    opening = task.holds.grasps[task.holds.grasp_of[hold]].opening
    world = with_hand(task.world, task.scene, task.holds.jaws, opening)
    crowded = with_hand(task.crowded, task.scene, task.holds.jaws, opening)
    empty = Reach(world.put(task.part, "world", task.T_start), arm)
    above = Reach(crowded.put(task.part, "world", task.T_start), arm)
    full = Reach(world.put(task.part, f"{arm}.tool", inverse(T)), arm, touching(task))
    own = frozenset([frozenset((HAND, task.part))])
    free = Reach(crowded.put(task.part, f"{arm}.tool", inverse(T)), arm, own)
    here, there = task.T_start @ T, task.T_goal @ T
    for q in ends(empty, here, near):
        taken = empty.line(here, q, -BACK_M * here[:3, 2])
        lifted = full.line(here, q, np.array([0.0, 0.0, LIFT_M]))
        if taken is None or lifted is None or (first := gross(above, near, taken[-1])) is None:
            continue
        for end in ends(free, there, lifted[-1]):
            if (second := gross(free, lifted[-1], end)) is not None:
                return (
                    Leg("to the part", first.path, False, first.proved),
                    straight("approach", taken[::-1], False, empty),
                    straight("lift", lifted, True, full),
                    Leg("align", second.path, True, second.proved),
                )
    return None
