"""The region tree of ITA (Becker & Garrett 1987): a hierarchy of regions of space with solid ones at its leaves.

It is a directed graph. A region is a sphere, a tube, a block in any orientation or a convex polyhedron. It need not
contain its children; but every region that is no root lies within the union of its parents, or of all its ancestors. So
whatever meets a region meets one of those that cover it, and a question goes down from the roots through regions that it
meets. A tree is a value: attaching, detaching and moving make a new one.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import networkx
import numpy as np

from engine.kernels.geometry.layout import Pieces, Tree
from engine.model.geometry import Contact, Floats, Piece, Truths
from engine.stages.geometry.shapes.contacts import nearest_of_bodies
from engine.stages.geometry.shapes.coverage import CLOSE, Hole, covering
from engine.stages.geometry.shapes.packing import joined, pack

POINTS = 256  # queries answered at a time


@dataclass(frozen=True, slots=True, eq=False)
class TreeRegion:
    """A region that stands in the world (carrier 0). `piece.body` is what a hit is called; only solid ones are hit."""

    name: str
    piece: Piece
    parents: tuple[str, ...] = ()
    solid: bool = False


class OutsideError(ValueError):
    """A region reaches out of its ancestors at `point` (3,)."""

    def __init__(self, region: str, point: Floats) -> None:
        at = ", ".join(f"{each:.3f}" for each in point)
        super().__init__(f"region '{region}' reaches out of its parents, at {at}")
        self.region, self.point = region, point


@dataclass(frozen=True, slots=True)
class Cover:
    """The regions that cover another one but for `slack_m`."""

    names: tuple[str, ...]
    slack_m: float


@dataclass(frozen=True, eq=False)
class RegionTree:
    """Regions by name, and what covers each."""

    regions: Mapping[str, TreeRegion]
    covers: Mapping[str, Cover]

    @classmethod
    def of(cls, regions: Iterable[TreeRegion]) -> "RegionTree":
        """The tree of some regions, in any order. Raises as `attached` does."""
        return cls({}, {}).attached(regions)

    def attached(self, regions: Iterable[TreeRegion], nested: bool = False) -> "RegionTree":
        """The tree with more regions; `nested` ones are known to lie within their parents.

        Raises `OutsideError` when one reaches out of its ancestors, `ValueError` for a name that is there already, an
        unknown parent, a circle, or a region that is not in the world.
        """
        added = {region.name: region for region in regions}
        everything = {**self.regions, **added}
        _refuse_twice(self.regions, added)
        covers = dict(self.covers)
        for region in _in_order(added, everything):
            covers[region.name] = _trusted(region) if nested else _cover(region, everything)
        return RegionTree(everything, covers)

    def detached(self, name: str) -> "tuple[RegionTree, tuple[TreeRegion, ...]]":
        """The tree without a region and all that lies below it, and what was taken off; attaching that restores it.

        Raises `KeyError` for an unknown name.
        """
        gone = {name, *self.below(name)}
        kept = {each: region for each, region in self.regions.items() if each not in gone}
        taken = tuple(region for each, region in self.regions.items() if each in gone)
        return RegionTree(kept, {each: self.covers[each] for each in kept}), taken

    def moved(self, name: str, T: Floats, parents: tuple[str, ...] | None = None) -> "RegionTree":
        """The tree after a region, with all that lies below it, was displaced by T (4, 4) in the world.

        It may get other parents. Raises as `attached` and `detached` do.
        """
        rest, taken = self.detached(name)
        displaced = [_displaced(region, T) for region in taken]
        if parents is not None:
            displaced = [
                replace(region, parents=parents) if region.name == name else region for region in displaced
            ]
        return rest.attached(displaced)

    def below(self, name: str) -> frozenset[str]:
        """The names of all regions that a region is an ancestor of. Raises `KeyError` for an unknown name."""
        if name not in self.regions:
            raise KeyError(f"no region '{name}'")
        return frozenset(networkx.descendants(self._graph, name))

    @cached_property
    def _graph(self) -> "networkx.DiGraph[str]":
        graph: networkx.DiGraph[str] = networkx.DiGraph()
        graph.add_nodes_from(self.regions)
        graph.add_edges_from((parent, each.name) for each in self.regions.values() for parent in each.parents)
        return graph

    @cached_property
    def pieces(self) -> Pieces:
        """Its regions as arrays, in their order."""
        return pack([region.piece for region in self.regions.values()])

    @cached_property
    def arrays(self) -> Tree:
        """How its regions hang together, as arrays."""
        names = list(self.regions)
        number = {name: n for n, name in enumerate(names)}
        children: list[list[int]] = [[] for _ in names]
        grow = np.zeros(len(names))
        for name in reversed(_order(self.covers)):
            cover = self.covers[name]
            for above in cover.names:
                children[number[above]].append(number[name])
                grow[number[above]] = max(grow[number[above]], grow[number[name]] + cover.slack_m)
        return Tree(
            np.cumsum([0, *map(len, children)]),
            np.array([child for each in children for child in each], dtype=np.int64),
            np.array([number[name] for name in names if not self.covers[name].names], dtype=np.int64),
            np.array([self.regions[name].solid for name in names], dtype=bool),
            grow,
        )

    def at_points(self, points: Floats, radius_m: float = 0.0) -> list[tuple[str, ...]]:
        """For each of the points (n, 3) what is hit by a ball around it (0: the point itself), in order of name."""
        return self._hits([Piece("", 0, np.eye(4), point[None], radius_m) for point in points])

    def at_segment(self, start: Floats, end: Floats, radius_m: float = 0.0) -> tuple[str, ...]:
        """What is hit by a line segment, or by a tube around it."""
        return self._hits([Piece("", 0, np.eye(4), np.stack([start, end]), radius_m)])[0]

    def at_body(self, pieces: Sequence[Piece], T_world_body: Floats) -> tuple[str, ...]:
        """What is hit by a body that flies free, whose pieces hang on one carrier at a pose (4, 4)."""
        hits = self._hits([_placed(piece, T_world_body) for piece in pieces])
        return tuple(sorted({name for each in hits for name in each}))

    def contacts(
        self, pieces: Sequence[Piece], T_world_body: Floats, within_m: float = 0.0
    ) -> tuple[Contact, ...]:
        """Everything solid that is nearer than `within_m` to such a body, nearest first, with depth and points."""
        from engine.kernels.geometry.distance import Separations

        placed = [_placed(piece, T_world_body) for piece in pieces]
        queries = pack(placed)
        everything, regions, found = joined(self.pieces, queries), list(self.regions.values()), []
        separations = Separations(everything.vertices, everything.most)
        for n, r in zip(*np.nonzero(self._near(queries, within_m)), strict=True):
            one, other = len(regions) + n, r
            (a, na), (b, nb) = everything.stretch[one], everything.stretch[other]
            radii = everything.radius[one], everything.radius[other]
            distance = separations.separation(a, na, radii[0], b, nb, radii[1])
            if distance <= within_m:
                parts = [part.copy() for part in np.split(separations.found, 3)]
                found.append(Contact(placed[n].body, regions[r].piece.body, float(distance), *parts))
        return nearest_of_bodies(found)

    def _hits(self, queries: Sequence[Piece]) -> list[tuple[str, ...]]:
        bodies = [region.piece.body for region in self.regions.values()]
        found: list[tuple[str, ...]] = []
        for first in range(0, len(queries), POINTS):
            near = self._near(pack(queries[first : first + POINTS]), 0.0)
            found += [tuple(sorted({bodies[r] for r in np.nonzero(row)[0]})) for row in near]
        return found

    def _near(self, queries: Pieces, within_m: float) -> Truths:
        """Which solid regions are within a distance of each query (n, regions)."""
        from engine.kernels.geometry.regions import near_solids

        near = np.zeros((len(queries.radius), len(self.regions)), dtype=bool)
        near_solids(joined(self.pieces, queries), self.arrays, float(within_m), near)
        return near


def _refuse_twice(there: Mapping[str, TreeRegion], added: Mapping[str, TreeRegion]) -> None:
    for name, region in added.items():
        if name in there:
            raise ValueError(f"there is a region '{name}' already")
        if region.piece.carrier != 0:
            raise ValueError(f"region '{name}' does not stand in the world")


def _in_order(added: Mapping[str, TreeRegion], known: Mapping[str, TreeRegion]) -> list[TreeRegion]:
    """The added regions, parents first."""
    graph: networkx.DiGraph[str] = networkx.DiGraph()
    graph.add_nodes_from(added)
    for region in added.values():
        for parent in region.parents:
            if parent not in known:
                raise ValueError(f"region '{region.name}' has no parent '{parent}' in the tree")
            if parent in added:
                graph.add_edge(parent, region.name)
    try:
        return [added[name] for name in networkx.topological_sort(graph)]
    except networkx.NetworkXUnfeasible:
        raise ValueError("a region is its own ancestor") from None


def _order(covers: Mapping[str, Cover]) -> list[str]:
    """All names, what covers before what is covered."""
    graph: networkx.DiGraph[str] = networkx.DiGraph()
    graph.add_nodes_from(covers)
    graph.add_edges_from((above, name) for name, cover in covers.items() for above in cover.names)
    return list(networkx.topological_sort(graph))


def _cover(region: TreeRegion, known: Mapping[str, TreeRegion]) -> Cover:
    """The parents, or, when the region reaches out of them, all ancestors. Raises `OutsideError`."""
    if not region.parents:
        return Cover((), 0.0)
    hole: Hole | None = None
    for names in (region.parents, _ancestors(region, known)):
        found = covering(region.piece, [known[name].piece for name in names])
        if not isinstance(found, Hole):
            return Cover(names, found.slack_m)
        hole = hole or found
    assert hole is not None
    raise OutsideError(region.name, hole.point)


def _trusted(region: TreeRegion) -> Cover:
    return Cover(region.parents, CLOSE if region.parents else 0.0)


def _ancestors(region: TreeRegion, known: Mapping[str, TreeRegion]) -> tuple[str, ...]:
    found: dict[str, None] = {}
    open_ = list(region.parents)
    while open_:
        name = open_.pop(0)
        if name not in found:
            found[name] = None
            open_ += known[name].parents
    return tuple(found)


def _placed(piece: Piece, T_world_body: Floats) -> Piece:
    return replace(piece, carrier=0, T_carrier_piece=T_world_body @ piece.T_carrier_piece)


def _displaced(region: TreeRegion, T: Floats) -> TreeRegion:
    return replace(region, piece=_placed(region.piece, T))
