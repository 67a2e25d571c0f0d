"""The region tree of ITA (Becker & Garrett 1987): regions of space, solid ones at its leaves."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.kernels.geometry.hierarchy import Hierarchy, build, inserted, removed
from cellwright.engine.kernels.geometry.layout import AXES, BALL, HALF, RADIUS, Pieces
from cellwright.engine.model.geometry import Contact, ConvexPiece
from cellwright.engine.stages.geometry.shapes.convex_pieces import (
    bounding_block,
    join_packed,
    nearest_of_bodies,
    pack_pieces,
    select_pieces,
)
from cellwright.engine.stages.geometry.shapes.hulls import (
    COVER_ROUNDING_M,
    UncoveredPoint,
    cover_piece,
)
from cellwright.engine.stages.geometry.world.collision_scene import pieces_of_region
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld

MANY_CHANGES = 64  # one change in so many regions, or more, is worth a new hierarchy
# metres, or parts of a coordinate: boxes are so much larger than what is in them
ROUNDING_SLACK = 1e-9
GROWTH_LOCK = Lock()
Words = NDArray[np.object_]


@dataclass(slots=True, eq=False)
class GrowingColumn:
    """An array whose first `used` rows are never changed again."""

    rows: NDArray[Any]
    used: int

    def extended(self, count: int, more: NDArray[Any]) -> "GrowingColumn":
        """With more rows behind the first `count`: in place, unless another index has already
        put its rows there.
        """
        rows_needed = count + len(more)
        with GROWTH_LOCK:
            free = self.used == count and rows_needed <= len(self.rows)
            if free:
                self.used = rows_needed
        if not free:
            grown = np.empty((2 * rows_needed, *self.rows.shape[1:]), self.rows.dtype)
            grown[:count] = self.rows[:count]
            return GrowingColumn(grown, rows_needed).filled(count, more)
        return self.filled(count, more)

    def filled(self, count: int, more: NDArray[Any]) -> "GrowingColumn":
        """With `more` written behind the first `count` rows."""
        self.rows[count : count + len(more)] = more
        return self


@dataclass(frozen=True, eq=False)
class RegionIndex:
    """Solid regions by name, each with the number of its row.

    `count`, `corners` and `nodes` tell how many rows are of this index.
    """

    numbers: Mapping[str, int]
    names: GrowingColumn
    vertices: GrowingColumn
    stretch: GrowingColumn
    radius: GrowingColumn
    bounds: GrowingColumn
    boxes: GrowingColumn
    children: GrowingColumn
    count: int
    corners: int
    nodes: int
    root: int

    @cached_property
    def pieces(self) -> Pieces:
        """The pieces, some of which may be of no more use."""
        n = self.count
        return Pieces(
            self.vertices.rows[: self.corners],
            self.stretch.rows[:n],
            self.radius.rows[:n],
            np.zeros(n, dtype=np.int64),
            self.bounds.rows[:n],
        )

    @cached_property
    def hierarchy(self) -> Hierarchy:
        """The boxes over those that are of use."""
        return Hierarchy(self.boxes.rows[: self.nodes], self.children.rows[: self.nodes], self.root)

    def changed(self, gone: Collection[str], added: Mapping[str, ConvexPiece]) -> "RegionIndex":
        """Without some regions, and with others."""
        numbers = dict(self.numbers)
        for name in gone:
            del numbers[name]
        packed = pack_pieces(list(added.values()))
        named = numbers | {name: self.count + n for n, name in enumerate(added)}
        index = replace(self._with_rows(packed, list(added)), numbers=named)
        changes, useless = len(gone) + len(added), index.count - len(named)
        if (
            changes * MANY_CHANGES > len(named)
            or useless > len(named)
            or index.nodes > 8 * len(named)
        ):
            return _compact_index(index)
        for name in gone:
            index = index._removed(self.numbers[name])
        for name in added:
            index = index._inserted(named[name])
        return index

    def _with_rows(self, packed: Pieces, names: Sequence[str]) -> "RegionIndex":
        below = np.array([self.corners, 0])
        return replace(
            self,
            names=self.names.extended(self.count, _name_array(names)),
            vertices=self.vertices.extended(self.corners, packed.vertices),
            stretch=self.stretch.extended(self.count, packed.stretch + below),
            radius=self.radius.extended(self.count, packed.radius),
            bounds=self.bounds.extended(self.count, packed.bounds),
            count=self.count + packed.count,
            corners=self.corners + len(packed.vertices),
        )

    def _inserted(self, number: int) -> "RegionIndex":
        return self._with_nodes(*inserted(self.hierarchy, self._box(number), number))

    def _removed(self, number: int) -> "RegionIndex":
        return self._with_nodes(*removed(self.hierarchy, self._box(number), number))

    def _box(self, number: int) -> Floats:
        box: Floats = boxes_around(self.bounds.rows[number : number + 1])[0]
        return box

    def _with_nodes(self, boxes: Floats, children: Longs, root: int) -> "RegionIndex":
        return replace(
            self,
            boxes=self.boxes.extended(self.nodes, boxes),
            children=self.children.extended(self.nodes, children),
            nodes=self.nodes + len(boxes),
            root=root,
        )


def boxes_around(bounds: Floats) -> Floats:
    """Boxes (n, 6) around the pieces with some bounds (n, 18): low corners, then high ones."""
    axes = np.abs(bounds[:, AXES:HALF].reshape(-1, 3, 3))
    block = np.einsum("nij,ni->nj", axes, bounds[:, HALF:RADIUS]) + bounds[:, RADIUS, None]
    reach = np.minimum(block, bounds[:, BALL, None])
    middle = bounds[:, :3]
    reach += ROUNDING_SLACK * (1.0 + np.abs(middle) + reach)
    return np.concatenate([middle - reach, middle + reach], axis=1)


def index_of(pieces: Mapping[str, ConvexPiece]) -> RegionIndex:
    """The index of some solid regions."""
    return _build_index(
        {name: n for n, name in enumerate(pieces)}, pack_pieces(list(pieces.values()))
    )


def _compact_index(index: RegionIndex) -> RegionIndex:
    """The same regions in arrays of their own."""
    rows = np.array(list(index.numbers.values()), dtype=np.int64)
    return _build_index(
        {name: n for n, name in enumerate(index.numbers)}, select_pieces(index.pieces, rows)
    )


def _build_index(numbers: Mapping[str, int], p: Pieces) -> RegionIndex:
    boxes, children, root = _nodes_over(p)
    return RegionIndex(
        numbers,
        _new_column(_name_array(list(numbers))),
        _new_column(p.vertices),
        _new_column(p.stretch),
        _new_column(p.radius),
        _new_column(p.bounds),
        _new_column(boxes),
        _new_column(children),
        p.count,
        len(p.vertices),
        len(boxes),
        root,
    )


def _new_column(rows: NDArray[Any]) -> GrowingColumn:
    return GrowingColumn(rows, len(rows))


def _name_array(names: Sequence[str]) -> Words:
    """An array (n,) of names."""
    words = np.empty(len(names), dtype=object)
    words[:] = names
    return words


def hierarchy_over(p: Pieces) -> Hierarchy:
    """The boxes over all of some standing pieces."""
    return Hierarchy(*_nodes_over(p))


def _nodes_over(p: Pieces) -> tuple[Floats, Longs, int]:
    """Boxes, children and the root of a hierarchy over pieces."""
    nodes = max(0, 2 * p.count - 1)
    boxes, children = np.empty((nodes, 6)), np.empty((nodes, 2), np.int64)
    build(boxes_around(p.bounds), np.arange(p.count), boxes, children)
    return boxes, children, nodes - 1


EMPTY_INDEX = index_of({})


@dataclass(frozen=True, slots=True, eq=False)
class TreeRegion:
    """A region that stands in the world (carrier 0).

    `piece.body` is what a hit is called; only solid ones are hit.
    """

    name: str
    piece: ConvexPiece
    parents: tuple[str, ...] = ()
    solid: bool = False


class OutsideError(ValueError):
    """A region reaches out of its ancestors at `point` (3,)."""

    def __init__(self, region: str, point: Floats) -> None:
        at = ", ".join(f"{coordinate:.3f}" for coordinate in point)
        super().__init__(f"region '{region}' reaches out of its parents, at {at}")
        self.region, self.point = region, point


@dataclass(frozen=True, slots=True)
class RegionCover:
    """The regions that cover another one except for `slack_m`."""

    names: tuple[str, ...]
    slack_m: float


@dataclass(frozen=True, slots=True, eq=False)
class RegionTree:
    """Regions by name, what covers each, the children of those that have any, and where the
    solid ones are found.
    """

    regions: Mapping[str, TreeRegion]
    covers: Mapping[str, RegionCover]
    children: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    index: RegionIndex = EMPTY_INDEX

    @classmethod
    def of(cls, regions: Iterable[TreeRegion]) -> "RegionTree":
        """The tree of some regions, in any order. Raises as `attached` does."""
        return cls({}, {}).attached(regions)

    def attached(self, regions: Iterable[TreeRegion], nested: bool = False) -> "RegionTree":
        """The tree with more regions; `nested` ones are known to lie within their parents.

        Raises `OutsideError` when one reaches out of its ancestors, `ValueError` for a name that is
        there already, an unknown parent, a circle, or a region that is not in the world, or not of
        finite size.
        """
        return self._changed({}, list(regions), nested)

    def detached(self, name: str) -> "tuple[RegionTree, tuple[TreeRegion, ...]]":
        """The tree without a region and all that lies below it, and what was taken off; attaching
        that restores it.

        Raises `KeyError` for an unknown name.
        """
        taken = self._taken(name)
        return self._changed(taken, [], False), tuple(taken.values())

    def moved(self, name: str, T: Floats, parents: tuple[str, ...] | None = None) -> "RegionTree":
        """The tree after a region, with all that lies below it, was displaced by T (4, 4) in the
        world.

        It may get other parents. Raises as `attached` and `detached` do.
        """
        taken = self._taken(name)
        displaced = [_displace_region(region, T) for region in taken.values()]
        if parents is not None:
            displaced = [
                replace(region, parents=parents) if region.name == name else region
                for region in displaced
            ]
        return self._changed(taken, displaced, False)

    def below(self, name: str) -> frozenset[str]:
        """The names of all regions that a region is an ancestor of.

        Raises `KeyError` for an unknown name.
        """
        if name not in self.regions:
            raise KeyError(f"no region '{name}'")
        descendants: set[str] = set()
        open_ = list(self.children.get(name, ()))
        while open_:
            below = open_.pop()
            if below not in descendants:
                descendants.add(below)
                open_ += self.children.get(below, ())
        return frozenset(descendants)

    def _taken(self, name: str) -> dict[str, TreeRegion]:
        """A region and all below it, in the order of the tree."""
        gone = {name, *self.below(name)}
        if len(gone) == 1:
            return {name: self.regions[name]}
        return {name: region for name, region in self.regions.items() if name in gone}

    def _changed(
        self, gone: Mapping[str, TreeRegion], regions: Sequence[TreeRegion], nested: bool
    ) -> "RegionTree":
        everything, covers, added = dict(self.regions), dict(self.covers), _by_name(regions)
        for name in gone:
            del everything[name], covers[name]
        _refuse_misfits(everything, added)
        everything |= added
        for region in _in_order(added, everything):
            covers[region.name] = (
                _trusted_cover(region) if nested else _cover_of(region, everything)
            )
        solid = {name: region.piece for name, region in added.items() if region.solid}
        index = self.index.changed([name for name, region in gone.items() if region.solid], solid)
        return RegionTree(everything, covers, _updated_children(self.children, gone, added), index)

    @property
    def pieces(self) -> Pieces:
        """The pieces of its solid regions as arrays, each at the number that the index tells."""
        return self.index.pieces

    @property
    def hierarchy(self) -> Hierarchy:
        """The boxes over them."""
        return self.index.hierarchy

    def hits(self, queries: Sequence[ConvexPiece]) -> list[tuple[str, ...]]:
        """For each of some pieces of the world (a point or segment, with or without a radius, a
        block, ...) what it hits, by name.

        Raises `ValueError`, as all questions do, for what is not a finite number.
        """
        hits: list[set[str]] = [set() for _ in queries]
        names = self.index.names.rows
        for n, r in self._near(pack_pieces(queries), 0.0).tolist():
            hits[n].add(self.regions[names[r]].piece.body)
        return [tuple(sorted(names)) for names in hits]

    def contacts(
        self, pieces: Sequence[ConvexPiece], T_world_body: Floats, within_m: float = 0.0
    ) -> tuple[Contact, ...]:
        """Everything solid that is nearer than `within_m` to a body that flies free, nearest first,
        with depth and points.

        Its pieces hang on one carrier at a pose (4, 4).
        """
        from cellwright.engine.kernels.geometry.distance import Separations

        placed = [_place_piece(piece, T_world_body) for piece in pieces]
        queries, names, contacts = pack_pieces(placed), self.index.names.rows, []
        near = self._near(queries, max(within_m, 0.0))
        numbers = np.unique(near[:, 1])
        everything = join_packed(queries, select_pieces(self.pieces, numbers))
        separations = Separations(everything.vertices, everything.most)
        for n, r in near:
            partner = len(placed) + int(np.searchsorted(numbers, r))
            (a, na), (b, nb) = everything.stretch[n], everything.stretch[partner]
            radii = everything.radius[n], everything.radius[partner]
            distance = separations.separation(a, na, radii[0], b, nb, radii[1])
            if distance <= within_m:
                parts = [part.copy() for part in np.split(separations.found, 3)]
                body = self.regions[names[r]].piece.body
                contacts.append(Contact(placed[n].body, body, float(distance), *parts))
        return nearest_of_bodies(contacts)

    def _near(self, queries: Pieces, within_m: float) -> Longs:
        """The pairs (m, 2) of a query and the number of a solid region within a distance of it."""
        from cellwright.engine.kernels.geometry.regions import near_pieces

        if not np.isfinite(queries.bounds).all():
            raise ValueError("what is asked for has a size or a pose that is not a finite number")
        near_pairs = np.empty((8 * queries.count, 2), dtype=np.int64)
        count = near_pieces(queries, self.pieces, self.hierarchy, within_m, near_pairs)
        if count > len(near_pairs):
            near_pairs = np.empty((count, 2), dtype=np.int64)
            near_pieces(queries, self.pieces, self.hierarchy, within_m, near_pairs)
        return near_pairs[:count]


def _by_name(regions: Iterable[TreeRegion]) -> dict[str, TreeRegion]:
    return {region.name: region for region in regions}


def _updated_children(
    children: Mapping[str, tuple[str, ...]], gone: Collection[str], added: Mapping[str, TreeRegion]
) -> dict[str, tuple[str, ...]]:
    """The children of each region that has any, after some are gone and some are added."""
    lineage = {name: below for name, below in children.items() if name not in gone}
    if gone:
        lineage = {
            name: tuple(child for child in below if child not in gone)
            for name, below in lineage.items()
        }
    more: dict[str, list[str]] = {}
    for name, region in added.items():
        for parent in region.parents:
            more.setdefault(parent, []).append(name)
    return lineage | {name: (*lineage.get(name, ()), *below) for name, below in more.items()}


def _refuse_misfits(existing: Mapping[str, TreeRegion], added: Mapping[str, TreeRegion]) -> None:
    for name, region in added.items():
        if name in existing:
            raise ValueError(f"there is a region '{name}' already")
        if region.piece.carrier != 0:
            raise ValueError(f"region '{name}' does not stand in the world")
        numbers = region.piece.T_carrier_piece, region.piece.vertices, region.piece.radius_m
        if not all(np.isfinite(values).all() for values in numbers):
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


def _cover_of(region: TreeRegion, known: Mapping[str, TreeRegion]) -> RegionCover:
    """The parents, or, when the region reaches out of them, all ancestors.

    Raises `OutsideError`.
    """
    if not region.parents:
        return RegionCover((), 0.0)
    hole: UncoveredPoint | None = None
    for names in (region.parents, _all_ancestors(region, known)):
        coverage = cover_piece(region.piece, [known[name].piece for name in names])
        if not isinstance(coverage, UncoveredPoint):
            return RegionCover(names, coverage.slack_m)
        hole = hole or coverage
    assert hole is not None
    raise OutsideError(region.name, hole.point)


def _trusted_cover(region: TreeRegion) -> RegionCover:
    return RegionCover(region.parents, COVER_ROUNDING_M if region.parents else 0.0)


def _all_ancestors(region: TreeRegion, known: Mapping[str, TreeRegion]) -> tuple[str, ...]:
    ancestors: dict[str, None] = {}
    open_ = list(region.parents)
    while open_:
        name = open_.pop(0)
        if name not in ancestors:
            ancestors[name] = None
            open_ += known[name].parents
    return tuple(ancestors)


def _place_piece(piece: ConvexPiece, T_world_body: Floats) -> ConvexPiece:
    return replace(piece, carrier=0, T_carrier_piece=T_world_body @ piece.T_carrier_piece)


def _displace_region(region: TreeRegion, T: Floats) -> TreeRegion:
    return replace(region, piece=_place_piece(region.piece, T))


def nested_boxes(
    name: str, pieces: Sequence[ConvexPiece], parents: tuple[str, ...] = ()
) -> list[TreeRegion]:
    """Pieces that stand in the world as solid regions.

    A single piece is a region with the given name. Of several pieces the box around them, along the
    axes of the first, has this name; the pieces are its children `NAME#0`, `NAME#1`, ...
    """
    if len(pieces) == 1:
        return [TreeRegion(name, pieces[0], parents, solid=True)]
    inside = [
        TreeRegion(f"{name}#{n}", piece, (name,), solid=True) for n, piece in enumerate(pieces)
    ]
    return [TreeRegion(name, bounding_block(pieces), parents), *inside]


def declared_tree(world: GeometricWorld) -> tuple[RegionTree, tuple[OutsideError, ...]]:
    """The tree of the regions that a cell declares, and the regions that reach out of their
    parents.

    Regions on an arm are left out. A region that reaches out of its parents becomes a root, so that
    the tree is still right. A region made of many pieces counts as the box around it.
    """
    tree, outside = RegionTree.of([]), []
    for name in _parents_first(world):
        region, pieces = world.cell.regions[name], pieces_of_region(world, name)
        if pieces[0].carrier != 0:
            continue
        parents = tuple(parent for parent in region.parents if parent in tree.regions)
        boxes = nested_boxes(name, pieces, parents)
        top, *rest = (replace(box, solid=box.solid and region.solid) for box in boxes)
        try:
            tree = tree.attached([top])
        except OutsideError as error:
            outside.append(error)
            tree = tree.attached([replace(top, parents=())])
        tree = tree.attached(rest, nested=True)
    return tree, tuple(outside)


def _parents_first(world: GeometricWorld) -> list[str]:
    regions = world.cell.regions
    import networkx  # takes long to load, and many cells have no regions

    graph: networkx.DiGraph[str] = networkx.DiGraph()
    graph.add_nodes_from(regions)
    graph.add_edges_from((parent, name) for name in regions for parent in regions[name].parents)
    return list(networkx.topological_sort(graph))
