"""Lines of sight for a point among boxes: the shortest way of the hand if it were only a point (Lozano-Perez & Wesley 1979).

In space the shortest way touches edges, not corners alone. So a node is where the way from here to the goal over an edge of
the box in sight is shortest. Nodes are made only where a line is blocked, and A* picks the order.
"""

import heapq
from collections.abc import Callable
from itertools import product

import numpy as np

from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import Floats, Truths

MOST = 400  # nodes that are looked at
DEEP = 3  # boxes in sequence, for one node, that stand before its own nodes
CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
EDGES = np.array([(a, b) for a in range(8) for b in range(a) if np.abs(CORNERS[a] - CORNERS[b]).sum() == 2.0])
SLACK_M = 1e-3  # nodes keep this far off the grown boxes


class Sights:
    """Boxes at poses (n, 4, 4) with half edges (n, 3) that already leave room for the hand."""

    def __init__(self, poses: Floats, halves: Floats) -> None:
        self.R, self.p, self.halves = poses[:, :3, :3], poses[:, :3, 3], halves

    def inside(self, point: Floats) -> Truths:
        """Which boxes (n,) a point (3,) is in."""
        local = np.einsum("nij,ni->nj", self.R, point - self.p)
        found: Truths = (np.abs(local) < self.halves).all(axis=1)
        return found

    def first(self, a: Floats, b: Floats) -> int:
        """The first box that the way from a point (3,) to another one goes through, or -1."""
        start = np.einsum("nij,ni->nj", self.R, a - self.p)
        way = np.einsum("nij,i->nj", self.R, b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            ts = np.stack([(-self.halves - start) / way, (self.halves - start) / way])
        flat = np.abs(way) < 1e-12
        beside = (flat & (np.abs(start) >= self.halves)).any(axis=1)
        enters = np.where(flat, -np.inf, ts.min(axis=0)).max(axis=1)
        leaves = np.where(flat, np.inf, ts.max(axis=0)).min(axis=1)
        hit = ~beside & (np.maximum(enters, 0.0) < np.minimum(leaves, 1.0) - 1e-12)
        return int(np.argmin(np.where(hit, enters, np.inf))) if hit.any() else -1

    def over_edges(self, box: int, a: Floats, goal: Floats) -> Floats:
        """For each edge of a box the point (12, 3) over which the way from `a` to the goal is shortest."""
        corners = self.p[box] + matmul(CORNERS * (self.halves[box] + SLACK_M), self.R[box].T)
        first, along = corners[EDGES[:, 0]], corners[EDGES[:, 1]] - corners[EDGES[:, 0]]
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
        unit = along / length[:, None]
        at = np.array([np.einsum("ni,ni->n", each - first, unit) for each in (a, goal)])
        off = np.array(
            [
                np.linalg.norm(each - first - t[:, None] * unit, axis=1)
                for each, t in zip((a, goal), at, strict=True)
            ]
        )
        best = at[0] + (at[1] - at[0]) * off[0] / np.maximum(off.sum(axis=0), 1e-12)
        found: Floats = first + np.clip(best, 0.0, length)[:, None] * unit
        return found


def lines_of_sight(
    sights: Sights, start: Floats, goal: Floats, reached: Callable[[Floats], Truths]
) -> Floats | None:
    """The points (m, 3) from start to goal between which nothing stands; None if none are found.

    `reached` says which points (n, 3) the hand can get to (n,).
    """
    points, behind, cost = [start], [-1], [0.0]
    open_: list[tuple[float, int]] = [(norm(goal - start), 0)]
    seen = {_key(start)}
    for _ in range(MOST):
        if not open_:
            return None
        node = heapq.heappop(open_)[1]
        blocked = sights.first(points[node], goal)
        if blocked < 0:
            return np.array([*(points[n] for n in _back(behind, node)), goal])
        nodes = np.array(_nodes(sights, points[node], goal, blocked, seen)).reshape(-1, 3)
        for point in nodes[reached(nodes)]:
            points.append(point)
            behind.append(node)
            cost.append(cost[node] + norm(point - points[node]))
            heapq.heappush(open_, (cost[-1] + norm(goal - point), len(points) - 1))
    return None


def _nodes(sights: Sights, a: Floats, goal: Floats, blocked: int, seen: set[tuple[int, ...]]) -> list[Floats]:
    """New nodes in sight from a point: on the box that stands in the way, and on those that stand before its nodes."""
    found: list[Floats] = []
    boxes, looked = [blocked], set()
    for _ in range(DEEP):
        beyond: list[int] = []
        for box in boxes:
            looked.add(box)
            for point in sights.over_edges(box, a, goal):
                if _key(point) in seen or sights.inside(point).any():
                    continue
                before = sights.first(a, point)
                if before < 0:
                    seen.add(_key(point))
                    found.append(point)
                elif before not in looked:
                    beyond.append(before)
        boxes = sorted(set(beyond))
    return found


def _key(point: Floats) -> tuple[int, ...]:
    """Points nearer than a centimetre count as one."""
    return tuple(int(x) for x in np.rint(point * 100))


def _back(behind: list[int], node: int) -> list[int]:
    nodes = []
    while node >= 0:
        nodes.append(node)
        node = behind[node]
    return nodes[::-1]
