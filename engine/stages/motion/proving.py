"""Plans until one is proved: each further one looks closer and, if it can, keeps farther off."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.geometry.edges import free_edges
from cellwright.engine.kernels.geometry.proof import proved as proved_lines
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.motion import FINEST_M, Blocked, Moved, Query
from cellwright.engine.ports import MotionGround
from cellwright.engine.stages.motion.reasons import failed

ROUNDS = 6  # plans, the last of which looks 32 times as often as the first
WIDER_M = 0.001  # the margin that the second plan adds; each further one doubles it
GRAZED = "every path that was found touches something between two places that the search looked at"


def until_proved(
    ground: MotionGround, query: Query, search: Callable[[MotionGround, Query], Moved | Blocked]
) -> Moved | Blocked:
    """The first path of a search that is proved.

    A path that grazes something between two looks is not. If there is no path with a wider margin, the same step is tried
    without. All plans share the budget. What is left unproved in the end touches nothing when looked at every `FINEST_M`;
    what does touch is no path.
    """
    asked, found, looked = query, search(ground, query), 0
    unproved: Moved | None = None
    for round_ in range(ROUNDS):
        looked += found.looked
        if isinstance(found, Moved):
            unproved = replace(
                with_proof(ground, found, query.margin_m), looked=looked, cleared_m=asked.margin_m
            )
            if unproved.proved:
                return unproved
            wider = query.margin_m + min(WIDER_M * 2**round_, 0.5 * room_at_ends(ground, query))
            asked = replace(asked, step=asked.step / 2, margin_m=wider)
        elif asked.margin_m > query.margin_m:
            asked = replace(asked, margin_m=query.margin_m)
        else:
            break
        if looked >= query.budget or round_ == ROUNDS - 1:
            break
        found = search(ground, replace(asked, budget=query.budget - looked))
    return _unproved(ground, query, unproved, found, looked)


def _unproved(
    ground: MotionGround, query: Query, unproved: Moved | None, last: Moved | Blocked, looked: int
) -> Moved | Blocked:
    """The last path that was found, unless it touches something; then that there is none."""
    if unproved is not None:
        touched = _first_touching(ground, unproved.path, query.margin_m)
        if touched is None:
            return unproved
        if isinstance(last, Moved):
            return failed(ground, unproved.path[touched : touched + 2], GRAZED, looked, query)
    assert isinstance(last, Blocked)
    return replace(last, looked=looked)


def with_proof(ground: MotionGround, found: Moved, margin_m: float) -> Moved:
    """A path with what a proof says of it: whether it keeps more than the margin everywhere, and the work that it took."""
    proof = ground.proof(margin_m, FINEST_M)
    proved = proved_lines(proof, found.path) == len(found.path) - 1
    return replace(found, proved=proved, stretches=proof.looked, refined=proof.refined)


def unproved(ground: MotionGround, path: Floats, margin_m: float, finest_m: float) -> Truths:
    """Which lines (m - 1,) of a path (m, k) are not proved to keep more than a margin everywhere."""
    found, n = np.zeros(len(path) - 1, dtype=bool), 0
    while n < len(found):
        n += proved_lines(ground.proof(margin_m, finest_m), np.ascontiguousarray(path[n:]))
        found[n : n + 1] = True
        n += 1
    return found


def _first_touching(ground: MotionGround, path: Floats, margin_m: float) -> int | None:
    """The first line of a path (m, k) on which something is within the margin, looked at every `FINEST_M` (rad, m)."""
    free = np.zeros(len(path) - 1, dtype=np.uint8)
    lines = ground.lines(FINEST_M, margin_m)
    free_edges(lines, np.ascontiguousarray(path[:-1]), np.ascontiguousarray(path[1:]), free)
    return None if free.all() else int(np.argmin(free))


def room_at_ends(ground: MotionGround, query: Query) -> float:
    """How much wider than asked the margin can be at start and goals."""
    ends = np.vstack([query.start[None], query.goals])
    return max(0.0, float(ground.clearance(ends, query.margin_m + 1.0).min()) - query.margin_m)
