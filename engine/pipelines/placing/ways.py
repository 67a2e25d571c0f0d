"""Ways of a part from one pose to another: with one hold that serves both, or with regrasps on the free place."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice, pairwise

import numpy as np

from cellwright.engine.kernels.rigid import rotation, transform
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.grasping import Placement as Lying
from cellwright.engine.model.grasping import RegraspAnswer, Regrasps, Unplaceable
from cellwright.engine.pipelines.placing.answers import Carry, NotPlaced
from cellwright.engine.pipelines.placing.carrying import carried, through_unknown
from cellwright.engine.pipelines.placing.holding import BACK_M, Reach, with_hand
from cellwright.engine.pipelines.placing.room import no_room
from cellwright.engine.pipelines.placing.task import Coming, Task
from cellwright.engine.stages.grasping.placements import placements, volume_and_centre
from cellwright.engine.stages.grasping.regrasps import regrasps

TRIED = 6  # holds whose motions are planned before others are given up
NEAREST = 4  # configurations that are looked at, to find out whether the arm reaches
PHIS = 8  # turns of a placement about the vertical
BACKS = (0.0, 0.03, 0.06, BACK_M)
Ends = tuple[Truths, Truths]
Ways = tuple[Carry, ...] | NotPlaced


def possible(task: Task, T_world_part: Floats) -> Truths:
    """Which holds (h,) are possible with the part at a pose: the hand meets nothing, and the arm reaches.

    A hand that comes straight must be free backed off, too.
    """
    holds = task.holds
    every = np.ones(len(holds.poses), dtype=bool)
    return reached(task, T_world_part, holds.clear(task.obstacles(T_world_part), every, _backs(task)))


def _backs(task: Task) -> tuple[float, ...]:
    return BACKS if task.manner.coming is Coming.STRAIGHT else BACKS[:1]


def brought(task: Task, near: Floats) -> tuple[Ends, Ways]:
    """The holds that are possible at both ends, and the fewest carries from one end to the other, from a configuration (k,) on.

    Hands that come straight are tried first; where they do not serve, hands that come round what stands there.
    """
    coming = task.manner.coming
    for each in (Coming.STRAIGHT, coming) if coming is Coming.COMPLETE else (coming,):
        now = replace(task, manner=replace(task.manner, coming=each))
        at = possible(now, task.T_start), possible(now, task.T_goal)
        carries = direct(now, at, near)
        if isinstance(carries, NotPlaced) and carries.step in ("hold", "motion"):
            carries = regrasped(now, at, near)
        if not isinstance(carries, NotPlaced) or no_room(task, task.T_goal) is not None:
            break
    return at, carries


def reached(task: Task, T_world_part: Floats, which: Truths) -> Truths:
    """Which of some holds (h,) the arm reaches without touching anything, with the part at a pose."""
    found = which.copy()
    openings = [tuple(round(x, 6) for x in task.holds.grasps[n].opening) for n in task.holds.grasp_of]
    world = task.crowded.put(task.part, "world", T_world_part)
    for opening in sorted({each for each, asked in zip(openings, which, strict=True) if asked}):
        mine = np.array([n for n in np.nonzero(which)[0] if openings[n] == opening])
        handed = with_hand(world, task.scene, task.holds.jaws, opening)
        reach = Reach(handed, task.scene.hand.arm, through_unknown(task))
        found[mine] = _any_free(reach, T_world_part @ task.holds.poses[mine])
    return found


def _any_free(reach: Reach, T_world_hand: Floats) -> Truths:
    """For which poses of the hand (n, 4, 4) one of the nearest configurations touches nothing (n,)."""
    near = reach.world.configuration
    every = [each[:NEAREST] for each in reach.hand.reaching(T_world_hand, near)]
    whole = np.concatenate([np.zeros((0, len(near))), *every])
    free = ~reach.checker.collides(whole) if len(whole) else np.zeros(0, dtype=bool)
    ends = np.cumsum([len(each) for each in every])
    return np.array(
        [free[end - len(each) : end].any() for end, each in zip(ends, every, strict=True)], dtype=bool
    )


def direct(task: Task, ends: Ends, near: Floats) -> Ways:
    """One carry with a hold that serves both ends, from a configuration (k,) on; the most vertical holds come first.

    The answer's step is `hold` where each end has holds, and none serves both.
    """
    if (lacking := _no_hold(task, ends)) is not None:
        return lacking
    start, goal = ends
    answer: Ways = NotPlaced(
        "hold", f"no grasp of {task.part} serves both where it lies and at its goal", "regrasp it"
    )
    for hold in islice(most_vertical(task, start & goal), TRIED):
        found = carried(task, hold, (task.T_start, task.T_goal), near, "goal")
        if not isinstance(found, NotPlaced):
            return (found,)
        answer = found
    return answer


def _no_hold(task: Task, ends: Ends) -> NotPlaced | None:
    """What is said where an end has no hold at all, or the goal no room."""
    start, goal = ends
    if not start.any():
        hint = "remove what stands around it, or give the hand a wider opening"
        return NotPlaced("grasp", f"no grasp of {task.part} is possible where it lies", hint)
    if not goal.any():
        hint = "relate it so that two opposite faces stay free, or remove what stands at the goal"
        return NotPlaced("grasp", f"no grasp of {task.part} can be let go at its goal", hint)
    return no_room(task, task.T_goal)


def most_vertical(task: Task, which: Truths) -> Iterator[int]:
    """Holds, those first with which the hand comes most steeply from above."""
    down = (task.T_start[:3, :3] @ task.holds.poses[:, :3, 2].T)[2]
    order = np.argsort(np.round(down, 6), kind="stable")
    return (int(n) for n in order if which[n])


def regrasped(task: Task, ends: Ends, near: Floats) -> Ways:
    """The fewest carries over placements on the free place, at least one of them.

    Where the motions of a sequence are not found, the next one goes without the hold that could not be brought to its end.
    """
    if (lacking := _no_hold(task, ends)) is not None:
        return lacking
    lying = list(rests(task))
    poses = [T for _, T in lying]
    start, goal, table = ends[0], ends[1].copy(), serving(task, poses)
    answer: NotPlaced | None = None
    for _ in range(TRIED):
        found = shortest(task, (start, goal), poses, table)
        if not isinstance(found, Regrasps):
            return answer or _unreached(found)
        carries, answer = _carries(task, found, lying, near)
        if answer is None:
            return carries
        hold, ban = ([found.first, *(n for _, n in found.then)][len(carries)], len(carries))
        if ban < len(found.then):
            table[hold, found.then[ban][0]] = False
        else:
            goal[hold] = False
    assert answer is not None
    return answer


def _unreached(found: Unplaceable) -> NotPlaced:
    reason = (
        f"of {len(found.needed)} grasps that serve the goal, none is reached by any sequence of placements"
    )
    hint = "give another free place as `table`, or relate the part otherwise"
    return NotPlaced("regrasp", reason, hint)


def rests(task: Task) -> Iterator[tuple[Lying, Floats]]:
    """Placements of the part on the scene's table at some turns, with the part's pose in the world."""
    solid = task.holds.solid
    for each in placements(solid, volume_and_centre(solid)[1]):
        for turn in np.arange(PHIS) * 2 * np.pi / PHIS:
            T_table = transform(rotation((0, 0, 1), turn), np.zeros(3))
            yield each, task.T_world_table @ T_table @ each.T_table_part


def shortest(task: Task, ends: Ends, T_world_part: Sequence[Floats], table: Truths) -> RegraspAnswer:
    """The fewest regrasps, at least one, over rests of the part at r poses; `table` (h, r) is what `serving` says of them.

    Whether the arm reaches is asked only at the rests of a sequence that is free otherwise, and noted in the table. Until it is
    asked, all count as reached. So no sequence of fewer rests is overlooked.
    """
    asked: set[int] = set()
    while True:
        found = regrasps(*ends, table, fewest=1)
        new = {rest for rest, _ in found.then} - asked if isinstance(found, Regrasps) else set()
        if not new:
            return found
        for rest in sorted(new):
            table[:, rest] = reached(task, T_world_part[rest], table[:, rest])
        asked |= new


def serving(task: Task, T_world_part: Sequence[Floats]) -> Truths:
    """With which holds the hand meets nothing where the part lies at which of r poses (h, r)."""
    every = np.ones(len(task.holds.poses), dtype=bool)
    found = [task.holds.clear(task.obstacles(T), every, _backs(task)) for T in T_world_part]
    return np.array(found, dtype=bool).reshape(len(found), len(every)).T


def _carries(
    task: Task, found: Regrasps, lying: Sequence[tuple[Lying, Floats]], near: Floats
) -> tuple[tuple[Carry, ...], NotPlaced | None]:
    """The carries of a sequence, and why there are not more of them, if so."""
    holds = [found.first, *(hold for _, hold in found.then)]
    poses = [task.T_start, *(lying[rest][1] for rest, _ in found.then), task.T_goal]
    names = [*(f"on {lying[rest][0].facet}" for rest, _ in found.then), "goal"]
    carries: list[Carry] = []
    for hold, (here, there), name in zip(holds, pairwise(poses), names, strict=True):
        one = carried(task, hold, (here, there), near, name)
        if isinstance(one, NotPlaced):
            return tuple(carries), one
        carries.append(one)
        near = one.legs[-1].path[-1]
    return tuple(carries), None
