"""The built-in geometry backend: compiled kernels over packed arrays."""

from functools import cached_property

import numpy as np

from engine.kernels.geometry.checks import first_contacts
from engine.kernels.geometry.layout import Pairs, Pieces
from engine.model.geometry import Contact, Floats, Longs, Scene, Truths
from engine.ports import CollisionChecker
from engine.stages.geometry.collision.carriers import checked_poses, only, pose_batch, split
from engine.stages.geometry.collision.likelihood import SAMPLES, likeliest_first, sampled, touchable
from engine.stages.geometry.shapes.contacts import nearest_of_bodies
from engine.stages.geometry.shapes.packing import bounded, grouped
from engine.stages.geometry.stretches import in_stretches

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
        where, endless = split(self._scene, where)
        hits: Truths = self._first(where) >= 0
        hits |= endless
        return hits

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
        pairs = self._likeliest if len(where) > SAMPLES else self._touchable

        def look(first: int, after: int) -> None:
            poses = checked_poses(self._scene, where[first:after])
            first_contacts(poses, self._pieces, pairs, found[first:after])

        in_stretches(len(where), look)
        return found

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """The least signed distance (n,), at most `beyond_m`."""
        from engine.kernels.geometry.checks import nearest_pairs

        where, endless = split(self._scene, where)
        n = len(where)
        distance, pair, witness = np.empty(n), np.empty(n, dtype=np.int64), np.empty((n, 9))

        def look(first: int, after: int) -> None:
            poses, rows = pose_batch(self._scene, where[first:after]), slice(first, after)
            out = distance[rows], pair[rows], witness[rows]
            nearest_pairs(poses, self._pieces, self._pairs, float(beyond_m), *out)

        in_stretches(n, look)
        distance[endless] = -np.inf
        return distance

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """Every pair of bodies nearer than `within_m`, nearest first."""
        from engine.kernels.geometry.checks import near_pairs

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

    def checker(self, scene: Scene) -> CollisionChecker:
        """Pack a scene; what stands in it becomes a region tree when it is much."""
        standing = sum(piece.carrier == 0 for piece in scene.pieces)
        if standing <= MANY:
            return BuiltinChecker(scene)
        from engine.stages.geometry.collision.region_checker import RegionChecker  # trees take long to load

        return RegionChecker(scene)
