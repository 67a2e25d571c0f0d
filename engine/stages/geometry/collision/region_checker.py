"""A scene checked by going down a region tree: for cells with many standing pieces, such as height fields and point sets.

What stands in the world becomes the tree; what moves asks it; pairs that move both are compared one by one.
"""

from dataclasses import replace
from functools import cached_property
from itertools import groupby

import numpy as np

from cellwright.engine.kernels.geometry.hierarchy import Hierarchy
from cellwright.engine.kernels.geometry.layout import Pairs, Pieces
from cellwright.engine.model.geometry import Contact, Floats, Longs, Scene, Truths
from cellwright.engine.stages.geometry.collision.carriers import checked_poses, only, pose_batch, split
from cellwright.engine.stages.geometry.collision.likelihood import (
    SAMPLES,
    likeliest_first,
    reachable,
    sampled,
    settling,
    touchable,
)
from cellwright.engine.stages.geometry.regions.hierarchies import nested_boxes
from cellwright.engine.stages.geometry.regions.index import hierarchy_over
from cellwright.engine.stages.geometry.regions.tree import RegionTree
from cellwright.engine.stages.geometry.shapes.contacts import nearest_of_bodies
from cellwright.engine.stages.geometry.shapes.packing import bounded, chosen, grouped, pack
from cellwright.engine.stages.geometry.stretches import in_stretches

FREE = np.full((4, 2), -1, dtype=np.int64)  # places for what has just touched
FEW = 40  # standing pieces within reach: pairs of so few are compared in less time than a walk takes
AT_FIRST = 100_000  # hits that there is room for without a second look


def tree_of(scene: Scene) -> RegionTree:
    """What stands in a scene: a region for each body, with boxes inside it when it is made of many pieces."""
    standing = sorted((piece for piece in scene.pieces if piece.carrier == 0), key=lambda piece: piece.body)
    bodies = groupby(standing, key=lambda piece: piece.body)
    regions = [region for body, pieces in bodies for region in nested_boxes(body, list(pieces))]
    return RegionTree.of([]).attached(regions, nested=True)


