"""PLACE: the goal from relations, the part from an image, holds that serve both, regrasps if none does, and the motions."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from engine.kernels.rigid import rotation, transform
from engine.model.assembly import Contradiction
from engine.model.geometry import Floats, Truths
from engine.model.grasping import Placement as Lying
from engine.model.grasping import Regrasps
from engine.model.vision import NotLocated
from engine.pipelines.placing.answers import Carry, NotPlaced, PlaceAnswer, Placed
from engine.pipelines.placing.carrying import carried
from engine.pipelines.placing.goals import goal_of
from engine.pipelines.placing.holding import BACK_M, Reach, holds_of, with_hand
from engine.pipelines.placing.looking import Looked, look, table_pose
from engine.pipelines.placing.obstacles import Unknown
from engine.pipelines.placing.task import Task
from engine.stages.geometry.world.model import World
from engine.stages.grasping.placements import placements, volume_and_centre
from engine.stages.grasping.regrasps import regrasps
from kb.model.cell import Body, BodyKind, Placement
from kb.model.scene import Scene

UNKNOWN = "unknown_things"  # the body that stands for all that is only seen
TRIED = 6  # holds whose motions are planned before others are given up
PHIS = 8  # turns of a placement about the vertical
BACKS = (0.0, 0.03, 0.06, BACK_M)


def place(
    scene: Scene, part: str, base: str, seed: int = 0, image: Floats | None = None
) -> tuple[PlaceAnswer, Looked | None]:
    """The way of a part to where the relations say, and what was seen. Raises `InvalidInput` for names that are not there."""
    world = World.of(scene.cell)
    goal = goal_of(scene, world, part, base)
    if isinstance(goal, Contradiction):
        said = ", ".join(map(str, goal.relations))
        return NotPlaced(
            "relations", f"these cannot hold together: {said}", "leave one of them out", goal
        ), None
    looked = look(scene, world, part, seed, image)
    if isinstance(looked.sighting, NotLocated):
        hint = "look from another place, or remove what hides it"
        return NotPlaced(
            "sight", f"{part} is not found: {looked.sighting.reason}", hint, looked.sighting
        ), looked
    T_camera_part = looked.sighting.best.T_camera_part
    T_start = looked.T_world_camera @ T_camera_part
    T_goal = world.pose("world", base) @ goal.poses[part]
    known = _known(scene, world, part, T_start)
    holds = holds_of(scene, world.cell.bodies[part])
    unknown = Unknown(looked, holds.solid, T_camera_part)
    seen = unknown.lines()
    columns = Body(UNKNOWN, BodyKind.FIXTURE, Placement(), unknown.columns(table_pose(scene, world)))
    crowded = _with(known, columns, table_pose(scene, world))
    task = Task(scene, known, crowded, part, T_start, T_goal, holds)
    at = possible(task, T_start, seen), possible(task, T_goal, np.zeros((0, 3, 3)))
    carries = _way(task, *at)
    if isinstance(carries, NotPlaced):
        return carries, looked
    counts = (len(holds.poses), int(at[0].sum()), int(at[1].sum()))
    return Placed(goal, looked.sighting, T_start, T_goal, counts, carries), looked


def _known(scene: Scene, world: World, part: str, T_world_part: Floats) -> World:
    """The world without the clutter, and with the part where it was found."""
    bodies = {name: body for name, body in world.cell.bodies.items() if name not in scene.clutter}
    placed = {
        name: fixed for name, fixed in world.placed.items() if name.partition(".")[0] not in scene.clutter
    }
    known = replace(world, cell=replace(world.cell, bodies=bodies), placed=placed)
    return known.put(part, "world", T_world_part)


def _with(world: World, body: Body, T_world_body: Floats) -> World:
    """The world with one body more."""
    cell = replace(world.cell, bodies={**world.cell.bodies, body.name: body})
    return replace(world, cell=cell).put(body.name, "world", T_world_body)


def possible(task: Task, T_world_part: Floats, seen: Floats) -> Truths:
    """Which holds (h,) are possible with the part at a pose: the hand meets nothing, also backed off, and the arm reaches."""
    holds = task.holds
    around = np.concatenate([task.obstacles(T_world_part), seen])
    found = holds.clear(around, np.ones(len(holds.poses), dtype=bool), BACKS)
    return reached(task, T_world_part, found)


def reached(task: Task, T_world_part: Floats, which: Truths) -> Truths:
    """Which of some holds (h,) the arm reaches without touching anything, with the part at a pose."""
    found, numbers = which.copy(), np.array(task.holds.grasp_of, dtype=int)
    world = task.world.put(task.part, "world", T_world_part)
    for n, grasp in enumerate(task.holds.grasps):
        mine = np.nonzero(which & (numbers == n))[0]
        if not len(mine):
            continue
        reach = Reach(with_hand(world, task.scene, task.holds.jaws, grasp.width_m), task.scene.hand.arm)
        near = reach.world.configuration
        every = reach.hand.reaching(T_world_part @ task.holds.poses[mine], near)
        whole = np.concatenate([np.zeros((0, len(near))), *(each[:4] for each in every)])
        free = ~reach.checker.collides(whole) if len(whole) else np.zeros(0, dtype=bool)
        ends = np.cumsum([min(len(each), 4) for each in every])
        for hold, last, each in zip(mine, ends, every, strict=True):
            found[hold] = bool(free[last - min(len(each), 4) : last].any())
    return found


def _way(task: Task, start: Truths, goal: Truths) -> tuple[Carry, ...] | NotPlaced:
    """The carries from start to goal: one, if a hold serves both; else the fewest that placements allow."""
    if not start.any():
        hint = "remove what stands around it, or give the hand a wider opening"
        return NotPlaced("grasp", f"no grasp of {task.part} is possible where it lies", hint)
    if not goal.any():
        hint = "relate it so that two opposite faces stay free, or remove what stands at the goal"
        return NotPlaced("grasp", f"no grasp of {task.part} can be let go at its goal", hint)
    near = task.world.configuration
    last: NotPlaced | None = None
    for hold in islice(_most_vertical(task, start & goal), TRIED):
        found = carried(task, hold, (task.T_start, task.T_goal), near, "goal")
        if not isinstance(found, NotPlaced):
            return (found,)
        last = found
    return _regrasped(task, start, goal) if last is None else last


def _most_vertical(task: Task, which: Truths) -> Iterator[int]:
    """Holds, those first with which the hand comes most steeply from above."""
    down = (task.T_start[:3, :3] @ task.holds.poses[:, :3, 2].T)[2]
    order = np.argsort(np.round(down, 6), kind="stable")
    return (int(n) for n in order if which[n])


def _regrasped(task: Task, start: Truths, goal: Truths) -> tuple[Carry, ...] | NotPlaced:
    rests = list(_rests(task))
    useful = np.ones(len(start), dtype=bool)
    table = np.array([_at_rest(task, T, useful) for _, T in rests]).T.reshape(len(start), len(rests))
    found = regrasps(start, goal, table)
    if not isinstance(found, Regrasps):
        reason = f"of {len(found.needed)} grasps that serve the goal, none is reached by any sequence of placements"
        return NotPlaced(
            "regrasp", reason, "give another free place as `table`, or relate the part otherwise"
        )
    return _carries(task, found, rests)


def _rests(task: Task) -> Iterator[tuple[Lying, Floats]]:
    """Placements of the part on the scene's table at some turns, with the part's pose in the world."""
    _, centre = volume_and_centre(task.holds.solid)
    T_world_table = table_pose(task.scene, task.world)
    for each in placements(task.holds.solid, centre):
        for turn in np.arange(PHIS) * 2 * np.pi / PHIS:
            yield each, T_world_table @ transform(rotation((0, 0, 1), turn), np.zeros(3)) @ each.T_table_part


def _at_rest(task: Task, T_world_part: Floats, which: Truths) -> Truths:
    clear = task.holds.clear(task.obstacles(T_world_part), which, BACKS)
    return reached(task, T_world_part, clear)


def _carries(
    task: Task, found: Regrasps, rests: Sequence[tuple[Lying, Floats]]
) -> tuple[Carry, ...] | NotPlaced:
    holds = [found.first, *(hold for _, hold in found.then)]
    poses = [task.T_start, *(rests[rest][1] for rest, _ in found.then), task.T_goal]
    names = [*(f"on {rests[rest][0].facet}" for rest, _ in found.then), "goal"]
    near, carries = task.world.configuration, []
    for hold, here, there, name in zip(holds, poses, poses[1:], names, strict=True):
        one = carried(task, hold, (here, there), near, name)
        if isinstance(one, NotPlaced):
            return one
        carries.append(one)
        near = one.legs[-1].path[-1]
    return tuple(carries)
