"""Roadmaps: configurations and proved lines between them, kept over motions and world changes.

Travel times between many pairs are read from it. No path is quicker than the straight line would be
if nothing were in the way, and the route on the roadmap can be driven, so the true time is between
these two.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.geometry.edges import free_edges
from cellwright.engine.kernels.geometry.proof import proved as proved_lines
from cellwright.engine.kernels.linear import norm
from cellwright.engine.kernels.motion.shorten import Route, shorten
from cellwright.engine.model.motion_values import (
    FINEST_M,
    Answer,
    Moved,
    PathQuery,
    RefusedQuery,
    Strategy,
)
from cellwright.engine.ports import MotionScene, MovingHand
from cellwright.engine.stages.motion.path_planner import plan_path, try_path
from cellwright.engine.stages.motion.path_proofs import prove_moved
from cellwright.engine.stages.motion.timed_paths import JointLimits, least_times

ROADMAP_CORES = 2
# a route that takes so many times the least time is planned for by itself
ROUTE_DETOUR_FACTOR = 1.5
LINES_AT_ONCE = 512
PAIR_BUDGET = 50_000  # configurations looked at for a pair that has no good route


@dataclass(frozen=True, slots=True, eq=False)
class Roadmap:
    """Configurations (n, k), edges (e, 2) between them, and which are proved to be free (e,), with
    a margin.

    They are looked at every `step` first. An edge that cannot be proved counts as blocked.
    """

    nodes: Floats
    edges: Longs
    free: Truths
    step: float = 1 / 32
    margin_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class TravelTimes:
    """Times (s) for pairs (p, 2): that of a route that is proved to be free, infinite where none is
    known, and the least that any can take.

    `planned` of them had to be planned for one by one. `routes` are the nodes on the way of each.
    """

    pairs: Longs
    time_s: Floats
    least_s: Floats
    routes: tuple[tuple[int, ...], ...]
    planned: int

    def error(self) -> float:
        """By how much the times may be too long, in all, as a share of them; of pairs that have
        a route.
        """
        finite = np.isfinite(self.time_s)
        whole = float(self.time_s[finite].sum())
        return float((self.time_s - self.least_s)[finite].sum()) / whole if whole else 0.0


def nearest_node_pairs(nodes: Floats, limits: JointLimits, count: int) -> Longs:
    """The pairs (p, 2) of nodes (n, k) that are among the `count` nearest of one of them, in
    time; the lesser number first.
    """
    from scipy.spatial import cKDTree

    scaled = nodes / limits.speed
    nearest = (
        cKDTree(scaled)
        .query(scaled, k=min(count + 1, len(nodes)), p=np.inf)[1]
        .reshape(len(nodes), -1)
    )
    first = np.repeat(np.arange(len(nodes)), nearest.shape[1])
    pairs = np.sort(np.stack([first, nearest.ravel()], axis=1), axis=1)
    unique: Longs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0).astype(np.int64)
    return unique


def map_nodes(
    ground: MotionScene, nodes: Floats, edges: Longs, step: float = 1 / 32, margin_m: float = 0.0
) -> Roadmap:
    """The roadmap of nodes (n, k), each edge (e, 2) looked at whole, and proved."""
    return Roadmap(
        nodes, edges, _proved_edges(ground, nodes, edges, step, margin_m), step, margin_m
    )


def _proved_edges(
    ground: MotionScene, nodes: Floats, edges: Longs, step: float, margin_m: float
) -> Truths:
    """Which edges (e,) are proved to be free."""
    free = _free_edges(ground, nodes, edges, step, margin_m)
    proof = ground.proof(margin_m, FINEST_M)
    for n in np.nonzero(free)[0]:
        free[n] = proved_lines(proof, np.ascontiguousarray(nodes[edges[n]])) == 1
    return free


def _free_edges(
    ground: MotionScene, nodes: Floats, edges: Longs, step: float, margin_m: float
) -> Truths:
    """Which edges (e,) are free; the answers do not depend on how they are shared out among the
    cores.
    """

    def look(rows: Longs) -> Truths:
        out = np.zeros(len(rows), dtype=np.uint8)
        first, second = (np.ascontiguousarray(nodes[rows[:, side]]) for side in range(2))
        free_edges(ground.lines(step, margin_m), first, second, out)
        return out.astype(bool)

    ground.lines(step, margin_m)  # packs the scene once, before threads ask for it
    stretches = [edges[n : n + LINES_AT_ONCE] for n in range(0, len(edges), LINES_AT_ONCE)]
    if len(stretches) == 1:
        return look(edges)
    with ThreadPoolExecutor(ROADMAP_CORES) as pool:
        answers = list(pool.map(look, stretches))
    return np.concatenate([np.zeros(0, dtype=bool), *answers])


def repair_roadmap(
    roadmap: Roadmap, before: MotionScene, ground: MotionScene
) -> tuple[Roadmap, int]:
    """The roadmap that held on the ground `before`, for `ground`; and how many edges had to be
    looked at again.
    """
    touched = stale_edges(roadmap, before, ground)
    free = roadmap.free.copy()
    free[touched] = _proved_edges(
        ground, roadmap.nodes, roadmap.edges[touched], roadmap.step, roadmap.margin_m
    )
    return replace(roadmap, free=free), int(touched.sum())


def stale_edges(roadmap: Roadmap, before: MotionScene, ground: MotionScene) -> Truths:
    """Which edges (e,) come near what is not the same on two grounds; all others are free on both,
    or on none.

    Where the joints differ, all edges count as near.
    """
    near = ground.changed_since(before)
    if near is None:
        return np.ones(len(roadmap.edges), dtype=bool)
    room = roadmap.margin_m + _farthest_travel(near, roadmap.step) + 2.0 * FINEST_M
    return ~_free_edges(near, roadmap.nodes, roadmap.edges, roadmap.step, room)


def _farthest_travel(ground: MotionScene, step: float) -> float:
    """How far (m) any point moves at most on a line of this length (rad, m) in the space of the
    joints.
    """
    none, joint_steps = (
        np.zeros(ground.scene.joints.count),
        np.diag(np.full(ground.scene.joints.count, step)),
    )
    return norm(np.array([ground.travel(none, joint_step) for joint_step in joint_steps]))


def travel_times(
    ground: MotionScene,
    roadmap: Roadmap,
    pairs: Longs,
    limits: JointLimits,
    own: slice,
    budget: int = PAIR_BUDGET,
) -> tuple[TravelTimes, Roadmap]:
    """The times of pairs (p, 2), and the roadmap with what had to be planned for them.

    The arm rests at each node of a route. Pairs without a good route are planned for by themselves,
    with a `budget` each.
    """
    ends = [roadmap.nodes[pairs[:, side]] for side in range(2)]
    least = least_times(ends[0][:, own], ends[1][:, own], limits)
    time, routes = _quickest_routes(roadmap, pairs, limits, own)
    poor = np.nonzero(~(time <= ROUTE_DETOUR_FACTOR * least + 1e-9))[0]
    tried = 0
    for n in poor:
        if time[n] <= ROUTE_DETOUR_FACTOR * least[n] + 1e-9:
            continue
        tried += 1
        query = PathQuery(
            ends[0][n],
            ends[1][n][None],
            step=roadmap.step,
            margin_m=roadmap.margin_m,
            budget=budget,
            moving=tuple(range(own.start, own.stop)),
        )
        answer = plan_path(ground, query)
        if isinstance(answer, Moved) and answer.proved:
            roadmap, route = _add_path(roadmap, pairs[n], answer.path)
            takes = float(least_times(answer.path[:-1, own], answer.path[1:, own], limits).sum())
            if takes < time[n]:
                time[n], routes[n] = takes, route
    return TravelTimes(pairs, time, least, tuple(routes), tried), roadmap


def _add_path(roadmap: Roadmap, pair: Longs, path: Floats) -> tuple[Roadmap, tuple[int, ...]]:
    """The roadmap with the inner configurations of a free path (m, k) between two of its nodes,
    and the route.
    """
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


def _quickest_routes(
    roadmap: Roadmap, pairs: Longs, limits: JointLimits, own: slice
) -> tuple[Floats, list[tuple[int, ...]]]:
    """The times (p,) of the quickest routes over free edges, and their nodes; straight ones
    where the edge itself is free.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra

    edges = roadmap.edges[roadmap.free]
    takes = least_times(
        roadmap.nodes[edges[:, 0]][:, own], roadmap.nodes[edges[:, 1]][:, own], limits
    )
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
    times, before = dijkstra(graph, directed=False, indices=sources, return_predecessors=True)
    row = {int(source): n for n, source in enumerate(sources)}
    wider: list[tuple[int, ...]] = list(routes)
    for n in missing:
        at = row[int(pairs[n, 0])]
        time[n] = times[at, pairs[n, 1]]
        wider[n] = nodes_up_to(before[at], int(pairs[n, 1])) if np.isfinite(time[n]) else ()
    return time, wider