class RegionChecker:
    """A scene's arms, or its body that flies free, against a region tree."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self.tree = tree_of(scene)
        self._asking = [piece for piece in scene.pieces if piece.carrier != 0]
        self._pieces = pack(self._asking)
        self._pairs = self._moving_pairs()
        self._skip = self._skipped()
        self._near = self._reachable()

    def _reachable(self) -> tuple[Pieces, Hierarchy, Truths]:
        """The standing pieces that something can touch, the boxes over them, and which each asking piece may touch."""
        use = np.zeros(self.tree.pieces.count, dtype=bool)
        use[list(self.tree.index.numbers.values())] = True
        use &= reachable(self._scene, self._pieces, self.tree.pieces) & ~self._skip.all(axis=0)
        numbers = np.nonzero(use)[0]
        self._near_numbers = frozenset(numbers.tolist())
        near = chosen(self.tree.pieces, numbers)
        return near, hierarchy_over(near), np.ascontiguousarray(self._skip[:, numbers])

    @cached_property
    def _likely(self) -> Longs:
        """What is tried first in a large batch; before one it is worth finding out what touches most often."""
        from cellwright.engine.kernels.geometry.sampling import all_hits

        standing, hierarchy, skip = self._near
        poses = pose_batch(self._scene, sampled(self._scene.joints))
        asked = poses, self._pieces, standing, hierarchy, self._pairs, skip
        found = np.empty((AT_FIRST, 3), np.int64)
        count = all_hits(*asked, found)
        if count > AT_FIRST:
            found = np.empty((count, 3), np.int64)
            all_hits(*asked, found)
        return np.concatenate([settling(found[:count]), FREE])

    @cached_property
    def _pairwise(self) -> tuple[Pieces, Pairs] | None:
        """The pieces and the pairs that can touch, the likeliest first; None if more than a few standing pieces are in reach."""
        standing, numbers = self._near[0], self._near_numbers
        if standing.count > FEW or self._scene.free:
            return None
        near = {
            self.tree.regions[name].piece.body for name, n in self.tree.index.numbers.items() if n in numbers
        }
        kept = np.array([each.carrier != 0 or each.body in near for each in self._scene.pieces], dtype=bool)
        pairs = self._scene.pairs.reshape(-1, 2)
        pairs = (np.cumsum(kept) - 1)[pairs[kept[pairs].all(axis=1)]]
        pieces = tuple(piece for piece, use in zip(self._scene.pieces, kept, strict=True) if use)
        scene = replace(self._scene, pieces=pieces, pairs=pairs)
        packed, bound_of = bounded(scene)
        touching = grouped(pairs, bound_of, touchable(scene, packed))
        return packed, likeliest_first(pose_batch(scene, sampled(scene.joints)), packed, touching)

    @property
    def scene(self) -> Scene:
        """What is checked."""
        return self._scene

    def collides(self, where: Floats) -> Truths:
        """Whether any pair touches (n,)."""
        from cellwright.engine.kernels.geometry.regions import first_hits

        where, endless = split(self._scene, where)
        if len(where) > SAMPLES and self._pairwise is not None:
            return endless | self._by_pairs(where, *self._pairwise)
        standing, hierarchy, skip = self._near
        found = np.zeros(len(where), dtype=bool)
        likely = FREE if self._scene.free or len(where) <= SAMPLES else self._likely

        def look(first: int, after: int) -> None:
            poses, out = pose_batch(self._scene, where[first:after]), found[first:after]
            first_hits(poses, self._pieces, standing, hierarchy, self._pairs, skip, likely, out)

        in_stretches(len(where), look)
        found |= endless
        return found

    def _by_pairs(self, where: Floats, pieces: Pieces, pairs: Pairs) -> Truths:
        """`collides` for a checked batch, by comparing pairs."""
        from cellwright.engine.kernels.geometry.checks import first_contacts

        first = np.empty(len(where), dtype=np.int64)

        def look(begin: int, end: int) -> None:
            first_contacts(checked_poses(self._scene, where[begin:end]), pieces, pairs, first[begin:end])

        in_stretches(len(where), look)
        touching: Truths = first >= 0
        return touching

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """The least signed distance (n,), at most `beyond_m`."""
        from cellwright.engine.kernels.geometry.regions import nearest_hits

        where, endless = split(self._scene, where)
        pieces, hierarchy = self.tree.pieces, self.tree.hierarchy
        found, beyond = np.empty(len(where)), float(beyond_m)

        def look(first: int, after: int) -> None:
            poses, out = pose_batch(self._scene, where[first:after]), found[first:after]
            nearest_hits(poses, self._pieces, pieces, hierarchy, self._pairs, self._skip, beyond, out)

        in_stretches(len(where), look)
        found[endless] = -np.inf
        return found

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """Every pair of bodies nearer than `within_m`, nearest first."""
        poses = pose_batch(self._scene, only(self._scene, where))
        found, checked = self._among_moving(poses, within_m), self._checked
        for piece in self._asking:
            T = np.vstack([poses[0, piece.carrier], [0.0, 0.0, 0.0, 1.0]])
            near = self.tree.contacts([piece], T, within_m)
            found += [each for each in near if frozenset((each.first, each.second)) in checked]
        return nearest_of_bodies(found)

    def _among_moving(self, poses: Floats, within_m: float) -> list[Contact]:
        from cellwright.engine.kernels.geometry.checks import near_pairs

        distance, witness = np.empty(len(self._pairs)), np.empty((len(self._pairs), 9))
        near_pairs(poses, self._pieces, self._pairs, float(within_m), distance, witness)
        found = []
        for m in np.nonzero(distance <= within_m)[0]:
            first, second = (self._asking[each].body for each in self._pairs[m])
            parts = (part.copy() for part in np.split(witness[m], 3))
            found.append(Contact(first, second, float(distance[m]), *parts))
        return found

    def _moving_pairs(self) -> Longs:
        """The scene's pairs that move both, as the asking pieces are numbered."""
        moves = np.array([piece.carrier != 0 for piece in self._scene.pieces], dtype=bool)
        number, pairs = np.cumsum(moves) - 1, self._scene.pairs.reshape(-1, 2)
        found: Longs = number[pairs[moves[pairs].all(axis=1)]]
        return found.astype(np.int64)

    @cached_property
    def _checked(self) -> frozenset[frozenset[str]]:
        """The pairs of bodies that must not touch."""
        pieces = self._scene.pieces
        names, number = np.unique(
            np.array([piece.body for piece in pieces], dtype=object), return_inverse=True
        )
        pairs = np.unique(np.sort(number[self._scene.pairs.reshape(-1, 2)], axis=1), axis=0)
        return frozenset(frozenset((names[i], names[j])) for i, j in pairs.tolist())

    def _skipped(self) -> Truths:
        """Which standing pieces each asking piece may touch (asking, standing)."""
        column = {body: n for n, body in enumerate(dict.fromkeys(piece.body for piece in self._scene.pieces))}
        body = np.array([column[piece.body] for piece in self._scene.pieces], dtype=np.int64)
        asking, rows = np.unique([column[piece.body] for piece in self._asking], return_inverse=True)
        row = np.full(len(column), -1)
        row[asking.astype(np.int64)] = np.arange(len(asking))
        may = np.ones((len(asking), len(column) + 1), dtype=bool)  # last: bodies that the scene does not have
        i, j = body[self._scene.pairs.reshape(-1, 2)].T
        for one, other in ((i, j), (j, i)):
            may[row[one[row[one] >= 0]], other[row[one] >= 0]] = False
        at = np.full(self.tree.pieces.count, len(column), dtype=np.int64)
        for name, number in self.tree.index.numbers.items():
            at[number] = column.get(self.tree.regions[name].piece.body, len(column))
        return np.ascontiguousarray(may[rows][:, at])
