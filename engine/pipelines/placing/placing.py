"""PLACE: the goal from relations, the part from an image, and the way between the two."""

from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.rigid import difference
from cellwright.engine.model.assembly import Contradiction
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.vision import Located, NotLocated
from cellwright.engine.pipelines.placing.answers import NotPlaced, PlaceAnswer, Placed
from cellwright.engine.pipelines.placing.doubt import brought as doubted
from cellwright.engine.pipelines.placing.fit import insertion_of
from cellwright.engine.pipelines.placing.goals import goal_of
from cellwright.engine.pipelines.placing.looking import Looked, look
from cellwright.engine.pipelines.placing.site import Site
from cellwright.engine.pipelines.placing.task import Coming, Manner
from cellwright.engine.pipelines.placing.ways import brought
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.scene import Scene

ANY_WAY = Manner(Coming.COMPLETE)
STILL_M, STILL_RAD = 0.002, np.radians(1)  # what has moved less is where it was


def place(
    scene: Scene,
    part: str,
    base: str,
    seed: int = 0,
    image: Floats | None = None,
    manner: Manner = ANY_WAY,
) -> tuple[PlaceAnswer, Looked | None]:
    """The way of a part to where the relations say, and what was seen. Raises `InvalidInput` for names that are not there."""
    world = World.of(scene.cell)
    goal = goal_of(scene, world, (part,), base)
    if isinstance(goal, Contradiction):
        return contradicted(goal), None
    looked = look(scene, world, (part,), seed, image)
    sighting = looked.sightings[part]
    if isinstance(sighting, NotLocated):
        return unseen(part, sighting), looked
    T_goal = world.pose("world", base) @ goal.poses[part]
    T_start = likeliest(sighting, looked.T_world_camera, T_goal)
    task = Site.of(scene, world, looked, {part: T_start}, manner).task(part, (T_start, T_goal))
    at, carries = brought(task, world.configuration)
    if isinstance(carries, NotPlaced):
        return carries, looked
    counts = (len(task.holds.poses), int(at[0].sum()), int(at[1].sum()))
    holds = task.holds
    taken = tuple((holds.poses[n], holds.grasps[holds.grasp_of[n]].width_m) for n in np.nonzero(at[0])[0])
    fit = insertion_of(task, doubted(sighting, carries, T_goal), carries[-1].T_part_hand)
    carries = (*carries[:-1], replace(carries[-1], insertion=fit))
    return Placed(goal, sighting, T_start, T_goal, counts, carries, taken), looked


@dataclass(frozen=True, slots=True, eq=False)
class Since:
    """What a second look shows, just before the part is taken: how far it was moved since (m, rad), and the plan from there on.

    A plan that still holds is kept.
    """

    moved_m: float
    moved_rad: float
    answer: PlaceAnswer
    looked: Looked


def again(scene: Scene, part: str, base: str, plan: Placed, image: Floats) -> Since:
    """The plan after a second look: the same if the part is where it was, else one from where it is now."""
    world = World.of(scene.cell)
    looked = look(scene, world, (part,), 0, image)
    sighting = looked.sightings[part]
    if isinstance(sighting, NotLocated):
        return Since(np.inf, np.inf, unseen(part, sighting), looked)
    apart = [difference(plan.T_world_part, looked.T_world_camera @ each) for each in sighting.equivalent]
    metres, radians = min(apart, key=lambda pair: float(pair[0] + 0.05 * pair[1]))
    if metres < STILL_M and radians < STILL_RAD:
        return Since(float(metres), float(radians), plan, looked)
    anew, _ = place(scene, part, base, image=image)
    return Since(float(metres), float(radians), anew, looked)


def contradicted(goal: Contradiction) -> NotPlaced:
    """What is said where relations contradict each other."""
    said = ", ".join(map(str, goal.relations))
    return NotPlaced("relations", f"these cannot hold together: {said}", "leave one of them out", goal)


def unseen(part: str, sighting: NotLocated) -> NotPlaced:
    """What is said where a part is not found."""
    hint = "look from another place, or remove what hides it"
    return NotPlaced("sight", f"{part} is not found: {sighting.reason}", hint, sighting)


def likeliest(sighting: Located, T_world_camera: Floats, T_goal: Floats) -> Floats:
    """T_world_part: of the poses that look the same, the one from which the part is turned least on its way to the goal.

    A turn about the vertical counts less than one that brings another side up.
    """
    poses = [T_world_camera @ each for each in sighting.equivalent]
    up = T_goal[2, :3]
    turn = [np.trace(T_goal[:3, :3].T @ T[:3, :3]) for T in poses]
    best = max(range(len(poses)), key=lambda n: (round(float(poses[n][2, :3] @ up), 2), turn[n], -n))
    return poses[best]
