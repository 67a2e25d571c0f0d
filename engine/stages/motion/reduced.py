"""Handey's planner: three joints at a time (Mazer and others 1992, section 4.2).

The last three joints keep the values of the start until some place of the path, and have those of the goal from some place
on. In between, a box covers the last three links, the hand and what it holds, at all values of the three joints from start to
goal. So each of the three paths, from the start to a free configuration, on to another one, and to the goal, is one of the
first three joints alone. Where that assumption fails, it is said which of the paths there is not.
"""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.geometry.edges import Edges
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.motion import Query
from cellwright.engine.ports import MotionGround
from cellwright.engine.stages.motion.lattice import Lattice, nearest_free, way

WRIST = 3  # joints that are planned for by a box
GOALS = 4  # goals that are tried, the nearest first
NO_ROOM = "the box around the hand is nowhere free near the {}"
NO_WAY = "the first three joints find no way for the box around the hand"
NO_EXIT = "with its last three joints still, the arm finds no way between the {} and the place where the box is free"


@dataclass(frozen=True, slots=True, eq=False)
class Failed:
    """Why the three paths do not come together, and the configurations (2, k) between which one is missing."""

    why: str
    ends: Floats


def reduced(
    ground: MotionGround, lines: Edges, query: Query, low: Floats, high: Floats
) -> tuple[Floats | Failed, int]:
    """The configurations (m, k) of the three paths, and the number of the goal; else what is missing for the nearest goal.

    Raises `ValueError` for an arm of more than six joints, or of less than four.
    """
    joints = list(query.moving or range(ground.scene.joints.count))
    if not WRIST < len(joints) <= 2 * WRIST:
        raise ValueError(f"the reduced planner is for arms of four to six joints, not {len(joints)}")
    first = None
    for goal in np.argsort(np.linalg.norm(query.goals - query.start, axis=1), kind="stable")[:GOALS]:
        found = _joined(
            ground, lines, query, query.goals[goal], (joints[:-WRIST], joints[-WRIST:]), (low, high)
        )
        if not isinstance(found, Failed):
            return found, int(goal)
        first = first or (found, int(goal))
    assert first is not None
    return first


def _joined(
    ground: MotionGround,
    lines: Edges,
    query: Query,
    goal: Floats,
    joints: tuple[list[int], list[int]],
    limits: tuple[Floats, Floats],
) -> Floats | Failed:
    """The three paths to one goal, one after the other."""
    start, (arm, wrist) = query.start, joints
    box = ground.covered(wrist, start, goal)
    leaving = nearest_free(box, Lattice(start, arm, *limits), query.margin_m)
    entering = nearest_free(box, Lattice(goal, arm, *limits), query.margin_m)
    if leaving is None or entering is None:
        return Failed(NO_ROOM.format("start" if leaving is None else "goal"), np.array([start, goal]))
    still = entering.copy()
    still[wrist] = leaving[wrist]
    middle = way(box.lines(query.step, query.margin_m), Lattice(leaving, arm, *limits), still)
    if middle is None:
        return Failed(NO_WAY, np.array([leaving, still]))
    out = way(lines, Lattice(start, arm, *limits), leaving)
    back = way(lines, Lattice(goal, arm, *limits), entering)
    if out is None or back is None:
        name, ends = ("start", (start, leaving)) if out is None else ("goal", (entering, goal))
        return Failed(NO_EXIT.format(name), np.array(ends))
    return np.concatenate([out[:-1], _turning(middle, wrist, entering), back[::-1][1:]])


def _turning(middle: Floats, wrist: list[int], last: Floats) -> Floats:
    """The path (m, k) on which the last joints turn evenly to the values of `last` (k,) on the way."""
    if len(middle) < 2 or not np.abs(np.diff(middle, axis=0)).any():
        return np.array([middle[0], last])
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1)))
    turned = middle.copy()
    turned[:, wrist] += (along / along[-1])[:, None] * (last - middle[0])[wrist]
    return turned
