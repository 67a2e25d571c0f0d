"""Windows that no tour keeps: of two visits, each begins too late if the other comes first."""

import numpy as np

from cellwright.engine.kernels.arrays import Longs
from cellwright.engine.model.tour import TourProblem

MOST = 400  # visits; of more, shortest ways by way of other visits take too long


def clash(problem: TourProblem) -> str | None:
    """Two visits that cannot both begin in their windows, in words; None if no two of them exclude each other."""
    timed = [n for n, visit in enumerate(problem.visits) if visit.window is not None]
    if len(timed) < 2 or len(problem.visits) > MOST:
        return None
    ways = _least(problem)
    for n, one in enumerate(timed):
        for other in timed[n + 1 :]:
            if _too_late(problem, ways, one, other) and _too_late(problem, ways, other, one):
                return _said(problem, ways, one, other)
    return None


def _least(problem: TourProblem) -> Longs:
    """The least time (n, n) from the start of one visit to that of another, by way of any others (Floyd 1962)."""
    lasts = np.array([visit.duration for visit in problem.visits], np.int64)
    ways: Longs = problem.arcs + lasts[:, None]
    for through in range(len(ways)):
        np.minimum(ways, ways[:, through, None] + ways[None, through], out=ways)
    return ways


def _too_late(problem: TourProblem, ways: Longs, first: int, second: int) -> bool:
    """Whether a visit begins too late if it comes after another one."""
    one, other = problem.visits[first].window, problem.visits[second].window
    return one is not None and other is not None and one[0] + int(ways[first, second]) > other[1]


def _said(problem: TourProblem, ways: Longs, one: int, other: int) -> str:
    a, b = problem.visits[one].name, problem.visits[other].name
    unit = f" {problem.unit}" if problem.unit else ""
    there, back = f"{ways[one, other]}{unit}", f"{ways[other, one]}{unit}"
    return (
        f"{a} and {b} cannot both begin in their windows: {b} begins {there} after {a} at the soonest, "
        f"and {a} {back} after {b}"
    )
