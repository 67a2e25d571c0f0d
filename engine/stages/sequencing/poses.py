"""Tours of visits that have several poses: order and poses are chosen together, or one after the other.

Costs are whole microseconds. `tour_then_poses` is RoboTSP (Suarez-Ruiz, Lembono & Pham 2018): a short tour of
the positions, then the shortest path over the poses in that order. It is the baseline, and the first tour of
the search.
"""

from dataclasses import dataclass
from typing import cast

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Ints, Longs
from cellwright.engine.model.tour import PoseProblem, Tour
from cellwright.engine.stages.sequencing.candidates import nearest
from cellwright.engine.stages.sequencing.costs import of_matrix
from cellwright.engine.stages.sequencing.fields import fields, times
from cellwright.engine.stages.sequencing.limits import Limits
from cellwright.engine.stages.sequencing.sequence import nearest_first
from cellwright.engine.stages.sequencing.symmetric import Matrix
from cellwright.engine.stages.sequencing.symmetric import search as search_order

MICROSECONDS = 1e6
SLICE = 200
NEAR = 10
FIELDS, FINALISTS = 24, 3
WARM, COLD = 0.1, 0.001  # times the mean time between two visits
FAR_M = 1e6
LEAST = 8  # ruin and recreate is left out if there are fewer visits


@dataclass(frozen=True, slots=True, eq=False)
class PoseRing:
    """A closed tour: the visits in order (n,), the row of each visit's pose in the table (n,), and the time
    (s).
    """

    order: Ints
    rows: Ints
    time: float


def tour_then_poses(problem: PoseProblem) -> Tour:
    """A tour of the positions by nearest neighbour and two-edge exchange, then the best poses for it (RoboTSP)."""
    return _tour(problem, _first(problem), 0, "tour-then-poses")


def with_poses(problem: PoseProblem, limits: Limits = Limits()) -> Tour:
    """Order and poses together: tours of pose fields, then ruin and recreate on both, in `work` rounds."""
    ring, work = _first(problem), 0
    if len(problem.visits) >= LEAST and not limits.interrupted():
        ring = min((ring, *_of_fields(problem, limits)), key=lambda each: each.time)
        ring, work = _together(problem, ring, limits)
    return _tour(problem, ring, work, "together")


def poses_for(problem: PoseProblem, order: tuple[int, ...]) -> Tour:
    """The best poses for a closed tour whose order is given."""
    table, offset = _table(problem)
    return _tour(problem, _chosen(np.array(order, np.int32), table, offset, problem), 0, "poses")


def _first(problem: PoseProblem) -> PoseRing:
    from cellwright.engine.stages.sequencing.kernels.chain import exchange_edges

    table, offset = _table(problem)
    lines = cast(Matrix, _straight(problem))
    order = nearest_first(lines)
    if len(order) > 3:
        exchange_edges(order, lines)
    return _chosen(order, table, offset, problem)


def _of_fields(problem: PoseProblem, limits: Limits) -> list[PoseRing]:
    """A tour in each of the smoothest pose fields, with the poses chosen again for its order."""
    table, offset = _table(problem)
    n, start = len(problem.visits), nearest_first(_straight(problem))
    costs = [
        of_matrix(times(table, rows)) for rows in fields(table, offset, _straight(problem, FAR_M))[:FIELDS]
    ]
    quick = Limits(1, limits.seed, limits.interrupted)
    found = [(search_order(cost, start, quick), index) for index, cost in enumerate(costs)]
    found.sort(key=lambda each: (each[0].cost, each[1]))
    more = Limits(2000 + 8 * n, limits.seed, limits.interrupted)
    best = [search_order(costs[index], tour.order, more) for tour, index in found[:FINALISTS]]
    return [_chosen(tour.order, table, offset, problem) for tour in best]


def _together(problem: PoseProblem, ring: PoseRing, limits: Limits) -> tuple[PoseRing, int]:
    from cellwright.engine.stages.sequencing.kernels.poses import search

    n = len(problem.visits)
    table, offset = _table(problem)
    near, total = nearest(_straight(problem), NEAR), limits.work or 500 + 4 * n
    mean, seed, done = max(ring.time / n, 1e-6), limits.seed, 0
    warmth, cooling = WARM * mean, (COLD / WARM) ** (1 / total)
    order, rows, best = ring.order, ring.rows, ring
    while done < total and not limits.interrupted():
        seed, now = seed + 1, min(SLICE, total - done)
        found = search(order, rows, table, offset, near, now, warmth, cooling, seed)
        order, rows, warmth = found[3], found[4], found[5]
        if found[2] < best.time - 1e-12:
            best = _chosen(found[0], table, offset, problem)
        done += now
    return best, done


def _chosen(order: Ints, table: Floats, offset: Ints, problem: PoseProblem) -> PoseRing:
    """The best poses for an order. The tour is cut at the visit with the fewest poses, which saves time."""
    from cellwright.engine.stages.sequencing.kernels.poses import best_poses

    fewest = int(np.argmin([len(problem.poses[visit]) for visit in order]))
    turned, rows = np.roll(order, -fewest), np.zeros(len(order), np.int32)
    time = best_poses(turned, table, offset, len(order) > 1, rows)
    return PoseRing(np.roll(order, -int(np.argmin(order))), rows, time)


def _table(problem: PoseProblem) -> tuple[Floats, Ints]:
    """All poses as joint times (m, k), and the row at which the poses of each visit begin (n + 1,)."""
    counts = [len(each) for each in problem.poses]
    table = np.concatenate(problem.poses) / problem.speeds
    return np.ascontiguousarray(table), np.concatenate(([0], np.cumsum(counts))).astype(np.int32)


def _straight(problem: PoseProblem, nowhere_m: float = 0.0) -> Longs:
    """Lengths of straight lines (n, n) in micrometres; `nowhere_m` to and from a visit without a position."""
    n = len(problem.visits)
    places = np.array([visit.position or (0.0, 0.0, 0.0) for visit in problem.visits], float)
    lines = np.sqrt(((places[:, None] - places[None]) ** 2).sum(axis=2))
    nowhere = np.array([visit.position is None for visit in problem.visits])
    lines[nowhere, :] = lines[:, nowhere] = nowhere_m
    found: Longs = np.rint(lines.reshape(n, n) * 1e6).astype(np.int64)
    return found


def _tour(problem: PoseProblem, ring: PoseRing, work: int, method: str) -> Tour:
    _, offset = _table(problem)
    poses = tuple(int(ring.rows[visit] - offset[visit]) for visit in ring.order)
    order = tuple(int(visit) for visit in ring.order)
    return Tour(order, round(MICROSECONDS * ring.time), 0, work, method, poses)


def time_of(problem: PoseProblem, order: tuple[int, ...], poses: tuple[int, ...]) -> float:
    """How long a closed tour takes, in seconds. It is computed plainly, for checks."""
    where = [problem.poses[visit][pose] / problem.speeds for visit, pose in zip(order, poses, strict=True)]
    ways = zip(where, [*where[1:], where[0]], strict=True)
    return float(sum(np.abs(there - here).max() for here, there in ways))
