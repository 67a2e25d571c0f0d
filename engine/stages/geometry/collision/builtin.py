"""The built-in geometry backend: compiled kernels over packed arrays."""

from functools import cached_property

import numpy as np

from cellwright.engine.kernels.geometry.checks import first_contacts
from cellwright.engine.kernels.geometry.layout import Pairs, Pieces
from cellwright.engine.model.geometry import Contact, Floats, Longs, Scene, Truths
from cellwright.engine.ports import CollisionChecker
from cellwright.engine.stages.geometry.collision.carriers import (
    batch,
    checked_poses,
    is_finite,
    only,
    pose_batch,
    split,
)
from cellwright.engine.stages.geometry.collision.likelihood import (
    SAMPLES,
    likeliest_first,
    sampled,
    touchable,
)
from cellwright.engine.stages.geometry.shapes.contacts import nearest_of_bodies
from cellwright.engine.stages.geometry.shapes.packing import bounded, grouped
from cellwright.engine.stages.geometry.stretches import in_stretches

MANY = 100  # standing pieces: beyond it, walking down a tree beats comparing every pair


class BuiltinChecker:
    """A scene packed for the kernels."""

    def __init__(self, scene: Scene, packed: tuple[Pieces, Longs] | None = None) -> None:
        """`packed` is what `bounded` gives; made from the scene when not given."""
        self._scene = scene
        self.bounded = self._pieces, bound_of = packed or bounded(scene)
        self._pairs = grouped(scene.pairs, bound_of)
        self._touchable = grouped(scene.pairs, bound_of, touchable(scene, self._pieces))

    @cached_property
    def _likeliest(self) -> Pairs:
        """The pairs that can touch; before a large batch it is worth finding out which ones do so most often."""
        if self._scene.free:
            return self._touchable
        poses = pose_batch(self._scene, sampled(self._scene.joints))
        return likeliest_first(poses, self._pieces, self._touchable)

    def packed(self, within_m: float = 0.0) -> tuple[Pieces, Pairs]:
        """The scene as kernels read it: its pieces, and the pairs that can come within a distance, the likeliest first."""
        if within_m == 0.0:
            return self._pieces, self._likeliest
        kept = touchable(self._scene, self._pieces, within_m)
        return self._pieces, grouped(self._scene.pairs, self.bounded[1], kept)

    @property
    def scene(self) -> Scene:
        """What is checked."""
        return self._scene

    def collides(self, where: Floats) -> Truths:
        """Whether any pair touches (n,)."""
        where = batch(self._scene, where)
        if is_finite(where):
            touching: Truths = self._first(where) >= 0
            return touching
        where, endless = split(self._scene, where)
        return endless | (self._first(where) >= 0)

    def first_contacts(self, where: Floats) -> Longs:
        """A pair that touches for each of the batch, as an index into the scene's pairs (n,); -1 for none.

        Raises `ValueError` for what is no number.
        """
        where, endless = split(self._scene, where)
        if endless.any():
            raise ValueError("a configuration or pose has an entry that is not a finite number")
        return self._first(where)

    def _first(self, where: Floats) -> Longs:
        """`first_contacts` of a checked batch."""
        found = np.empty(len(where), dtype=np.int64)
        if len(where) <= SAMPLES:
            first_contacts(checked_poses(self._scene, where), self._pieces, self._touchable, found)
            return found
        pairs = self._likeliest

        def look(first: int, after: int) -> None:
            poses = checked_poses(self._scene, where[first:after])
            first_contacts(poses, self._pieces, pairs, found[first:after])

        in_stretches(len(where), look)
        return found

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """The least signed distance (n,), at most `beyond_m`."""
        where, endless = split(self._scene, where)
        distance, _, _ = self._nearest(where, beyond_m)
        distance[endless] = -np.inf
        return distance

    def nearest(self, where: Floats, beyond_m: float = 1.0) -> tuple[Contact | None, ...]:
        """The nearest (or deepest) two bodies of each (n,); None where nothing is nearer than `beyond_m`.

        Raises `ValueError` for what is no number.
        """
        where, endless = split(self._scene, where)
        if endless.any():
            raise ValueError("a configuration or pose has an entry that is not a finite number")
        distance, pair, witness = self._nearest(where, beyond_m)
        found: list[Contact | None] = []
        for gap, number, row in zip(distance, pair, witness, strict=True):
            if number < 0:
                found.append(None)
                continue
            first, second = (self._scene.pieces[piece].body for piece in self._scene.pairs[number])
            one, other, normal = (part.copy() for part in np.split(row, 3))
            found.append(Contact(first, second, float(gap), one, other, normal))
        return tuple(found)

    def _nearest(self, where: Floats, beyond_m: float) -> tuple[Floats, Longs, Floats]:
        """The least signed distance below `beyond_m` (n,), its pair (n,) or -1, and its points and normal (n, 9)."""
        from cellwright.engine.kernels.geometry.checks import nearest_pairs

        n = len(where)
        distance, pair, witness = np.empty(n), np.empty(n, dtype=np.int64), np.empty((n, 9))

        def look(first: int, after: int) -> None:
            poses, rows = pose_batch(self._scene, where[first:after]), slice(first, after)
            out = distance[rows], pair[rows], witness[rows]
            nearest_pairs(poses, self._pieces, self._pairs, float(beyond_m), *out)

        in_stretches(n, look)
        return distance, pair, witness

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """Every pair of bodies nearer than `within_m`, nearest first."""
        from cellwright.engine.kernels.geometry.checks import near_pairs

        pairs = self._pairs.pairs
        distance, witness = np.empty(len(pairs)), np.empty((len(pairs), 9))
        poses = pose_batch(self._scene, only(self._scene, where))
        near_pairs(poses, self._pieces, pairs, float(within_m), distance, witness)
        near = np.nonzero(distance <= within_m)[0]
        return nearest_of_bodies(
            Contact(
                self._scene.pieces[pairs[m, 0]].body,
                self._scene.pieces[pairs[m, 1]].body,
                float(distance[m]),
                *(part.copy() for part in np.split(witness[m], 3)),
            )
            for m in near
        )


class BuiltinBackend:
    """Compiled kernels; always there."""

    name = "builtin"
    exact_depths = True

    def checker_of_few(self, scene: Scene) -> BuiltinChecker:
        """Pack a scene, without a tree."""
        return BuiltinChecker(scene)

    def checker(self, scene: Scene) -> CollisionChecker:
        """Pack a scene; what stands in it becomes a region tree when it is much."""
        standing = sum(piece.carrier == 0 for piece in scene.pieces)
        if standing <= MANY:
            return BuiltinChecker(scene)
        from cellwright.engine.stages.geometry.collision.region_checker import (
            RegionChecker,  # trees take long to load
        )

        return RegionChecker(scene)
