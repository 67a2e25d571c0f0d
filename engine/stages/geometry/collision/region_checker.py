"""A scene checked by going down a region tree: for cells with many standing pieces, such as height fields and point sets.

What stands in the world becomes the tree; what moves asks it; pairs that move both are compared one by one.
"""

from itertools import groupby

import numpy as np

from engine.model.geometry import Contact, Floats, Longs, Piece, Scene, Truths
from engine.stages.geometry.collision.carriers import pose_batch
from engine.stages.geometry.regions.hierarchies import nested_boxes
from engine.stages.geometry.regions.tree import RegionTree
from engine.stages.geometry.shapes.contacts import nearest_of_bodies
from engine.stages.geometry.shapes.packing import joined, pack
from engine.stages.geometry.stretches import in_stretches


def tree_of(scene: Scene) -> RegionTree:
    """What stands in a scene: a region for each body, with boxes inside it when it is made of many pieces."""
    standing = sorted((piece for piece in scene.pieces if piece.carrier == 0), key=lambda piece: piece.body)
    bodies = groupby(standing, key=lambda piece: piece.body)
    regions = [region for body, pieces in bodies for region in nested_boxes(body, list(pieces))]
    return RegionTree.of([]).attached(regions, nested=True)


class RegionChecker:
    """A scene's arms, or its body that flies free, against a region tree."""

    def __init__(self, scene: Scene, tree: RegionTree | None = None) -> None:
        """`tree` holds what stands in the scene, by the names of its bodies; made from the scene when not given."""
        self._scene = scene
        self.tree = tree or tree_of(scene)
        self._asking = [piece for piece in scene.pieces if piece.carrier != 0]
        self._pieces = joined(self.tree.pieces, pack(self._asking))
        self._pairs = self._moving_pairs()
        self._skip = self._skipped()

    @property
    def scene(self) -> Scene:
        """What is checked."""
        return self._scene

    def collides(self, where: Floats) -> Truths:
        """Whether any pair touches (n,)."""
        from engine.kernels.geometry.regions import first_hits

        found = np.zeros(len(where), dtype=bool)

        def look(first: int, after: int) -> None:
            poses, out = pose_batch(self._scene, where[first:after]), found[first:after]
            first_hits(poses, self._pieces, self.tree.arrays, self._pairs, self._skip, out)

        in_stretches(len(where), look)
        return found

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """The least signed distance (n,), at most `beyond_m`."""
        from engine.kernels.geometry.regions import nearest_hits

        found, beyond = np.empty(len(where)), float(beyond_m)

        def look(first: int, after: int) -> None:
            poses, out = pose_batch(self._scene, where[first:after]), found[first:after]
            nearest_hits(poses, self._pieces, self.tree.arrays, self._pairs, self._skip, beyond, out)

        in_stretches(len(where), look)
        return found

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """Every pair of bodies nearer than `within_m`, nearest first."""
        poses = pose_batch(self._scene, np.asarray(where, dtype=float)[None])
        found, checked = self._among_moving(poses, within_m), self._checked()
        for piece in self._asking:
            T = np.vstack([poses[0, piece.carrier], [0.0, 0.0, 0.0, 1.0]])
            near = self.tree.contacts([piece], T, within_m)
            found += [each for each in near if frozenset((each.first, each.second)) in checked]
        return nearest_of_bodies(found)

    def _among_moving(self, poses: Floats, within_m: float) -> list[Contact]:
        from engine.kernels.geometry.checks import near_pairs

        distance, witness = np.empty(len(self._pairs)), np.empty((len(self._pairs), 9))
        near_pairs(poses, self._pieces, self._pairs, float(within_m), distance, witness)
        found = []
        for m in np.nonzero(distance <= within_m)[0]:
            first, second = (self._asking[each - len(self.tree.regions)].body for each in self._pairs[m])
            parts = (part.copy() for part in np.split(witness[m], 3))
            found.append(Contact(first, second, float(distance[m]), *parts))
        return found

    def _moving_pairs(self) -> Longs:
        """The scene's pairs that move both, as they are numbered here."""
        number = {id(piece): len(self.tree.regions) + n for n, piece in enumerate(self._asking)}
        pieces = self._scene.pieces
        found = [
            (number[id(pieces[i])], number[id(pieces[j])])
            for i, j in self._scene.pairs
            if pieces[i].carrier and pieces[j].carrier
        ]
        return np.array(found, dtype=np.int64).reshape(-1, 2)

    def _checked(self) -> frozenset[frozenset[str]]:
        """The pairs of bodies that must not touch."""
        pieces: tuple[Piece, ...] = self._scene.pieces
        return frozenset(frozenset((pieces[i].body, pieces[j].body)) for i, j in self._scene.pairs)

    def _skipped(self) -> Truths:
        """Which regions each asking piece may touch (asking, regions)."""
        checked = self._checked()
        bodies = [region.piece.body for region in self.tree.regions.values()]
        rows = [[frozenset((piece.body, body)) not in checked for body in bodies] for piece in self._asking]
        return np.array(rows, dtype=bool).reshape(len(self._asking), len(bodies))