def nodes_up_to(before: Longs, node: int) -> tuple[int, ...]:
    """The nodes up to one, by their predecessors."""
    nodes = []
    while node >= 0:
        nodes.append(node)
        node = int(before[node])
    return tuple(nodes[::-1])


NEAREST_NODES = 12  # nodes that an end is joined to, the nearest first
MAX_ROUTES = 40  # routes that are looked at for one motion
# nodes of one roadmap: when there are more, the older half of them is forgotten
MAX_ROADMAP_NODES = 600
# configurations that the planner looks at before the roadmap is asked
PLANNER_FIRST_BUDGET = 20_000


@dataclass(slots=True)
class MotionWork:
    """How motions were found: by the planner soon, by the roadmap, or by the planner after all.

    So many edges were `seen`, which is looked at and proved, and so many were `kept` as they were
    when the world had changed.
    """

    soon: int = 0
    routed: int = 0
    alone: int = 0
    seen: int = 0
    kept: int = 0


@dataclass(slots=True, eq=False)
class _KnownRoadmap:
    """A roadmap on a ground. Whether an `unseen` edge (e,) is free there is not known yet; all
    others are as the roadmap says.

    `later` are paths that were found on this and other grounds since.
    """

    ground: MotionScene
    roadmap: Roadmap
    unseen: Truths
    later: list[Floats] = field(default_factory=list)


