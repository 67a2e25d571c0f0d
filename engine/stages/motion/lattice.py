"""Ways through the space of a few joints: a lattice of configurations, looked at only where the search comes by (A*).

It serves a space of three joints, where a lattice can still be searched to its end. The other joints keep their values.
"""

import heapq
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from cellwright.engine.kernels.arrays import Bytes
from cellwright.engine.kernels.geometry.edges import Edges, free_edges
from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.ports import MotionGround

SPACING = 0.15  # rad or m between neighbours
MOST = 4_000  # nodes whose neighbours are looked at
EAGER = 1.5  # how much more the distance to the goal counts than the way behind: fewer nodes, paths a little longer
SHELLS = 12  # how many spacings away a free configuration is looked for

Node = tuple[int, ...]


class Lattice:
    """Configurations at a spacing around `origin` (k,) in the joints `free`, within limits (k,)."""

    def __init__(self, origin: Floats, free: Sequence[int], low: Floats, high: Floats) -> None:
        self.origin, self.free, self.low, self.high = origin, list(free), low, high
        around = product((-1, 0, 1), repeat=len(self.free))
        self.steps = np.array([step for step in around if any(step)], dtype=np.int64)

    def at(self, nodes: Longs) -> Floats:
        """The configurations (n, k) of nodes (n, free joints)."""
        where = np.repeat(self.origin[None], len(nodes), axis=0)
        where[:, self.free] += SPACING * nodes
        return where

    def within(self, where: Floats) -> Truths:
        """Whether configurations (n, k) are within the limits (n,)."""
        own = where[:, self.free]
        inside = (own >= self.low[self.free]) & (own <= self.high[self.free])
        return np.asarray(inside.all(axis=1))


def nearest_free(ground: MotionGround, lattice: Lattice, margin_m: float) -> Floats | None:
    """The configuration (k,) of the lattice nearest to its origin that is free; None if none is near."""
    for nodes in _shells(len(lattice.free)):
        where = lattice.at(nodes)
        where = where[lattice.within(where)]
        free = ground.clearance(where, margin_m + 1e-9) > margin_m if margin_m else ~ground.collides(where)
        if free.any():
            found: Floats = where[int(np.argmax(free))]
            return found
    return None


def _shells(count: int) -> Iterator[Longs]:
    """All nodes in stretches, the nearest to the origin first."""
    axis = np.arange(-SHELLS, SHELLS + 1, dtype=np.int64)
    grid = np.stack(np.meshgrid(*[axis] * count, indexing="ij"), axis=-1).reshape(-1, count)
    away = (grid**2).sum(axis=1)
    ordered = grid[np.argsort(away, kind="stable")]
    ordered = ordered[np.sort(away) <= SHELLS**2]
    return (ordered[n : n + 256] for n in range(0, len(ordered), 256))


def way(lines: Edges, lattice: Lattice, goal: Floats) -> Floats | None:
    """Configurations (m, k) from the lattice's origin to `goal` (k,) by free lines; None if the lattice has no way.

    The goal differs from the origin in the joints that are free alone.
    """
    straight = np.array([lattice.origin, goal])
    if _free(lines, straight[:1], straight[1:])[0]:
        return straight
    root: Node = (0,) * len(lattice.free)
    behind: dict[Node, tuple[float, Node | None]] = {root: (0.0, None)}
    open_: list[tuple[float, int, Node]] = [(0.0, 0, root)]
    done: set[Node] = set()
    while open_ and len(done) < MOST:
        node = heapq.heappop(open_)[2]
        if node in done:
            continue
        done.add(node)
        here = lattice.at(np.array([node]))
        if (
            float(np.abs(goal - here[0])[lattice.free].max()) <= SPACING
            and _free(lines, here, straight[1:])[0]
        ):
            return np.vstack([lattice.at(np.array(_back(behind, node))), goal[None]])
        for cost, estimate, other in _expanded(lines, lattice, node, behind[node][0], goal, done):
            if other not in behind or cost < behind[other][0] - 1e-12:
                behind[other] = (cost, node)
                heapq.heappush(open_, (cost + EAGER * estimate, len(behind), other))
    return None


def _expanded(
    lines: Edges, lattice: Lattice, node: Node, cost: float, goal: Floats, done: set[Node]
) -> list[tuple[float, float, Node]]:
    """The neighbours that a free line leads to: the cost up to there, the distance to the goal, the node."""
    nodes = np.array([each for each in np.array(node) + lattice.steps if tuple(each) not in done])
    nodes = nodes.reshape(-1, len(node))
    where = lattice.at(nodes)
    inside = lattice.within(where)
    nodes, where = nodes[inside], where[inside]
    free = _free(lines, np.repeat(lattice.at(np.array([node])), len(nodes), axis=0), where)
    ways = SPACING * np.sqrt(((nodes - np.array(node)) ** 2).sum(axis=1))
    left = np.linalg.norm(goal - where, axis=1)
    rows = zip(ways, left, nodes, free, strict=True)
    return [(cost + float(w), float(e), tuple(map(int, each))) for w, e, each, ok in rows if ok]


def _free(lines: Edges, first: Floats, second: Floats) -> Bytes:
    """Which lines between configurations (n, k) are free (n,), their ends included."""
    found = np.zeros(len(first), dtype=np.uint8)
    free_edges(lines, np.ascontiguousarray(first), np.ascontiguousarray(second), found)
    return found


def _back(behind: dict[Node, tuple[float, Node | None]], node: Node) -> list[Node]:
    """The nodes from the root to a node."""
    nodes: list[Node] = []
    at: Node | None = node
    while at is not None:
        nodes.append(at)
        at = behind[at][1]
    return nodes[::-1]
