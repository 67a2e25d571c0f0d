"""ITA's two-level planner: lines of sight for the hand as a point, then the links.

In space the shortest way touches edges, not corners alone. So a node is where the way from here to
the goal over an edge of the box in sight is shortest. Nodes are made only where a line is blocked,
and A* picks the order.
"""

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from cellwright.engine.kernels.arrays import Bytes, Floats, Truths
from cellwright.engine.kernels.geometry.edges import Edges, free_edges
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.motion_values import PathQuery
from cellwright.engine.ports import MotionScene, MovingHand
from cellwright.engine.stages.motion.lattice_planner import FailedPath

MAX_SIGHT_NODES = 400  # nodes that are looked at
MAX_BOXES_IN_SEQUENCE = 3  # boxes in sequence, for one node, that stand before its own nodes
UNIT_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
BOX_EDGES = np.array(
    [
        (a, b)
        for a in range(8)
        for b in range(a)
        if np.abs(UNIT_CORNERS[a] - UNIT_CORNERS[b]).sum() == 2.0
    ]
)
SLACK_M = 1e-3  # nodes keep this far off the grown boxes


class LinesOfSight:
    """Boxes at poses (n, 4, 4) with half edges (n, 3) that already leave room for the hand."""

    def __init__(self, poses: Floats, halves: Floats) -> None:
        self.R, self.p, self.halves = poses[:, :3, :3], poses[:, :3, 3], halves

    def inside(self, point: Floats) -> Truths:
        """Which boxes (n,) a point (3,) is in."""
        local = np.einsum("nij,ni->nj", self.R, point - self.p)
        is_inside: Truths = (np.abs(local) < self.halves).all(axis=1)
        return is_inside

    def first(self, a: Floats, b: Floats) -> int:
        """The first box that the way from a point (3,) to another one goes through, or -1."""
        start = np.einsum("nij,ni->nj", self.R, a - self.p)
        direction = np.einsum("nij,i->nj", self.R, b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            ts = np.stack([(-self.halves - start) / direction, (self.halves - start) / direction])
        flat = np.abs(direction) < 1e-12
        beside = (flat & (np.abs(start) >= self.halves)).any(axis=1)
        enters = np.where(flat, -np.inf, ts.min(axis=0)).max(axis=1)
        leaves = np.where(flat, np.inf, ts.max(axis=0)).min(axis=1)
        hit = ~beside & (np.maximum(enters, 0.0) < np.minimum(leaves, 1.0) - 1e-12)
        return int(np.argmin(np.where(hit, enters, np.inf))) if hit.any() else -1

    def over_edges(self, box: int, a: Floats, goal: Floats) -> Floats:
        """For each edge of a box the point (12, 3) over which the way from `a` to the goal is
        shortest.
        """
        corners = self.p[box] + matmul(UNIT_CORNERS * (self.halves[box] + SLACK_M), self.R[box].T)
        first, along = corners[BOX_EDGES[:, 0]], corners[BOX_EDGES[:, 1]] - corners[BOX_EDGES[:, 0]]
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
        unit = along / length[:, None]
        at = np.array([np.einsum("ni,ni->n", end - first, unit) for end in (a, goal)])
        off = np.array(
            [
                np.linalg.norm(end - first - t[:, None] * unit, axis=1)
                for end, t in zip((a, goal), at, strict=True)
            ]
        )
        best = at[0] + (at[1] - at[0]) * off[0] / np.maximum(off.sum(axis=0), 1e-12)
        crossings: Floats = first + np.clip(best, 0.0, length)[:, None] * unit
        return crossings


def lines_of_sight(
    sights: LinesOfSight, start: Floats, goal: Floats, reached: Callable[[Floats], Truths]
) -> Floats | None:
    """The points (m, 3) from start to goal between which nothing stands; None if none are found.

    `reached` says which points (n, 3) the hand can get to (n,).
    """
    points, behind, cost = [start], [-1], [0.0]
    open_: list[tuple[float, int]] = [(norm(goal - start), 0)]
    seen = {_point_key(start)}
    for _ in range(MAX_SIGHT_NODES):
        if not open_:
            return None
        node = heapq.heappop(open_)[1]
        blocked = sights.first(points[node], goal)
        if blocked < 0:
            return np.array([*(points[n] for n in _trace_sights(behind, node)), goal])
        nodes = np.array(_nodes_in_sight(sights, points[node], goal, blocked, seen)).reshape(-1, 3)
        for point in nodes[reached(nodes)]:
            points.append(point)
            behind.append(node)
            cost.append(cost[node] + norm(point - points[node]))
            heapq.heappush(open_, (cost[-1] + norm(goal - point), len(points) - 1))
    return None


def _nodes_in_sight(
    sights: LinesOfSight, a: Floats, goal: Floats, blocked: int, seen: set[tuple[int, ...]]
) -> list[Floats]:
    """New nodes in sight from a point: on the box that stands in the way, and on those that
    stand before its nodes.
    """
    nodes: list[Floats] = []
    boxes, looked = [blocked], set()
    for _ in range(MAX_BOXES_IN_SEQUENCE):
        beyond: list[int] = []
        for box in boxes:
            looked.add(box)
            for point in sights.over_edges(box, a, goal):
                if _point_key(point) in seen or sights.inside(point).any():
                    continue
                before = sights.first(a, point)
                if before < 0:
                    seen.add(_point_key(point))
                    nodes.append(point)
                elif before not in looked:
                    beyond.append(before)
        boxes = sorted(set(beyond))
    return nodes


def _point_key(point: Floats) -> tuple[int, ...]:
    """Points nearer than a centimetre count as one."""
    return tuple(int(x) for x in np.rint(point * 100))


def _trace_sights(behind: list[int], node: int) -> list[int]:
    nodes = []
    while node >= 0:
        nodes.append(node)
        node = behind[node]
    return nodes[::-1]


BOX_ROOM_M = 0.1, 0.03  # what boxes grow by, for the hand: wide first, then narrow
BACK_OFF_M = 0.6  # how far the hand backs off along its own axis to get out of grown boxes
SUB_GOAL_DEPTH = 4  # sub-goals of sub-goals
ASIDE_M = 0.1, 0.25, 0.5  # how far beside the way sub-goals lie
MAX_TRIED = 6  # configurations of each place of the hand, and sub-goals of each gap, that are tried
VISIBILITY_GOALS = 4  # goals that are tried, the nearest first
NO_SIGHT = (
    "the hand, taken for a point, finds no way among the boxes around what stands in the cell"
)
NO_LINKS = "the links cannot follow the hand: no sub-goal leads past what is in the way"
BACK_OFF_DIRECTIONS = np.array(
    [
        (x, y, z)
        for x in (-1, 0, 1)
        for y in (-1, 0, 1)
        for z in (-1, 0, 1)
        if (x, y, z) != (0, 0, 0)
    ],
    dtype=float,
)
BACK_OFF_DIRECTIONS /= np.linalg.norm(BACK_OFF_DIRECTIONS, axis=1, keepdims=True)


@dataclass(frozen=True, slots=True, eq=False)
class _LinksQuery:
    """What the second level asks, and the most configurations it may look at."""

    ground: MotionScene
    lines: Edges
    hand: MovingHand
    query: PathQuery
    low: Floats
    high: Floats

    def free(self, first: Floats, second: Floats) -> bool:
        """Whether the straight line between configurations (k,) is free, its ends included."""
        out: Bytes = np.zeros(1, dtype=np.uint8)
        free_edges(
            self.lines, np.ascontiguousarray(first[None]), np.ascontiguousarray(second[None]), out
        )
        return bool(out[0])

    def spent(self) -> bool:
        """Whether the budget is used up."""
        return bool(self.lines.looked >= self.query.budget)


def visibility_plan(
    ground: MotionScene, lines: Edges, query: PathQuery, low: Floats, high: Floats, hand: MovingHand
) -> tuple[Floats | FailedPath, int]:
    """The configurations (m, k) of a path, and the number of its goal; else what is missing for
    the nearest goal.
    """
    asks = _LinksQuery(ground, lines, hand, query, low, high)
    order = np.argsort(np.linalg.norm(query.goals - query.start, axis=1), kind="stable")
    first = None
    for goal in order[:VISIBILITY_GOALS]:
        for room_m in BOX_ROOM_M:
            path = _path_to_goal(asks, query.goals[goal], room_m + query.margin_m)
            if not isinstance(path, FailedPath):
                return path, int(goal)
            first = first or (path, int(goal))
    assert first is not None
    return first


def _path_to_goal(asks: _LinksQuery, goal: Floats, room_m: float) -> Floats | FailedPath:
    """The path to one goal, with boxes that leave some room for the hand."""
    start = asks.query.start
    if asks.free(start, goal):
        return np.array([start, goal])
    T = asks.hand.poses(np.array([start, goal]))
    poses, halves = asks.hand.boxes()
    sights = LinesOfSight(poses, halves + room_m)
    ends = [_back_off_hand(sights, pose) for pose in T]

    def reached(points: Floats) -> Truths:
        """Which points (n, 3) the hand reaches, turned as at the start or as at the goal."""
        is_reached = np.zeros(len(points), dtype=bool)
        for pose in T:
            poses = np.repeat(pose[None], len(points), axis=0)
            poses[:, :3, 3] = points
            is_reached |= np.array(
                [len(q) > 0 for q in asks.hand.reaching(poses, start)], dtype=bool
            )
        return is_reached

    seen = lines_of_sight(sights, ends[0], ends[1], reached)
    if seen is None:
        return FailedPath(NO_SIGHT, np.array([start, goal]))
    return _follow_hand(asks, _poses_on_way(T, seen), goal)


def _back_off_hand(sights: LinesOfSight, T: Floats) -> Floats:
    """The place (3,) of a hand at a pose (4, 4), or the nearest one behind it along its axis
    that is in no box.
    """
    for back in np.linspace(0.0, BACK_OFF_M, 25):
        point: Floats = T[:3, 3] - back * T[:3, 2]
        if not sights.inside(point).any():
            return point
    position: Floats = T[:3, 3]
    return position


def _poses_on_way(T: Floats, seen: Floats) -> Floats:
    """Poses (m, 4, 4) of the hand at the nodes (m, 3) of its way; it turns evenly from the
    first pose to the last.
    """
    from scipy.spatial.transform import Rotation, Slerp

    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(seen, axis=0), axis=1)))
    share = along / max(along[-1], 1e-12)
    poses = np.repeat(np.eye(4)[None], len(seen), axis=0)
    poses[:, :3, :3] = Slerp([0.0, 1.0], Rotation.from_matrix(T[:, :3, :3]))(share).as_matrix()
    poses[:, :3, 3] = seen
    return poses


