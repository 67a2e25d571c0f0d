"""The region tree of ITA (Becker & Garrett 1987): a hierarchy of regions of space with solid ones at its leaves.

It is a directed graph. A region is a sphere, a tube, a block in any orientation or a convex polyhedron. It need not
contain its children; but every region that is no root lies within the union of its parents, or of all its ancestors.
The solid regions are found through an index of boxes: regions are often scattered, and then no region that people declare
tells which of thousands are near. A tree is a value: attaching, detaching and moving make a new one, which shares nearly
all arrays with the old one.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from graphlib import CycleError, TopologicalSorter

import numpy as np

from cellwright.engine.kernels.geometry.hierarchy import Hierarchy
from cellwright.engine.kernels.geometry.layout import Pieces
from cellwright.engine.model.geometry import Contact, Floats, Longs, Piece
from cellwright.engine.stages.geometry.regions.index import EMPTY, Index
from cellwright.engine.stages.geometry.shapes.contacts import nearest_of_bodies
from cellwright.engine.stages.geometry.shapes.coverage import CLOSE, Hole, covering
from cellwright.engine.stages.geometry.shapes.packing import chosen, joined, pack


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
    """The regions that cover another one except for `slack_m`."""

    names: tuple[str, ...]
    slack_m: float


@dataclass(frozen=True, slots=True, eq=False)
class RegionTree:
    """Regions by name, what covers each, the children of those that have any, and where the solid ones are found."""

    regions: Mapping[str, TreeRegion]
    covers: Mapping[str, Cover]
    children: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    index: Index = EMPTY

    @classmethod
    def of(cls, regions: Iterable[TreeRegion]) -> "RegionTree":
        """The tree of some regions, in any order. Raises as `attached` does."""
        return cls({}, {}).attached(regions)

    def attached(self, regions: Iterable[TreeRegion], nested: bool = False) -> "RegionTree":
        """The tree with more regions; `nested` ones are known to lie within their parents.

        Raises `OutsideError` when one reaches out of its ancestors, `ValueError` for a name that is there already, an
        unknown parent, a circle, or a region that is not in the world, or not of finite size.
        """
        return self._changed({}, list(regions), nested)

    def detached(self, name: str) -> "tuple[RegionTree, tuple[TreeRegion, ...]]":
        """The tree without a region and all that lies below it, and what was taken off; attaching that restores it.

        Raises `KeyError` for an unknown name.
        """
        taken = self._taken(name)
        return self._changed(taken, [], False), tuple(taken.values())

    def moved(self, name: str, T: Floats, parents: tuple[str, ...] | None = None) -> "RegionTree":
        """The tree after a region, with all that lies below it, was displaced by T (4, 4) in the world.

        It may get other parents. Raises as `attached` and `detached` do.
        """
        taken = self._taken(name)
        displaced = [_displaced(region, T) for region in taken.values()]
        if parents is not None:
            displaced = [
                replace(region, parents=parents) if region.name == name else region for region in displaced
            ]
        return self._changed(taken, displaced, False)

    def below(self, name: str) -> frozenset[str]:
        """The names of all regions that a region is an ancestor of. Raises `KeyError` for an unknown name."""
        if name not in self.regions:
            raise KeyError(f"no region '{name}'")
        found: set[str] = set()
        open_ = list(self.children.get(name, ()))
        while open_:
            below = open_.pop()
            if below not in found:
                found.add(below)
                open_ += self.children.get(below, ())
        return frozenset(found)

    def _taken(self, name: str) -> dict[str, TreeRegion]:
        """A region and all below it, in the order of the tree."""
        gone = {name, *self.below(name)}
        if len(gone) == 1:
            return {name: self.regions[name]}
        return {each: region for each, region in self.regions.items() if each in gone}

    def _changed(
        self, gone: Mapping[str, TreeRegion], regions: Sequence[TreeRegion], nested: bool
    ) -> "RegionTree":
        everything, covers, added = dict(self.regions), dict(self.covers), _by_name(regions)
        for name in gone:
            del everything[name], covers[name]
        _refuse_misfits(everything, added)
        everything |= added
        for region in _in_order(added, everything):
            covers[region.name] = _trusted(region) if nested else _cover(region, everything)
        solid = {name: region.piece for name, region in added.items() if region.solid}
        index = self.index.changed([name for name, region in gone.items() if region.solid], solid)
        return RegionTree(everything, covers, _lineage(self.children, gone, added), index)

    @property
    def pieces(self) -> Pieces:
        """The pieces of its solid regions as arrays, each at the number that the index tells."""
        return self.index.pieces

    @property
    def hierarchy(self) -> Hierarchy:
        """The boxes over them."""
        return self.index.hierarchy

    def hits(self, queries: Sequence[Piece]) -> list[tuple[str, ...]]:
        """For each of some pieces of the world (a point or segment, with or without a radius, a block, ...) what it hits, by name.

        Raises `ValueError`, as all questions do, for what is not a finite number.
        """
        found: list[set[str]] = [set() for _ in queries]
        names = self.index.names.rows
        for n, r in self._near(pack(queries), 0.0).tolist():
            found[n].add(self.regions[names[r]].piece.body)
        return [tuple(sorted(each)) for each in found]

    def contacts(
        self, pieces: Sequence[Piece], T_world_body: Floats, within_m: float = 0.0
    ) -> tuple[Contact, ...]:
        """Everything solid that is nearer than `within_m` to a body that flies free, nearest first, with depth and points.

        Its pieces hang on one carrier at a pose (4, 4).
        """
        from cellwright.engine.kernels.geometry.distance import Separations

        placed = [_placed(piece, T_world_body) for piece in pieces]
        queries, names, found = pack(placed), self.index.names.rows, []
        near = self._near(queries, max(within_m, 0.0))
        numbers = np.unique(near[:, 1])
        everything = joined(queries, chosen(self.pieces, numbers))
        separations = Separations(everything.vertices, everything.most)
        for n, r in near:
            other = len(placed) + int(np.searchsorted(numbers, r))
            (a, na), (b, nb) = everything.stretch[n], everything.stretch[other]
            radii = everything.radius[n], everything.radius[other]
            distance = separations.separation(a, na, radii[0], b, nb, radii[1])
            if distance <= within_m:
                parts = [part.copy() for part in np.split(separations.found, 3)]
                body = self.regions[names[r]].piece.body
                found.append(Contact(placed[n].body, body, float(distance), *parts))
        return nearest_of_bodies(found)

    def _near(self, queries: Pieces, within_m: float) -> Longs:
        """The pairs (m, 2) of a query and the number of a solid region within a distance of it."""
        from cellwright.engine.kernels.geometry.regions import near_pieces

        if not np.isfinite(queries.bounds).all():
            raise ValueError("what is asked for has a size or a pose that is not a finite number")
        found = np.empty((8 * queries.count, 2), dtype=np.int64)
        count = near_pieces(queries, self.pieces, self.hierarchy, within_m, found)
        if count > len(found):
            found = np.empty((count, 2), dtype=np.int64)
            near_pieces(queries, self.pieces, self.hierarchy, within_m, found)
        return found[:count]


def _by_name(regions: Iterable[TreeRegion]) -> dict[str, TreeRegion]:
    return {region.name: region for region in regions}


def _lineage(
    children: Mapping[str, tuple[str, ...]], gone: Collection[str], added: Mapping[str, TreeRegion]
) -> dict[str, tuple[str, ...]]:
    """The children of each region that has any, after some are gone and some are added."""
    found = {name: below for name, below in children.items() if name not in gone}
    if gone:
        found = {name: tuple(each for each in below if each not in gone) for name, below in found.items()}
    more: dict[str, list[str]] = {}
    for name, region in added.items():
        for parent in region.parents:
            more.setdefault(parent, []).append(name)
    return found | {name: (*found.get(name, ()), *below) for name, below in more.items()}


def _refuse_misfits(there: Mapping[str, TreeRegion], added: Mapping[str, TreeRegion]) -> None:
    for name, region in added.items():
        if name in there:
            raise ValueError(f"there is a region '{name}' already")
        if region.piece.carrier != 0:
            raise ValueError(f"region '{name}' does not stand in the world")
        numbers = region.piece.T_carrier_piece, region.piece.vertices, region.piece.radius_m
        if not all(np.isfinite(each).all() for each in numbers):
            raise ValueError(f"region '{name}' has a size or a pose that is not a finite number")


def _in_order(added: Mapping[str, TreeRegion], known: Mapping[str, TreeRegion]) -> list[TreeRegion]:
    """The added regions, parents first."""
    above: dict[str, set[str]] = {}
    for name, region in added.items():
        unknown = [parent for parent in region.parents if parent not in known]
        if unknown:
            raise ValueError(f"region '{name}' has no parent '{unknown[0]}' in the tree")
        above[name] = {parent for parent in region.parents if parent in added}
    try:
        return [added[name] for name in TopologicalSorter(above).static_order()]
    except CycleError:
        raise ValueError("a region is its own ancestor") from None


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
