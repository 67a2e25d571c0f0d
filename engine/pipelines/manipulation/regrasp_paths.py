"""Paths of a part between two poses: with one hold, or with regrasps on the free place."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice, pairwise

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.rigid import rotation, transform
from cellwright.engine.model.manipulation_values import RegraspAnswer, Regrasps, Unplaceable
from cellwright.engine.model.manipulation_values import TablePlacement as Lying
from cellwright.engine.pipelines.manipulation.carry_paths import carry_part, through_unknown
from cellwright.engine.pipelines.manipulation.clearance import no_room
from cellwright.engine.pipelines.manipulation.part_grasps import (
    HAND_BACK_OFF_M,
    ArmReach,
    with_hand,
)
from cellwright.engine.pipelines.manipulation.place_answers import Carry, NotPlaced
from cellwright.engine.pipelines.manipulation.workspace import HandApproachKind, PlaceTask
from cellwright.engine.stages.grasping.stable_placements import (
    shortest_regrasps,
    stable_placements,
    volume_and_centre,
)

MAX_TRIED_HOLDS = 6  # holds whose motions are planned before others are given up
NEAREST_CONFIGURATIONS = 4  # configurations that are looked at, to find out whether the arm reaches
PLACEMENT_TURNS = 8  # turns of a placement about the vertical
BACK_OFFS_M = (0.0, 0.03, 0.06, HAND_BACK_OFF_M)
Ends = tuple[Truths, Truths]
Ways = tuple[Carry, ...] | NotPlaced


def possible_holds(task: PlaceTask, T_world_part: Floats) -> Truths:
    """Which holds (h,) are possible with the part at a pose: the hand meets nothing, and the arm
    reaches.

    A hand that comes straight must be free backed off, too.
    """
    holds = task.holds
    every = np.ones(len(holds.poses), dtype=bool)
    return reached_holds(
        task, T_world_part, holds.clear(task.obstacles(T_world_part), every, _back_offs(task))
    )


def _back_offs(task: PlaceTask) -> tuple[float, ...]:
    return BACK_OFFS_M if task.manner.coming is HandApproachKind.STRAIGHT else BACK_OFFS_M[:1]


def bring_part(task: PlaceTask, near: Floats) -> tuple[Ends, Ways]:
    """The holds that are possible at both ends, and the fewest carries from one end to the other,
    from a configuration (k,) on.

    Hands that come straight are tried first; where they do not serve, hands that come round what
    stands there.
    """
    coming = task.manner.coming
    for manner in (
        (HandApproachKind.STRAIGHT, coming) if coming is HandApproachKind.COMPLETE else (coming,)
    ):
        now = replace(task, manner=replace(task.manner, coming=manner))
        at = possible_holds(now, task.T_start), possible_holds(now, task.T_goal)
        carries = direct_carry(now, at, near)
        if isinstance(carries, NotPlaced) and carries.step in ("hold", "motion"):
            carries = carry_with_regrasps(now, at, near)
        if not isinstance(carries, NotPlaced) or no_room(task, task.T_goal) is not None:
            break
    return at, carries


def reached_holds(task: PlaceTask, T_world_part: Floats, which: Truths) -> Truths:
    """Which of some holds (h,) the arm reaches without touching anything, with the part at a
    pose.
    """
    within_reach = which.copy()
    openings = [
        tuple(round(x, 6) for x in task.holds.grasps[n].opening) for n in task.holds.grasp_of
    ]
    world = task.crowded.put(task.part, "world", T_world_part)
    for opening in sorted(
        {hold_opening for hold_opening, asked in zip(openings, which, strict=True) if asked}
    ):
        mine = np.array([n for n in np.nonzero(which)[0] if openings[n] == opening])
        handed = with_hand(world, task.scene, task.holds.jaws, opening)
        reach = ArmReach(handed, task.scene.hand.arm, through_unknown(task))
        within_reach[mine] = _any_free(reach, T_world_part @ task.holds.poses[mine])
    return within_reach


def _any_free(reach: ArmReach, T_world_hand: Floats) -> Truths:
    """For which poses of the hand (n, 4, 4) one of the nearest configurations touches nothing
    (n,).
    """
    near = reach.world.configuration
    every = [
        configurations[:NEAREST_CONFIGURATIONS]
        for configurations in reach.hand.reaching(T_world_hand, near)
    ]
    whole = np.concatenate([np.zeros((0, len(near))), *every])
    free = ~reach.checker.collides(whole) if len(whole) else np.zeros(0, dtype=bool)
    ends = np.cumsum([len(configurations) for configurations in every])
    return np.array(
        [
            free[end - len(configurations) : end].any()
            for end, configurations in zip(ends, every, strict=True)
        ],
        dtype=bool,
    )


def direct_carry(task: PlaceTask, ends: Ends, near: Floats) -> Ways:
    """One carry with a hold that serves both ends, from a configuration (k,) on; the most vertical
    holds come first.

    The answer's step is `hold` where each end has holds, and none serves both.
    """
    if (lacking := _no_hold(task, ends)) is not None:
        return lacking
    start, goal = ends
    answer: Ways = NotPlaced(
        "hold", f"no grasp of {task.part} serves both where it lies and at its goal", "regrasp it"
    )
    for hold in islice(most_vertical(task, start & goal), MAX_TRIED_HOLDS):
        carry = carry_part(task, hold, (task.T_start, task.T_goal), near, "goal")
        if not isinstance(carry, NotPlaced):
            return (carry,)
        answer = carry
    return answer


def _no_hold(task: PlaceTask, ends: Ends) -> NotPlaced | None:
    """What is said where an end has no hold at all, or the goal no room."""
    start, goal = ends
    if not start.any():
        hint = "remove what stands around it, or give the hand a wider opening"
        return NotPlaced("grasp", f"no grasp of {task.part} is possible where it lies", hint)
    if not goal.any():
        hint = "relate it so that two opposite faces stay free, or remove what stands at the goal"
        return NotPlaced("grasp", f"no grasp of {task.part} can be let go at its goal", hint)
    return no_room(task, task.T_goal)


def most_vertical(task: PlaceTask, which: Truths) -> Iterator[int]:
    """Holds, those first with which the hand comes most steeply from above."""
    down = (task.T_start[:3, :3] @ task.holds.poses[:, :3, 2].T)[2]
    order = np.argsort(np.round(down, 6), kind="stable")
    return (int(n) for n in order if which[n])


def carry_with_regrasps(task: PlaceTask, ends: Ends, near: Floats) -> Ways:
    """The fewest carries over placements on the free place, at least one of them.

    Where the motions of a sequence are not found, the next one goes without the hold that could not
    be brought to its end.
    """
    if (lacking := _no_hold(task, ends)) is not None:
        return lacking
    lying = list(table_rests(task))
    poses = [T for _, T in lying]
    start, goal, table = ends[0], ends[1].copy(), serving_holds(task, poses)
    answer: NotPlaced | None = None
    for _ in range(MAX_TRIED_HOLDS):
        regrasp_answer = fewest_regrasps(task, (start, goal), poses, table)
        if not isinstance(regrasp_answer, Regrasps):
            return answer or _not_reached_answer(regrasp_answer)
        carries, answer = _regrasp_carries(task, regrasp_answer, lying, near)
        if answer is None:
            return carries
        hold, ban = (
            [regrasp_answer.first, *(n for _, n in regrasp_answer.then)][len(carries)],
            len(carries),
        )
        if ban < len(regrasp_answer.then):
            table[hold, regrasp_answer.then[ban][0]] = False
        else:
            goal[hold] = False
    assert answer is not None
    return answer


def _not_reached_answer(unplaceable: Unplaceable) -> NotPlaced:
    reason = (
        f"of {len(unplaceable.needed)} grasps that serve the goal, none is reached by any "
        "sequence of placements"
    )
    hint = "give another free place as `table`, or relate the part otherwise"
    return NotPlaced("regrasp", reason, hint)


def table_rests(task: PlaceTask) -> Iterator[tuple[Lying, Floats]]:
    """Placements of the part on the scene's table at some turns, with the part's pose in the
    world.
    """
    solid = task.holds.solid
    for placement in stable_placements(solid, volume_and_centre(solid)[1]):
        for turn in np.arange(PLACEMENT_TURNS) * 2 * np.pi / PLACEMENT_TURNS:
            T_table = transform(rotation((0, 0, 1), turn), np.zeros(3))
            yield placement, task.T_world_table @ T_table @ placement.T_table_part


def fewest_regrasps(
    task: PlaceTask, ends: Ends, T_world_part: Sequence[Floats], table: Truths
) -> RegraspAnswer:
    """The fewest regrasps, at least one, over rests of the part at r poses; `table` (h, r) is what
    `serving` says of them.

    Whether the arm reaches is asked only at the rests of a sequence that is free otherwise, and
    noted in the table. Until it is asked, all count as reached. So no sequence of fewer rests is
    overlooked.
    """
    asked: set[int] = set()
    while True:
        answer = shortest_regrasps(*ends, table, fewest=1)
        new = {rest for rest, _ in answer.then} - asked if isinstance(answer, Regrasps) else set()
        if not new:
            return answer
        for rest in sorted(new):
            table[:, rest] = reached_holds(task, T_world_part[rest], table[:, rest])
        asked |= new


def serving_holds(task: PlaceTask, T_world_part: Sequence[Floats]) -> Truths:
    """With which holds the hand meets nothing where the part lies at which of r poses (h, r)."""
    every = np.ones(len(task.holds.poses), dtype=bool)
    served = [task.holds.clear(task.obstacles(T), every, _back_offs(task)) for T in T_world_part]
    return np.array(served, dtype=bool).reshape(len(served), len(every)).T


def _regrasp_carries(
    task: PlaceTask, regrasp_steps: Regrasps, lying: Sequence[tuple[Lying, Floats]], near: Floats
) -> tuple[tuple[Carry, ...], NotPlaced | None]:
    """The carries of a sequence, and why there are not more of them, if so."""
    holds = [regrasp_steps.first, *(hold for _, hold in regrasp_steps.then)]
    poses = [task.T_start, *(lying[rest][1] for rest, _ in regrasp_steps.then), task.T_goal]
    names = [*(f"on {lying[rest][0].facet}" for rest, _ in regrasp_steps.then), "goal"]
    carries: list[Carry] = []
    for hold, (T_from, T_to), name in zip(holds, pairwise(poses), names, strict=True):
        carry = carry_part(task, hold, (T_from, T_to), near, name)
        if isinstance(carry, NotPlaced):
            return tuple(carries), carry
        carries.append(carry)
        near = carry.legs[-1].path[-1]
    return tuple(carries), None
