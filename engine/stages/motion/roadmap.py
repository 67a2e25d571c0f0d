"""A roadmap: configurations and the straight lines between them, each proved to be free or not; kept while the world changes.

Travel times between many pairs are read from it. No path is quicker than the straight line would be if nothing were in the
way, and the route on the roadmap can be driven, so the true time is between these two.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.geometry.edges import free_edges
from cellwright.engine.kernels.geometry.proof import proved as proved_lines
from cellwright.engine.kernels.linear import norm
from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.model.motion import FINEST_M, Moved, Query
from cellwright.engine.ports import MotionGround
from cellwright.engine.stages.motion.planner import plan
from cellwright.engine.stages.motion.trajectory import Limits, least_times

CORES = 2
FAR = 1.5  # a route that takes so many times the least time is planned for by itself
LINES_AT_ONCE = 512
BUDGET = 50_000  # configurations looked at for a pair that has no good route


@dataclass(frozen=True, slots=True, eq=False)
class Roadmap:
    """Configurations (n, k), edges (e, 2) between them, and which are proved to be free (e,), with a margin.

    They are looked at every `step` first. An edge that cannot be proved counts as blocked.
    """

    nodes: Floats
    edges: Longs
    free: Truths
    step: float = 1 / 32
    margin_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Travels:
    """Times (s) for pairs (p, 2): that of a route that is proved to be free, infinite where none is known, and the least that any can take.

    `planned` of them had to be planned for one by one. `routes` are the nodes on the way of each.
    """

    pairs: Longs
    time_s: Floats
    least_s: Floats
    routes: tuple[tuple[int, ...], ...]
    planned: int

    def error(self) -> float:
        """By how much the times may be too long, in all, as a share of them; of pairs that have a route."""
        known = np.isfinite(self.time_s)
        whole = float(self.time_s[known].sum())
        return float((self.time_s - self.least_s)[known].sum()) / whole if whole else 0.0


def neighbours(nodes: Floats, limits: Limits, count: int) -> Longs:
    """The pairs (p, 2) of nodes (n, k) that are among the `count` nearest of one of them, in time; the lesser number first."""
    from scipy.spatial import cKDTree

    scaled = nodes / limits.speed
    found = cKDTree(scaled).query(scaled, k=min(count + 1, len(nodes)), p=np.inf)[1].reshape(len(nodes), -1)
    first = np.repeat(np.arange(len(nodes)), found.shape[1])
    pairs = np.sort(np.stack([first, found.ravel()], axis=1), axis=1)
    unique: Longs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0).astype(np.int64)
    return unique


def mapped(
    ground: MotionGround, nodes: Floats, edges: Longs, step: float = 1 / 32, margin_m: float = 0.0
) -> Roadmap:
    """The roadmap of nodes (n, k), each edge (e, 2) looked at whole, and proved."""
    return Roadmap(nodes, edges, _proved(ground, nodes, edges, step, margin_m), step, margin_m)


def _proved(ground: MotionGround, nodes: Floats, edges: Longs, step: float, margin_m: float) -> Truths:
    """Which edges (e,) are proved to be free."""
    free = _looked(ground, nodes, edges, step, margin_m)
    proof = ground.proof(margin_m, FINEST_M)
    for n in np.nonzero(free)[0]:
        free[n] = proved_lines(proof, np.ascontiguousarray(nodes[edges[n]])) == 1
    return free


def _looked(ground: MotionGround, nodes: Floats, edges: Longs, step: float, margin_m: float) -> Truths:
    """Which edges (e,) are free; the answers do not depend on how they are shared out among the cores."""

    def look(rows: Longs) -> Truths:
        out = np.zeros(len(rows), dtype=np.uint8)
        first, second = (np.ascontiguousarray(nodes[rows[:, side]]) for side in range(2))
        free_edges(ground.lines(step, margin_m), first, second, out)
        return out.astype(bool)

    ground.lines(step, margin_m)  # packs the scene once, before threads ask for it
    stretches = [edges[n : n + LINES_AT_ONCE] for n in range(0, len(edges), LINES_AT_ONCE)]
    if len(stretches) == 1:
        return look(edges)
    with ThreadPoolExecutor(CORES) as pool:
        found = list(pool.map(look, stretches))
    return np.concatenate([np.zeros(0, dtype=bool), *found])


def repaired(roadmap: Roadmap, before: MotionGround, ground: MotionGround) -> tuple[Roadmap, int]:
    """The roadmap that held on the ground `before`, for `ground`; and how many edges had to be looked at again."""
    touched = stale(roadmap, before, ground)
    free = roadmap.free.copy()
    free[touched] = _proved(ground, roadmap.nodes, roadmap.edges[touched], roadmap.step, roadmap.margin_m)
    return replace(roadmap, free=free), int(touched.sum())


def stale(roadmap: Roadmap, before: MotionGround, ground: MotionGround) -> Truths:
    """Which edges (e,) come near what is not the same on two grounds; all others are free on both, or on none.

    Where the joints differ, all edges count as near.
    """
    near = ground.changed_since(before)
    if near is None:
        return np.ones(len(roadmap.edges), dtype=bool)
    room = roadmap.margin_m + _farthest(near, roadmap.step) + 2.0 * FINEST_M
    return ~_looked(near, roadmap.nodes, roadmap.edges, roadmap.step, room)


def _farthest(ground: MotionGround, step: float) -> float:
    """How far (m) any point moves at most on a line of this length (rad, m) in the space of the joints."""
    none, each = np.zeros(ground.scene.joints.count), np.diag(np.full(ground.scene.joints.count, step))
    return norm(np.array([ground.travel(none, one) for one in each]))


def travels(
    ground: MotionGround, roadmap: Roadmap, pairs: Longs, limits: Limits, own: slice, budget: int = BUDGET
) -> tuple[Travels, Roadmap]:
    """The times of pairs (p, 2), and the roadmap with what had to be planned for them.

    The arm rests at each node of a route. Pairs without a good route are planned for by themselves, with a `budget` each.
    """
    ends = [roadmap.nodes[pairs[:, side]] for side in range(2)]
    least = least_times(ends[0][:, own], ends[1][:, own], limits)
    time, routes = _routed(roadmap, pairs, limits, own)
    poor = np.nonzero(~(time <= FAR * least + 1e-9))[0]
    tried = 0
    for n in poor:
        if time[n] <= FAR * least[n] + 1e-9:
            continue
        tried += 1
        query = Query(
            ends[0][n],
            ends[1][n][None],
            step=roadmap.step,
            margin_m=roadmap.margin_m,
            budget=budget,
            moving=tuple(range(own.start, own.stop)),
        )
        found = plan(ground, query)
        if isinstance(found, Moved) and found.proved:
            roadmap, route = _added(roadmap, pairs[n], found.path)
            takes = float(least_times(found.path[:-1, own], found.path[1:, own], limits).sum())
            if takes < time[n]:
                time[n], routes[n] = takes, route
    return Travels(pairs, time, least, tuple(routes), tried), roadmap


def _added(roadmap: Roadmap, pair: Longs, path: Floats) -> tuple[Roadmap, tuple[int, ...]]:
    """The roadmap with the inner configurations of a free path (m, k) between two of its nodes, and the route."""
    count = len(roadmap.nodes)
    route = (int(pair[0]), *range(count, count + len(path) - 2), int(pair[1]))
    edges = np.sort(np.array([route[:-1], route[1:]], dtype=np.int64).T, axis=1)
    added = replace(
        roadmap,
        nodes=np.concatenate([roadmap.nodes, path[1:-1]]),
        edges=np.concatenate([roadmap.edges, edges]),
        free=np.concatenate([roadmap.free, np.ones(len(edges), dtype=bool)]),
    )
    return added, route


def _routed(
    roadmap: Roadmap, pairs: Longs, limits: Limits, own: slice
) -> tuple[Floats, list[tuple[int, ...]]]:
    """The times (p,) of the quickest routes over free edges, and their nodes; straight ones where the edge itself is free."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra

    edges = roadmap.edges[roadmap.free]
    takes = least_times(roadmap.nodes[edges[:, 0]][:, own], roadmap.nodes[edges[:, 1]][:, own], limits)
    direct = {(int(a), int(b)): float(t) for (a, b), t in zip(edges, takes, strict=True)}
    keys = [(int(min(pair)), int(max(pair))) for pair in pairs]
    time = np.array([direct.get(key, np.inf) for key in keys])
    routes = [(int(a), int(b)) if t < np.inf else () for (a, b), t in zip(pairs, time, strict=True)]
    missing = np.nonzero(~np.isfinite(time))[0]
    if not len(missing):
        return time, list(routes)
    count = len(roadmap.nodes)
    graph = csr_matrix((np.maximum(takes, 1e-12), (edges[:, 0], edges[:, 1])), shape=(count, count))
    sources = np.unique(pairs[missing, 0])
    found, before = dijkstra(graph, directed=False, indices=sources, return_predecessors=True)
    row = {int(source): n for n, source in enumerate(sources)}
    wider: list[tuple[int, ...]] = list(routes)
    for n in missing:
        at = row[int(pairs[n, 0])]
        time[n] = found[at, pairs[n, 1]]
        wider[n] = back(before[at], int(pairs[n, 1])) if np.isfinite(time[n]) else ()
    return time, wider


def back(before: Longs, node: int) -> tuple[int, ...]:
    """The nodes up to one, by their predecessors."""
    found = []
    while node >= 0:
        found.append(node)
        node = int(before[node])
    return tuple(found[::-1])
