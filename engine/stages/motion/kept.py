"""Roadmaps kept over a sequence of motions: the ways that were found serve the next ones, also after the world has changed.

A motion whose straight line is not free joins its ends to the roadmap, takes the quickest route there, and shortens it. Only
where no good route is known is a way planned by itself. What was found is added. Before it is used again, the roadmap is repaired: edges
that come near what has changed are looked at again, and no others. Answers depend on the sequence, and on nothing else.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from engine.kernels.geometry.edges import free_edges
from engine.kernels.motion.shorten import Route, shorten
from engine.model.geometry import Floats
from engine.model.motion import Answer, Moved, Query, Strategy
from engine.ports import Hand, MotionGround
from engine.stages.motion.planner import plan
from engine.stages.motion.proving import with_proof
from engine.stages.motion.roadmap import Roadmap, back, mapped, repaired

NEAR = 12  # nodes that an end is joined to, the nearest first
TRIES = 24  # routes that are looked at for one motion
MOST = 600  # nodes of one roadmap: when there are more, the older half of them is forgotten
POOR = 2.0  # a route that takes so many times the straight line is compared with a way of its own


@dataclass(slots=True)
class Work:
    """How motions were found: on the straight line, by the roadmap, or each by itself; and how many edges were looked at again."""

    straight: int = 0
    routed: int = 0
    alone: int = 0
    repaired: int = 0
    kept: int = 0


@dataclass(slots=True, eq=False)
class _Known:
    """A roadmap, all of it on one ground, and paths that were found later, on other grounds: they are looked at when needed."""

    ground: MotionGround
    roadmap: Roadmap
    later: list[Floats] = field(default_factory=list)


@dataclass(eq=False)
class KeptRoadmaps:
    """The roadmaps of the arms of a cell. Each belongs to one stand of an arm, and to the values of the joints that rest."""

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
        if _straight(ground, query):
            self.work.straight += 1
            return plan(ground, query, hand)
        routed = self._routed(ground, query)
        if routed is not None and _far(routed.path) <= POOR * _least(query):
            self.work.routed += 1
            return routed
        self.work.alone += 1
        alone = plan(ground, query, hand)
        good = isinstance(alone, Moved) and alone.proved
        if routed is None or (good and _far(alone.path) <= _far(routed.path)):
            return alone
        return routed

    def _at(self, ground: MotionGround, query: Query) -> _Known:
        """What is known for where the arm stands."""
        key = _stand(ground, query)
        if key not in self._known:
            none = np.zeros((0, 2), dtype=np.int64)
            roadmap = Roadmap(
                query.start[None][:0], none, np.zeros(0, dtype=bool), query.step, query.margin_m
            )
            self._known[key] = _Known(ground, roadmap)
        return self._known[key]

    def roadmap(self, ground: MotionGround, query: Query) -> Roadmap:
        """The roadmap for where the arm stands, as it holds on a ground now: repaired, and with all that was found since."""
        known = self._at(ground, query)
        if known.ground is not ground:
            known.roadmap, looked = repaired(known.roadmap, known.ground, ground)
            known.ground = ground
            self.work.repaired += looked
            self.work.kept += len(known.roadmap.edges) - looked
        if known.later:
            known.roadmap = _with_paths(ground, known.roadmap, known.later)
            known.later = []
        return known.roadmap

    def _routed(self, ground: MotionGround, query: Query) -> Moved | None:
        """The quickest known route, made short, and proved; None if none leads to a goal."""
        path = _route(ground, self.roadmap(ground, query), query)
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


def _stand(ground: MotionGround, query: Query) -> bytes:
    """What must be equal for a roadmap to serve: the joints, those that rest, the step and the margin."""
    joints = ground.scene.joints
    still = np.ones(joints.count, dtype=bool)
    still[list(query.moving or range(joints.count))] = False
    asked = np.array([query.step, query.margin_m])
    parts = (joints.parent, joints.T_parent_origin + 0.0, still, query.start[still], asked)
    return b"".join(each.tobytes() for each in parts)


def _straight(ground: MotionGround, query: Query) -> bool:
    """Whether a straight line leads to one of the goals, as far as it is looked at."""
    free = np.zeros(len(query.goals), dtype=np.uint8)
    starts = np.repeat(query.start[None], len(query.goals), axis=0)
    free_edges(ground.lines(query.step, query.margin_m), starts, np.ascontiguousarray(query.goals), free)
    return bool(free.any())


def _far(path: Floats) -> float:
    """How far the joint that goes farthest on each line of a path (m, k) goes in all."""
    return float(np.abs(np.diff(path, axis=0)).max(axis=1).sum())


def _least(query: Query) -> float:
    return float(np.abs(query.goals - query.start).max(axis=1).min())


def _with_paths(ground: MotionGround, roadmap: Roadmap, paths: list[Floats]) -> Roadmap:
    """The roadmap with paths (m, k), each line of which is looked at and proved on this ground; of too many the latest."""
    number = {node.tobytes(): n for n, node in enumerate(roadmap.nodes)}
    nodes, edges = list(roadmap.nodes), {tuple(pair) for pair in roadmap.edges.tolist()}
    added: dict[tuple[int, int], None] = {}
    for path in paths:
        at = []
        for q in path + 0.0:
            if q.tobytes() not in number:
                number[q.tobytes()] = len(nodes)
                nodes.append(q)
            at.append(number[q.tobytes()])
        added |= {(min(pair), max(pair)): None for pair in pairwise(at)}
    new = np.array([pair for pair in added if pair not in edges], dtype=np.int64).reshape(-1, 2)
    more = mapped(ground, np.array(nodes), new, roadmap.step, roadmap.margin_m)
    grown = replace(
        more,
        edges=np.concatenate([roadmap.edges, more.edges]),
        free=np.concatenate([roadmap.free, more.free]),
    )
    return grown if len(nodes) <= MOST else _latest(grown, MOST // 2)


def _latest(roadmap: Roadmap, count: int) -> Roadmap:
    """The roadmap of the nodes that were added last."""
    first = len(roadmap.nodes) - count
    left = (roadmap.edges >= first).all(axis=1)
    return replace(
        roadmap,
        nodes=roadmap.nodes[first:],
        edges=roadmap.edges[left] - first,
        free=roadmap.free[left],
    )


def _route(ground: MotionGround, roadmap: Roadmap, query: Query) -> Floats | None:
    """The shortest route (m, k) over free edges from the start to a goal; the lines to the ends are looked at as they are needed."""
    count = len(roadmap.nodes)
    if not count:
        return None
    nodes = np.vstack([roadmap.nodes, query.start[None], query.goals])
    known = [tuple(pair) for pair in roadmap.edges[roadmap.free].tolist()]
    joins = [(a, end) for end in range(count, len(nodes)) for a in _nearest(roadmap.nodes, nodes[end])]
    unseen = dict.fromkeys(joins)
    for _ in range(TRIES):
        route = _shortest(nodes, known + list(unseen), count)
        if route is None:
            return None
        asked = [pair for pair in ((min(e), max(e)) for e in pairwise(route)) if pair in unseen]
        edges = np.array(asked, dtype=np.int64).reshape(-1, 2)
        free = mapped(ground, nodes, edges, query.step, query.margin_m).free
        for pair, is_free in zip(asked, free, strict=True):
            del unseen[pair]
            known += [pair] if is_free else []
        if free.all():
            return np.ascontiguousarray(nodes[route])
    return None


def _nearest(nodes: Floats, q: Floats) -> list[int]:
    away = np.abs(nodes - q).max(axis=1)
    return [int(n) for n in np.argsort(away, kind="stable")[:NEAR]]


def _shortest(nodes: Floats, edges: list[tuple[int, int]], start: int) -> list[int] | None:
    """The nodes of the shortest route from `start` to any of those behind it; None if there is none."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra

    pairs = np.array(edges, dtype=np.int64).reshape(-1, 2)
    far = np.maximum(np.abs(nodes[pairs[:, 0]] - nodes[pairs[:, 1]]).max(axis=1), 1e-12)
    graph = csr_matrix((far, (pairs[:, 0], pairs[:, 1])), shape=(len(nodes), len(nodes)))
    away, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    goal = start + 1 + int(np.argmin(away[start + 1 :]))
    if not np.isfinite(away[goal]):
        return None
    return list(back(before, goal))