def _follow_hand(asks: _LinksQuery, poses: Floats, goal: Floats) -> Floats | FailedPath:
    """Configurations along the hand's way, joined one after another; those nearest to the last
    one are tried first.
    """
    path, missing = [asks.query.start], asks.query.start
    choices = [*asks.hand.reaching(poses, asks.query.start), goal[None]]
    for following in choices:
        following = following[~asks.ground.collides(following)] if len(following) else following
        near = following[np.argsort(np.abs(following - path[-1]).max(axis=1), kind="stable")][
            :MAX_TRIED
        ]
        for q in near:
            joined = _join_configurations(
                asks,
                path[-1],
                q,
                SUB_GOAL_DEPTH if following is choices[-1] or len(near) == 1 else 1,
            )
            if joined is not None:
                path += joined
                break
            missing = q
    if np.array_equal(path[-1], goal):
        return np.array(path)
    rest = _join_configurations(asks, path[-1], goal, SUB_GOAL_DEPTH)
    return np.array([*path, *rest]) if rest else FailedPath(NO_LINKS, np.array([path[-1], missing]))


def _join_configurations(
    asks: _LinksQuery, first: Floats, second: Floats, deep: int
) -> list[Floats] | None:
    """Configurations after `first` (k,) up to `second` (k,), with sub-goals where the straight
    line touches something.
    """
    if asks.free(first, second):
        return [second]
    if deep == 0 or asks.spent():
        return None
    for between in _sub_goals(asks, first, second)[:MAX_TRIED]:
        first_half = _join_configurations(asks, first, between, deep - 1 if deep < 2 else 0)
        if first_half is None:
            continue
        second_half = _join_configurations(asks, between, second, deep - 1)
        if second_half is not None:
            return [*first_half, *second_half]
    return None


def _sub_goals(asks: _LinksQuery, first: Floats, second: Floats) -> Floats:
    """Free configurations (n, k) with the hand beside the middle of a gap, those with the
    shortest way over them first.
    """
    middle = (first + second) / 2
    T = asks.hand.poses(middle[None])[0]
    poses = np.repeat(T[None], 1 + len(ASIDE_M) * len(BACK_OFF_DIRECTIONS), axis=0)
    poses[1:, :3, 3] += np.concatenate([aside * BACK_OFF_DIRECTIONS for aside in ASIDE_M])
    sub_goals = np.concatenate(asks.hand.reaching(poses, middle))
    sub_goals = sub_goals[((sub_goals >= asks.low) & (sub_goals <= asks.high)).all(axis=1)]
    if not len(sub_goals):
        return sub_goals
    sub_goals = sub_goals[~asks.ground.collides(sub_goals)]
    ways = np.linalg.norm(sub_goals - first, axis=1) + np.linalg.norm(second - sub_goals, axis=1)
    ordered: Floats = sub_goals[np.argsort(ways, kind="stable")]
    return ordered
