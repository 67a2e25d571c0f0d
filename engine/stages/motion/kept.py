"""Roadmaps kept over a sequence of motions: the ways that were found serve the next ones, also after the world has changed.

The planner finds most motions with little work. Where it does not, the ends are joined to the roadmap, and the shortest route
there is made shorter still. Only where no route is known does the planner go on. What was found is added. Before a roadmap is
used again, it is repaired: edges that come near what has changed are looked at again, and no others.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.motion.shorten import Route, shorten
from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.model.motion import Answer, Moved, Query, Refused, Strategy
from cellwright.engine.ports import Hand, MotionGround
from cellwright.engine.stages.motion.planner import plan, tried
from cellwright.engine.stages.motion.proving import with_proof
from cellwright.engine.stages.motion.roadmap import Roadmap, back, mapped, stale

NEAR = 12  # nodes that an end is joined to, the nearest first
TRIES = 40  # routes that are looked at for one motion
MOST = 600  # nodes of one roadmap: when there are more, the older half of them is forgotten
SOON = 20_000  # configurations that the planner looks at before the roadmap is asked


@dataclass(slots=True)
class Work:
    """How motions were found: by the planner soon, by the roadmap, or by the planner after all.

    So many edges were `seen`, which is looked at and proved, and so many were `kept` as they were when the world had changed.
    """

    soon: int = 0
    routed: int = 0
    alone: int = 0
    seen: int = 0
    kept: int = 0


@dataclass(slots=True, eq=False)
class _Known:
    """A roadmap on a ground. Whether an `unseen` edge (e,) is free there is not known yet; all others are as the roadmap says.

    `later` are paths that were found on this and other grounds since.
    """

    ground: MotionGround
    roadmap: Roadmap
    unseen: Truths
    later: list[Floats] = field(default_factory=list)


@dataclass(eq=False)
class KeptRoadmaps:
    """The roadmaps of the arms of a cell. Each belongs to one stand of an arm, and to the values of the joints that rest.

    The planner looks at `soon` configurations before a roadmap is asked. A roadmap has at most `most` nodes.
    """

    soon: int = SOON
    most: int = MOST
    work: Work = field(default_factory=Work)
    _known: dict[bytes, _Known] = field(default_factory=dict)

    def plan(self, ground: MotionGround, query: Query, hand: Hand | None = None) -> Answer:
        """As the planner answers. The path may be another one, as it may go where earlier motions went."""
        if query.strategy is not Strategy.CONNECT or query.upright_rad > 0.0 or not query.proved:
            return plan(ground, query, hand)
        found = self._planned(ground, query, hand)
        if isinstance(found, Moved) and found.proved and len(found.path) > 1:
            self._at(ground, query).later.append(found.path)
        return found

    def _planned(self, ground: MotionGround, query: Query, hand: Hand | None) -> Answer:
        soon = tried(ground, replace(query, budget=min(self.soon, query.budget)), hand)
        if isinstance(soon, Refused) or (isinstance(soon, Moved) and soon.proved):
            self.work.soon += 1
            return soon
        routed = self._routed(ground, query)
        if routed is not None:
            self.work.routed += 1
            return routed
        self.work.alone += 1
        return plan(ground, query, hand)

    def _at(self, ground: MotionGround, query: Query) -> _Known:
        """What is known for where the arm stands."""
        key = _stand(ground, query)
        if key not in self._known:
            none, no_edges = np.zeros((0, 2), dtype=np.int64), np.zeros(0, dtype=bool)
            roadmap = Roadmap(query.start[None][:0], none, no_edges, query.step, query.margin_m)
            self._known[key] = _Known(ground, roadmap, no_edges)
        return self._known[key]

    def _repaired(self, ground: MotionGround, query: Query) -> _Known:
        """What is known on a ground now: edges near what has changed, and those of new paths, are unseen."""
        known = self._at(ground, query)
        if known.ground is not ground:
            near = stale(known.roadmap, known.ground, ground)
            known.unseen, known.ground = known.unseen | near, ground
            self.work.kept += int((~near).sum())
        if known.later:
            known.roadmap, known.unseen = _with_paths(known.roadmap, known.unseen, known.later, self.most)
            known.later = []
        return known

    def roadmap(self, ground: MotionGround, query: Query) -> Roadmap:
        """The roadmap for where the arm stands, with all that was found so far, each edge as it is on a ground now."""
        known = self._repaired(ground, query)
        self._see(known, np.nonzero(known.unseen)[0])
        return known.roadmap

    def _see(self, known: _Known, edges: Longs) -> bool:
        """Look at some edges, by their numbers, and tell whether all of them are free."""
        roadmap, free, unseen = known.roadmap, known.roadmap.free.copy(), known.unseen.copy()
        seen = mapped(known.ground, roadmap.nodes, roadmap.edges[edges], roadmap.step, roadmap.margin_m)
        free[edges], unseen[edges] = seen.free, False
        known.roadmap, known.unseen = replace(roadmap, free=free), unseen
        self.work.seen += len(edges)
        return bool(seen.free.all())

    def _routed(self, ground: MotionGround, query: Query) -> Moved | None:
        """A known route, made short, and proved; None if none leads to a goal."""
        path = self._route(self._repaired(ground, query), query)
        if path is None:
            return None
        goal = int(np.argmin(np.abs(query.goals - path[-1]).max(axis=1)))
        found = Moved(path, goal, 0, True, cleared_m=query.margin_m)
        if len(path) > 2 and query.bridges:
            lines, route = ground.lines(query.step, query.margin_m), Route(path, query.bridges)
            shorten(route, lines, query.bridges, query.budget)
            shorter = replace(found, path=route.path(), looked=lines.looked)
            shorter = with_proof(ground, shorter, query.margin_m)
            if shorter.proved:
                return shorter
        return with_proof(ground, found, query.margin_m)

    def _route(self, known: _Known, query: Query) -> Floats | None:
        """The shortest route (m, k) from the start to a goal; edges and joins are looked at when a route needs them."""
        count = len(known.roadmap.nodes)
        if not count:
            return None
        joined, own = _joined(known, query), len(known.roadmap.edges)
        path = None
        for _ in range(TRIES):
            open_ = joined.roadmap.free | joined.unseen
            route = _shortest(joined.roadmap, open_, count)
            if route is None:
                break
            edges = _numbers(joined.roadmap, route)
            if self._see(joined, edges[joined.unseen[edges]]):
                path = np.ascontiguousarray(joined.roadmap.nodes[list(route)])
                break
        known.roadmap = replace(known.roadmap, free=joined.roadmap.free[:own])
        known.unseen = joined.unseen[:own]
        return path


def _stand(ground: MotionGround, query: Query) -> bytes:
    """What must be equal for a roadmap to serve: the joints, those that rest, the step and the margin."""
    joints = ground.scene.joints
    still = np.ones(joints.count, dtype=bool)
    still[list(query.moving or range(joints.count))] = False
    asked = np.array([query.step, query.margin_m])
    parts = (joints.parent, joints.T_parent_origin + 0.0, still, query.start[still], asked)
    return b"".join(each.tobytes() for each in parts)


def _with_paths(roadmap: Roadmap, unseen: Truths, paths: list[Floats], most: int) -> tuple[Roadmap, Truths]:
    """The roadmap with paths (m, k), whose edges are unseen; of too many nodes the latest."""
    number = {node.tobytes(): n for n, node in enumerate(roadmap.nodes)}
    nodes, known = list(roadmap.nodes), {tuple(pair) for pair in roadmap.edges.tolist()}
    added: dict[tuple[int, int], None] = {}
    for path in paths:
        at = []
        for q in path + 0.0:
            if q.tobytes() not in number:
                number[q.tobytes()] = len(nodes)
                nodes.append(q)
            at.append(number[q.tobytes()])
        added |= {(min(pair), max(pair)): None for pair in pairwise(at) if pair[0] != pair[1]}
    new = [pair for pair in added if pair not in known]
    grown, unseen = _with_edges(replace(roadmap, nodes=np.array(nodes)), unseen, new)
    first = len(nodes) - most // 2 if len(nodes) > most else 0
    left = (grown.edges >= first).all(axis=1)
    found = replace(grown, nodes=grown.nodes[first:], edges=grown.edges[left] - first, free=grown.free[left])
    return found, unseen[left]


def _with_edges(roadmap: Roadmap, unseen: Truths, edges: list[tuple[int, int]]) -> tuple[Roadmap, Truths]:
    """The roadmap with edges that are unseen."""
    more = np.array(edges, dtype=np.int64).reshape(-1, 2)
    grown = replace(
        roadmap,
        edges=np.concatenate([roadmap.edges, more]),
        free=np.concatenate([roadmap.free, np.zeros(len(more), dtype=bool)]),
    )
    return grown, np.concatenate([unseen, np.ones(len(more), dtype=bool)])


def _joined(known: _Known, query: Query) -> _Known:
    """What is known, with the start and then the goals behind the nodes, joined to the nearest of them by edges that are unseen."""
    nodes, ends = known.roadmap.nodes, np.vstack([query.start[None], query.goals])
    joins = []
    for end, q in enumerate(ends, len(nodes)):
        away = np.abs(nodes - q).max(axis=1)
        joins += [(int(n), end) for n in np.argsort(away, kind="stable")[:NEAR]]
    wider = replace(known.roadmap, nodes=np.vstack([nodes, ends]))
    return _Known(known.ground, *_with_edges(wider, known.unseen, joins))


def _numbers(roadmap: Roadmap, route: tuple[int, ...]) -> Longs:
    """The numbers of the edges of a route."""
    number = {(a, b): n for n, (a, b) in enumerate(roadmap.edges.tolist())}
    return np.array([number[min(pair), max(pair)] for pair in pairwise(route)], dtype=np.int64)


def _shortest(roadmap: Roadmap, open_: Truths, start: int) -> tuple[int, ...] | None:
    """The nodes of the shortest route over open edges from `start` to any node behind it; None if there is none."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra

    nodes, pairs = roadmap.nodes, roadmap.edges[open_]
    far = np.maximum(np.abs(nodes[pairs[:, 0]] - nodes[pairs[:, 1]]).max(axis=1), 1e-12)
    graph = csr_matrix((far, (pairs[:, 0], pairs[:, 1])), shape=(len(nodes), len(nodes)))
    away, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    goal = start + 1 + int(np.argmin(away[start + 1 :]))
    return back(before, goal) if np.isfinite(away[goal]) else None
