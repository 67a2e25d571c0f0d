"""Tours of visits with several poses each: order and poses chosen together or in turn.

A field begins with one pose of one visit and spreads along a shortest spanning tree of the
positions. Each visit takes the pose that is nearest to its parent's pose. In a field, only the
order is still open.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import cast

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Ints, Longs
from cellwright.engine.model.tour_problem import PoseProblem, Tour
from cellwright.engine.stages.sequencing.city_costs import nearest_cities, of_matrix
from cellwright.engine.stages.sequencing.first_tours import nearest_first_tour
from cellwright.engine.stages.sequencing.search_limits import TourLimits
from cellwright.engine.stages.sequencing.symmetric_tours import Matrix, tour_lower_bound
from cellwright.engine.stages.sequencing.symmetric_tours import search_tour as search_order

MAX_FIRST_POSES = 256  # at most this many poses of the first visit are tried


def pose_fields(table: Floats, offset: Ints, lines: Longs) -> list[Ints]:
    """A field for each pose of the first visit of the tree.

    The field whose poses change least along the tree comes first. `table` (m, k) has all poses as
    joint times; the poses of visit v begin at row offset[v]. `lines` (n, n) are distances. A field
    has one row number for each visit (n,).
    """
    tree = _spanning_tree(lines)
    candidate_fields = []
    for row in range(
        offset[tree[0][0]], min(offset[tree[0][0] + 1], offset[tree[0][0]] + MAX_FIRST_POSES)
    ):
        rows, change = np.zeros(len(lines), np.int32), 0.0
        rows[tree[0][0]] = row
        for visit, parent in tree[1:]:
            steps = np.abs(table[offset[visit] : offset[visit + 1]] - table[rows[parent]]).max(
                axis=1
            )
            nearest = int(np.argmin(steps))
            rows[visit], change = offset[visit] + nearest, change + float(steps[nearest])
        candidate_fields.append((change, row, rows))
    return [
        rows
        for _, _, rows in sorted(candidate_fields, key=lambda candidate_field: candidate_field[:2])
    ]


def _spanning_tree(lines: Longs) -> list[tuple[int, int]]:
    """The visits of a shortest spanning tree with their parents; parents come first, the root is
    the last visit.
    """
    n = len(lines)
    near, parent = np.full(n, np.iinfo(np.int64).max), np.zeros(n, np.intp)
    outside, at, tree = np.ones(n, bool), n - 1, []
    for _ in range(n):
        tree.append((at, int(parent[at])))
        outside[at] = False
        closer = outside & (lines[at] < near)
        near[closer], parent[closer] = lines[at][closer], at
        if outside.any():
            at = int(np.flatnonzero(outside)[np.argmin(near[outside])])
    return tree


def field_times(table: Floats, rows: Ints) -> Matrix:
    """The times (n, n) between the poses of a field, in whole microseconds."""
    q = table[rows]
    time_matrix: Matrix = np.rint(1e6 * np.abs(q[:, None] - q[None]).max(axis=2)).astype(np.int32)
    return time_matrix


MICROSECONDS_PER_S = 1e6
POSE_SEARCH_SLICE = 200
NEAR_VISITS = 10
FIELDS, FINALISTS = 24, 3
WARM, COLD = 0.1, 0.001  # times the mean time between two visits
FAR_POSITION_M = 1e6
MIN_RUINED_VISITS = 8  # ruin and recreate is left out if there are fewer visits


@dataclass(frozen=True, slots=True, eq=False)
class PoseRing:
    """A closed tour: the visits in order (n,), the row of each visit's pose in the table (n,), and
    the time (s).
    """

    order: Ints
    rows: Ints
    time: float


def tour_then_poses(problem: PoseProblem) -> Tour:
    """A tour of the positions by nearest neighbour and two-edge exchange, then the best poses
    for it (RoboTSP).
    """
    return _pose_tour(problem, _first_ring(problem), 0, "tour-then-poses")


def with_poses(problem: PoseProblem, limits: TourLimits = TourLimits()) -> Tour:
    """Order and poses together: tours of pose fields, then ruin and recreate on both, in `work`
    rounds.
    """
    ring, work = _first_ring(problem), 0
    if len(problem.visits) >= MIN_RUINED_VISITS and not limits.interrupted():
        ring = min((ring, *_of_fields(problem, limits)), key=lambda pose_ring: pose_ring.time)
        ring, work = _search_together(problem, ring, limits)
    tour = _pose_tour(problem, ring, work, "together")
    return replace(tour, lower_bound=pose_tour_bound(problem, tour.cost, limits))


def pose_tour_bound(problem: PoseProblem, upper: int, limits: TourLimits = TourLimits()) -> int:
    """What no closed tour takes less than, in microseconds; at most `upper`.

    From each visit to another one the nearest two of their poses count, so a visit may have one
    pose for the way in and another for the way out (Held & Karp 1970 on these times).
    """
    table, offset = _pose_table(problem)
    times, n = _least_times(table, offset), len(problem.visits)
    if n < 3:
        return min(upper, int(times.sum()))
    if times.max() > np.iinfo(np.int32).max // 4:
        return 0
    return min(upper, tour_lower_bound(times.astype(np.int32), upper, 0, limits.interrupted)[0])


def _least_times(table: Floats, offset: Ints) -> Longs:
    """The times (n, n) between the nearest poses of two visits, in microseconds, rounded down."""
    least = np.empty((len(offset) - 1, len(offset) - 1), np.int64)
    for visit, (low, high) in enumerate(pairwise(offset.tolist())):
        time_s: Floats = np.full(len(table), np.inf)
        for pose in table[low:high]:
            np.minimum(time_s, np.abs(table - pose).max(axis=1), out=time_s)
        microseconds = np.minimum.reduceat(time_s, offset[:-1]) * MICROSECONDS_PER_S
        least[visit] = np.floor(microseconds * (1 - 1e-12))
    np.fill_diagonal(least, 0)
    symmetric: Longs = np.minimum(least, least.T)
    return symmetric


def poses_for(problem: PoseProblem, order: tuple[int, ...]) -> Tour:
    """The best poses for a closed tour whose order is given."""
    table, offset = _pose_table(problem)
    return _pose_tour(
        problem, _choose_poses(np.array(order, np.int32), table, offset, problem), 0, "poses"
    )


def _first_ring(problem: PoseProblem) -> PoseRing:
    from cellwright.engine.stages.sequencing.kernels.chain import exchange_edges

    table, offset = _pose_table(problem)
    lines = cast(Matrix, _straight_lengths(problem))
    order = nearest_first_tour(lines)
    if len(order) > 3:
        exchange_edges(order, lines)
    return _choose_poses(order, table, offset, problem)


def _of_fields(problem: PoseProblem, limits: TourLimits) -> list[PoseRing]:
    """A tour in each of the smoothest pose fields, with the poses chosen again for its order."""
    table, offset = _pose_table(problem)
    n, start = len(problem.visits), nearest_first_tour(_straight_lengths(problem))
    costs = [
        of_matrix(field_times(table, rows))
        for rows in pose_fields(table, offset, _straight_lengths(problem, FAR_POSITION_M))[:FIELDS]
    ]
    quick = TourLimits(1, limits.seed, limits.interrupted)
    field_tours = [(search_order(cost, start, quick), index) for index, cost in enumerate(costs)]
    field_tours.sort(key=lambda field_tour: (field_tour[0].cost, field_tour[1]))
    more = TourLimits(2000 + 8 * n, limits.seed, limits.interrupted)
    best = [search_order(costs[index], tour.order, more) for tour, index in field_tours[:FINALISTS]]
    return [_choose_poses(tour.order, table, offset, problem) for tour in best]


def _search_together(
    problem: PoseProblem, ring: PoseRing, limits: TourLimits
) -> tuple[PoseRing, int]:
    from cellwright.engine.stages.sequencing.kernels.poses import search

    n = len(problem.visits)
    table, offset = _pose_table(problem)
    near, total = (
        nearest_cities(_straight_lengths(problem), NEAR_VISITS),
        limits.work or 500 + 4 * n,
    )
    mean, seed, done = max(ring.time / n, 1e-6), limits.seed, 0
    warmth, cooling = WARM * mean, (COLD / WARM) ** (1 / total)
    order, rows, best = ring.order, ring.rows, ring
    while done < total and not limits.interrupted():
        seed, now = seed + 1, min(POSE_SEARCH_SLICE, total - done)
        search_result = search(order, rows, table, offset, near, now, warmth, cooling, seed)
        order, rows, warmth = search_result[3], search_result[4], search_result[5]
        if search_result[2] < best.time - 1e-12:
            best = _choose_poses(search_result[0], table, offset, problem)
        done += now
    return best, done


def _choose_poses(order: Ints, table: Floats, offset: Ints, problem: PoseProblem) -> PoseRing:
    """The best poses for an order.

    The tour is cut at the visit with the fewest poses, which saves time.
    """
    from cellwright.engine.stages.sequencing.kernels.poses import best_poses

    fewest = int(np.argmin([len(problem.poses[visit]) for visit in order]))
    turned, rows = np.roll(order, -fewest), np.zeros(len(order), np.int32)
    time = best_poses(turned, table, offset, len(order) > 1, rows)
    return PoseRing(np.roll(order, -int(np.argmin(order))), rows, time)


def _pose_table(problem: PoseProblem) -> tuple[Floats, Ints]:
    """All poses as joint times (m, k), and the row at which the poses of each visit begin (n +
    1,).
    """
    counts = [len(visit_poses) for visit_poses in problem.poses]
    table = np.concatenate(problem.poses) / problem.speeds
    return np.ascontiguousarray(table), np.concatenate(([0], np.cumsum(counts))).astype(np.int32)


def _straight_lengths(problem: PoseProblem, nowhere_m: float = 0.0) -> Longs:
    """Lengths of straight lines (n, n) in micrometres; `nowhere_m` to and from a visit without
    a position.
    """
    n = len(problem.visits)
    places = np.array([visit.position or (0.0, 0.0, 0.0) for visit in problem.visits], float)
    lines = np.sqrt(((places[:, None] - places[None]) ** 2).sum(axis=2))
    nowhere = np.array([visit.position is None for visit in problem.visits])
    lines[nowhere, :] = lines[:, nowhere] = nowhere_m
    lengths: Longs = np.rint(lines.reshape(n, n) * 1e6).astype(np.int64)
    return lengths


def _pose_tour(problem: PoseProblem, ring: PoseRing, work: int, method: str) -> Tour:
    _, offset = _pose_table(problem)
    poses = tuple(int(ring.rows[visit] - offset[visit]) for visit in ring.order)
    order = tuple(int(visit) for visit in ring.order)
    return Tour(order, round(MICROSECONDS_PER_S * ring.time), 0, work, method, poses)


def pose_tour_time(problem: PoseProblem, order: tuple[int, ...], poses: tuple[int, ...]) -> float:
    """How long a closed tour takes, in seconds. It is computed plainly, for checks."""
    where = [
        problem.poses[visit][pose] / problem.speeds
        for visit, pose in zip(order, poses, strict=True)
    ]
    ways = zip(where, [*where[1:], where[0]], strict=True)
    return float(sum(np.abs(pose_after - pose_before).max() for pose_before, pose_after in ways))