@dataclass(eq=False)
class KeptRoadmaps:
    """The roadmaps of the arms of a cell. Each belongs to one stand of an arm, and to the values of
    the joints that rest.

    The planner looks at `soon` configurations before a roadmap is asked. A roadmap has at most
    `most` nodes.
    """

    soon: int = PLANNER_FIRST_BUDGET
    most: int = MAX_ROADMAP_NODES
    work: MotionWork = field(default_factory=MotionWork)
    _known: dict[bytes, _KnownRoadmap] = field(default_factory=dict)

    def plan(self, ground: MotionScene, query: PathQuery, hand: MovingHand | None = None) -> Answer:
        """As the planner answers.

        The path may be another one, as it may go where earlier motions went.
        """
        if query.strategy is not Strategy.CONNECT or query.upright_rad > 0.0 or not query.proved:
            return plan_path(ground, query, hand)
        answer = self._planned(ground, query, hand)
        if isinstance(answer, Moved) and answer.proved and len(answer.path) > 1:
            self._at(ground, query).later.append(answer.path)
        return answer

    def _planned(self, ground: MotionScene, query: PathQuery, hand: MovingHand | None) -> Answer:
        soon = try_path(ground, replace(query, budget=min(self.soon, query.budget)), hand)
        if isinstance(soon, RefusedQuery) or (isinstance(soon, Moved) and soon.proved):
            self.work.soon += 1
            return soon
        routed = self._routed(ground, query)
        if routed is not None:
            self.work.routed += 1
            return routed
        self.work.alone += 1
        return plan_path(ground, query, hand)

    def _at(self, ground: MotionScene, query: PathQuery) -> _KnownRoadmap:
        """What is known for where the arm stands."""
        key = _stand_key(ground, query)
        if key not in self._known:
            none, no_edges = np.zeros((0, 2), dtype=np.int64), np.zeros(0, dtype=bool)
            roadmap = Roadmap(query.start[None][:0], none, no_edges, query.step, query.margin_m)
            self._known[key] = _KnownRoadmap(ground, roadmap, no_edges)
        return self._known[key]

    def _repaired(self, ground: MotionScene, query: PathQuery) -> _KnownRoadmap:
        """What is known on a ground now: edges near what has changed, and those of new paths,
        are unseen.
        """
        known_roadmap = self._at(ground, query)
        if known_roadmap.ground is not ground:
            near = stale_edges(known_roadmap.roadmap, known_roadmap.ground, ground)
            known_roadmap.unseen, known_roadmap.ground = known_roadmap.unseen | near, ground
            self.work.kept += int((~near).sum())
        if known_roadmap.later:
            known_roadmap.roadmap, known_roadmap.unseen = _with_paths(
                known_roadmap.roadmap, known_roadmap.unseen, known_roadmap.later, self.most
            )
            known_roadmap.later = []
        return known_roadmap

    def roadmap(self, ground: MotionScene, query: PathQuery) -> Roadmap:
        """The roadmap for where the arm stands, with all that was found so far, each edge as it
        is on a ground now.
        """
        known_roadmap = self._repaired(ground, query)
        self._see(known_roadmap, np.nonzero(known_roadmap.unseen)[0])
        return known_roadmap.roadmap

    def _see(self, known: _KnownRoadmap, edges: Longs) -> bool:
        """Look at some edges, by their numbers, and tell whether all of them are free."""
        roadmap, free, unseen = known.roadmap, known.roadmap.free.copy(), known.unseen.copy()
        seen = map_nodes(
            known.ground, roadmap.nodes, roadmap.edges[edges], roadmap.step, roadmap.margin_m
        )
        free[edges], unseen[edges] = seen.free, False
        known.roadmap, known.unseen = replace(roadmap, free=free), unseen
        self.work.seen += len(edges)
        return bool(seen.free.all())

    def _routed(self, ground: MotionScene, query: PathQuery) -> Moved | None:
        """A known route, made short, and proved; None if none leads to a goal."""
        path = self._route(self._repaired(ground, query), query)
        if path is None:
            return None
        goal = int(np.argmin(np.abs(query.goals - path[-1]).max(axis=1)))
        moved = Moved(path, goal, 0, True, cleared_m=query.margin_m)
        if len(path) > 2 and query.bridges:
            lines, route = ground.lines(query.step, query.margin_m), Route(path, query.bridges)
            shorten(route, lines, query.bridges, query.budget)
            shorter = replace(moved, path=route.path(), looked=lines.looked)
            shorter = prove_moved(ground, shorter, query.margin_m)
            if shorter.proved:
                return shorter
        return prove_moved(ground, moved, query.margin_m)

    def _route(self, known: _KnownRoadmap, query: PathQuery) -> Floats | None:
        """The shortest route (m, k) from the start to a goal; edges and joins are looked at
        when a route needs them.
        """
        count = len(known.roadmap.nodes)
        if not count:
            return None
        joined, own = _join_ends(known, query), len(known.roadmap.edges)
        path = None
        for _ in range(MAX_ROUTES):
            open_ = joined.roadmap.free | joined.unseen
            route = _shortest_route(joined.roadmap, open_, count)
            if route is None:
                break
            edges = _edge_numbers(joined.roadmap, route)
            if self._see(joined, edges[joined.unseen[edges]]):
                path = np.ascontiguousarray(joined.roadmap.nodes[list(route)])
                break
        known.roadmap = replace(known.roadmap, free=joined.roadmap.free[:own])
        known.unseen = joined.unseen[:own]
        return path


