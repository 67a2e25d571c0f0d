"""Where the solid regions of a tree are found: their pieces as arrays, and a hierarchy of boxes over them.

An index is a value. Its arrays are only added to, and the indices made from one another share them: to attach, detach or
move some regions writes the rows of those, and of the boxes above them, behind the rows that are there. When too many rows
are of no more use, or many regions change at once, the arrays are made anew.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.geometry.hierarchy import Hierarchy, build, inserted, removed
from cellwright.engine.kernels.geometry.layout import AXES, BALL, HALF, RADIUS, Pieces
from cellwright.engine.model.geometry import Floats, Longs, Piece
from cellwright.engine.stages.geometry.shapes.packing import chosen, pack

MANY = 64  # one change in so many regions, or more, is worth a new hierarchy
ROUNDING = 1e-9  # metres, or parts of a coordinate: boxes are so much larger than what is in them
GROWING = Lock()
Words = NDArray[np.object_]


@dataclass(slots=True, eq=False)
class Column:
    """An array whose first `used` rows are never changed again."""

    rows: NDArray[Any]
    used: int

    def extended(self, count: int, more: NDArray[Any]) -> "Column":
        """With more rows behind the first `count`: in place, unless another index has already put its rows there."""
        wanted = count + len(more)
        with GROWING:
            free = self.used == count and wanted <= len(self.rows)
            if free:
                self.used = wanted
        if not free:
            grown = np.empty((2 * wanted, *self.rows.shape[1:]), self.rows.dtype)
            grown[:count] = self.rows[:count]
            return Column(grown, wanted).filled(count, more)
        return self.filled(count, more)

    def filled(self, count: int, more: NDArray[Any]) -> "Column":
        """With `more` written behind the first `count` rows."""
        self.rows[count : count + len(more)] = more
        return self


@dataclass(frozen=True, eq=False)
class Index:
    """Solid regions by name, each with the number of its row. `count`, `corners` and `nodes` tell how many rows are of this index."""

    numbers: Mapping[str, int]
    names: Column
    vertices: Column
    stretch: Column
    radius: Column
    bounds: Column
    boxes: Column
    children: Column
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

    def changed(self, gone: Collection[str], added: Mapping[str, Piece]) -> "Index":
        """Without some regions, and with others."""
        kept = dict(self.numbers)
        for name in gone:
            del kept[name]
        packed = pack(list(added.values()))
        named = kept | {name: self.count + n for n, name in enumerate(added)}
        index = replace(self._with_rows(packed, list(added)), numbers=named)
        changes, useless = len(gone) + len(added), index.count - len(named)
        if changes * MANY > len(named) or useless > len(named) or index.nodes > 8 * len(named):
            return _compact(index)
        for name in gone:
            index = index._removed(self.numbers[name])
        for name in added:
            index = index._inserted(named[name])
        return index

    def _with_rows(self, packed: Pieces, names: Sequence[str]) -> "Index":
        below = np.array([self.corners, 0])
        return replace(
            self,
            names=self.names.extended(self.count, _words(names)),
            vertices=self.vertices.extended(self.corners, packed.vertices),
            stretch=self.stretch.extended(self.count, packed.stretch + below),
            radius=self.radius.extended(self.count, packed.radius),
            bounds=self.bounds.extended(self.count, packed.bounds),
            count=self.count + packed.count,
            corners=self.corners + len(packed.vertices),
        )

    def _inserted(self, number: int) -> "Index":
        return self._with_nodes(*inserted(self.hierarchy, self._box(number), number))

    def _removed(self, number: int) -> "Index":
        return self._with_nodes(*removed(self.hierarchy, self._box(number), number))

    def _box(self, number: int) -> Floats:
        box: Floats = boxes_around(self.bounds.rows[number : number + 1])[0]
        return box

    def _with_nodes(self, boxes: Floats, children: Longs, root: int) -> "Index":
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
    reach += ROUNDING * (1.0 + np.abs(middle) + reach)
    return np.concatenate([middle - reach, middle + reach], axis=1)


def index_of(pieces: Mapping[str, Piece]) -> Index:
    """The index of some solid regions."""
    return _built({name: n for n, name in enumerate(pieces)}, pack(list(pieces.values())))


def _compact(index: Index) -> Index:
    """The same regions in arrays of their own."""
    kept = np.array(list(index.numbers.values()), dtype=np.int64)
    return _built({name: n for n, name in enumerate(index.numbers)}, chosen(index.pieces, kept))


def _built(numbers: Mapping[str, int], p: Pieces) -> Index:
    boxes, children, root = _nodes_over(p)
    return Index(
        numbers,
        _column(_words(list(numbers))),
        _column(p.vertices),
        _column(p.stretch),
        _column(p.radius),
        _column(p.bounds),
        _column(boxes),
        _column(children),
        p.count,
        len(p.vertices),
        len(boxes),
        root,
    )


def _column(rows: NDArray[Any]) -> Column:
    return Column(rows, len(rows))


def _words(names: Sequence[str]) -> Words:
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


EMPTY = index_of({})
