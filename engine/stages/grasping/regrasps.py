"""The least sequence of regrasps: placements and holds as a graph with two kinds of nodes (Tournassoud and others 1987).

A hold is a grasp with a turn, a rest is a placement with a turn on the table. They are neighbours where the part can lie in
this rest while the hand holds it so. The search goes in breadth, so the first sequence is a shortest one; where the search
ends without the goal, there is none among these holds and rests.
"""

import numpy as np

from cellwright.engine.model.geometry import Truths
from cellwright.engine.model.grasping import RegraspAnswer, Regrasps, Unplaceable


def regrasps(start: Truths, goal: Truths, possible: Truths, most: int = 16, fewest: int = 0) -> RegraspAnswer:
    """The shortest way from a hold that is possible at the start (h,) to one that is possible at the goal (h,).

    `possible` (h, r) says which holds go with which rests. At least `fewest` and no more than `most` regrasps are looked
    for; a hold that can be had with fewer does not count as reached by more.
    """
    came: list[tuple[Truths, Truths]] = []
    reached, new = start.copy(), start.copy()
    rested = np.zeros(possible.shape[1], dtype=bool)
    while len(came) < fewest or not (new & goal).any():
        rests = possible[new].any(axis=0) & ~rested
        held = possible[:, rests].any(axis=1) & ~reached
        came.append((new, rests))
        if not held.any() or len(came) > most:
            return Unplaceable(_numbers(reached), _numbers(goal))
        rested |= rests
        reached |= held
        new = held
    return _back(came, int(np.argmax(new & goal)), possible)


def _numbers(which: Truths) -> tuple[int, ...]:
    return tuple(int(n) for n in np.nonzero(which)[0])


def _back(came: list[tuple[Truths, Truths]], last: int, possible: Truths) -> Regrasps:
    """The sequence that ends in a hold, followed back through what was new in each round."""
    then: list[tuple[int, int]] = []
    for holds, rests in reversed(came):
        rest = int(np.argmax(rests & possible[last] & possible[holds].any(axis=0)))
        then.append((rest, last))
        last = int(np.argmax(holds & possible[:, rest]))
    return Regrasps(last, tuple(reversed(then)))