def _stand_key(ground: MotionScene, query: PathQuery) -> bytes:
    """What must be equal for a roadmap to serve: the joints, those that rest, the step and the
    margin.
    """
    joints = ground.scene.joints
    still = np.ones(joints.count, dtype=bool)
    still[list(query.moving or range(joints.count))] = False
    asked = np.array([query.step, query.margin_m])
    parts = (joints.parent, joints.T_parent_origin + 0.0, still, query.start[still], asked)
    return b"".join(part.tobytes() for part in parts)


def _with_paths(
    roadmap: Roadmap, unseen: Truths, paths: list[Floats], most: int
) -> tuple[Roadmap, Truths]:
    """The roadmap with paths (m, k), whose edges are unseen; of too many nodes the latest."""
    number = {node.tobytes(): n for n, node in enumerate(roadmap.nodes)}
    nodes, known_edges = list(roadmap.nodes), {tuple(pair) for pair in roadmap.edges.tolist()}
    added: dict[tuple[int, int], None] = {}
    for path in paths:
        at = []
        for q in path + 0.0:
            if q.tobytes() not in number:
                number[q.tobytes()] = len(nodes)
                nodes.append(q)
            at.append(number[q.tobytes()])
        added |= {(min(pair), max(pair)): None for pair in pairwise(at) if pair[0] != pair[1]}
    new = [pair for pair in added if pair not in known_edges]
    grown, unseen = _with_edges(replace(roadmap, nodes=np.array(nodes)), unseen, new)
    first = len(nodes) - most // 2 if len(nodes) > most else 0
    is_new = (grown.edges >= first).all(axis=1)
    pruned = replace(
        grown, nodes=grown.nodes[first:], edges=grown.edges[is_new] - first, free=grown.free[is_new]
    )
    return pruned, unseen[is_new]


