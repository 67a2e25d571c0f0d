"""One carry: to the part, in, up, over, down, and back; straight lines near things, planned and proved motions between."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.kernels.rigid import inverse
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.motion import FINEST_M, Moved, Query, Strategy
from cellwright.engine.pipelines.placing.answers import Carry, Leg, NotPlaced
from cellwright.engine.pipelines.placing.approaching import WayOut
from cellwright.engine.pipelines.placing.holding import HAND, Reach, with_hand
from cellwright.engine.pipelines.placing.task import UNKNOWN, Task
from cellwright.engine.stages.geometry.collision.ground import Ground
from cellwright.engine.stages.motion.planner import tried

LIFT_M = 0.08
BUDGET = 20_000  # configurations that the search for one motion looks at
MARGIN_M = (
    0.005  # from everything, on motions between: servos lag a little, and a part may sit askew in the hand
)
MARGIN_BUDGET = 5_000  # configurations that a search with the margin looks at
CHOICES = 3  # configurations that are tried for an end


def carried(
    task: Task, hold: int, poses: tuple[Floats, Floats], near: Floats, rest: str
) -> Carry | NotPlaced:
    """Take the part with a hold at one pose, and let it go at another, from a configuration (k,) on."""
    here, there = poses
    grasp, T = task.holds.grasps[task.holds.grasp_of[hold]], task.holds.poses[hold]
    empty, above, full, free, left = _reaches(task, grasp.opening, T, poses)
    out = WayOut(task, hold, here), WayOut(task, hold, there)
    up, strategy = np.array([0.0, 0.0, LIFT_M]), task.manner.strategy
    for q in ends(empty, here @ T, near):
        taken = out[0].configurations(empty, q)
        lifted = full.line(here @ T, q, up)
        if taken is None or lifted is None:
            continue
        for end in ends(left, there @ T, q):
            lowered = full.line(there @ T, end, up)
            away = out[1].configurations(left, end)
            if lowered is None or away is None:
                continue
            first = gross(above, near, taken[-1], strategy)
            second = gross(free, lifted[-1], lowered[-1], strategy)
            if first is None or second is None:
                continue
            legs = (
                Leg("to the part", first.path, False, first.proved),
                straight("approach", taken[::-1], False, empty),
                straight("lift", lifted, True, full),
                Leg("carry", second.path, True, second.proved),
                straight("lower", lowered[::-1], True, full),
                straight("withdraw", away, False, left),
            )
            return Carry(grasp, T, here, there, rest, legs)
    hint = "move what stands between, or the table where parts are taken anew"
    stuck = " ".join(dict.fromkeys(why for each in out if (why := each.stuck())))
    said = f"no motion carries {task.part} with the grasps that are possible"
    return NotPlaced("motion", f"{said}; in the grasp plane {stuck}" if stuck else said, hint)


def _reaches(
    task: Task, opening: Sequence[float], T_part_hand: Floats, poses: tuple[Floats, Floats]
) -> tuple[Reach, ...]:
    """What the arm meets with the part where it lies (near, far), in the hand (near, far), and put down (near).

    It keeps away from what is only seen. Near what is taken or put down, the hand and the part may pass through the blocks that
    stand for that: they are coarse, and holds were compared with all that is seen.
    """
    crowded, arm = with_hand(task.crowded, task.scene, task.holds.jaws, opening), task.scene.hand.arm
    (here, there), T_hand_part = poses, inverse(T_part_hand)
    held = crowded.put(task.part, f"{arm}.tool", T_hand_part)
    near = through_unknown(task)
    return (
        Reach(crowded.put(task.part, "world", here), arm, near),
        Reach(crowded.put(task.part, "world", here), arm),
        Reach(held, arm, touching(task) | near),
        Reach(held, arm, frozenset([frozenset((HAND, task.part))])),
        Reach(crowded.put(task.part, "world", there), arm, near),
    )


def through_unknown(task: Task) -> frozenset[frozenset[str]]:
    """The hand and the part may pass through the blocks for what is only seen."""
    return frozenset(frozenset((each, UNKNOWN)) for each in (HAND, task.part))


def straight(what: str, path: Floats, carries: bool, reach: Reach) -> Leg:
    """A straight line of the hand, and whether it is free all along."""
    proof = Ground(reach.checker).proof(0.0, FINEST_M)
    return Leg(what, path, carries, proved(proof, np.ascontiguousarray(path)) == len(path) - 1)


def touching(task: Task) -> frozenset[frozenset[str]]:
    """While it is lifted and lowered, the part may touch what it lies on, and the hand that holds it."""
    others = [name for name in task.world.cell.bodies if name != task.part]
    return frozenset(frozenset((task.part, name)) for name in [*others, HAND])


def ends(reach: Reach, T_world_hand: Floats, near: Floats) -> Floats:
    """Some free configurations (m, k) with the hand at a pose, the nearest first."""
    return reach.configurations(T_world_hand, near)[:CHOICES]


def gross(reach: Reach, start: Floats, goal: Floats, strategy: Strategy = Strategy.CONNECT) -> Moved | None:
    """A motion between two configurations (k,) that keeps a margin where there is room for it; None if none is found at all."""
    own, ground = reach.hand.own, Ground(reach.checker)
    query = Query(
        start, goal[None], budget=BUDGET, moving=tuple(range(own.start, own.stop)), strategy=strategy
    )
    wide = tried(ground, replace(query, margin_m=MARGIN_M, budget=MARGIN_BUDGET), reach.hand)
    if isinstance(wide, Moved) and wide.proved:
        return wide
    found = tried(ground, query, reach.hand)
    return found if isinstance(found, Moved) else None