def _with_edges(
    roadmap: Roadmap, unseen: Truths, edges: list[tuple[int, int]]
) -> tuple[Roadmap, Truths]:
    """The roadmap with edges that are unseen."""
    more = np.array(edges, dtype=np.int64).reshape(-1, 2)
    grown = replace(
        roadmap,
        edges=np.concatenate([roadmap.edges, more]),
        free=np.concatenate([roadmap.free, np.zeros(len(more), dtype=bool)]),
    )
    return grown, np.concatenate([unseen, np.ones(len(more), dtype=bool)])


def _join_ends(known: _KnownRoadmap, query: PathQuery) -> _KnownRoadmap:
    """What is known, with the start and then the goals behind the nodes, joined to the nearest
    of them by edges that are unseen.
    """
    nodes, ends = known.roadmap.nodes, np.vstack([query.start[None], query.goals])
    joins = []
    for end, q in enumerate(ends, len(nodes)):
        away = np.abs(nodes - q).max(axis=1)
        joins += [(int(n), end) for n in np.argsort(away, kind="stable")[:NEAREST_NODES]]
    wider = replace(known.roadmap, nodes=np.vstack([nodes, ends]))
    return _KnownRoadmap(known.ground, *_with_edges(wider, known.unseen, joins))


def _edge_numbers(roadmap: Roadmap, route: tuple[int, ...]) -> Longs:
    """The numbers of the edges of a route."""
    number = {(a, b): n for n, (a, b) in enumerate(roadmap.edges.tolist())}
    return np.array([number[min(pair), max(pair)] for pair in pairwise(route)], dtype=np.int64)


def _shortest_route(roadmap: Roadmap, open_: Truths, start: int) -> tuple[int, ...] | None:
    """The nodes of the shortest route over open edges from `start` to any node behind it; None
    if there is none.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra

    nodes, pairs = roadmap.nodes, roadmap.edges[open_]
    far = np.maximum(np.abs(nodes[pairs[:, 0]] - nodes[pairs[:, 1]]).max(axis=1), 1e-12)
    graph = csr_matrix((far, (pairs[:, 0], pairs[:, 1])), shape=(len(nodes), len(nodes)))
    away, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    goal = start + 1 + int(np.argmin(away[start + 1 :]))
    return nodes_up_to(before, goal) if np.isfinite(away[goal]) else None
