"""The built-in geometry backend: compiled kernels over packed arrays."""

from collections.abc import Iterator

import numpy as np

from engine.geometry.contacts import nearest_of_bodies
from engine.geometry.packing import pack
from engine.model.geometry import Contact, Floats, Ints, Scene, Truths
from engine.ports import CollisionChecker

MANY = 100  # standing pieces: beyond it, walking down a tree beats comparing every pair
CHUNK = 1024  # configurations whose carrier poses are held at a time


class BuiltinChecker:
    """A scene packed for the kernels."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._pieces = pack(scene.pieces)
        self._pairs = np.ascontiguousarray(scene.pairs, dtype=np.int64).reshape(-1, 2)

    @property
    def scene(self) -> Scene:
        """What is checked."""
        return self._scene

    def collides(self, where: Floats) -> Truths:
        """Whether any pair touches (n,)."""
        return self.first_contacts(where) >= 0

    def first_contacts(self, where: Floats) -> Ints:
        """A pair that touches for each of the batch, as an index into the scene's pairs (n,); -1 for none."""
        from engine.geometry.kernels.checks import first_contacts

        found = np.full(len(where), -1, dtype=np.int64)
        for first, poses in pose_batches(self._scene, where):
            first_contacts(poses, self._pieces, self._pairs, found[first : first + len(poses)])
        return found

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """The least signed distance (n,), at most `beyond_m`."""
        from engine.geometry.kernels.checks import nearest_pairs

        n = len(where)
        distance, pair, witness = np.empty(n), np.empty(n, dtype=np.int64), np.empty((n, 9))
        for first, poses in pose_batches(self._scene, where):
            rows = slice(first, first + len(poses))
            out = distance[rows], pair[rows], witness[rows]
            nearest_pairs(poses, self._pieces, self._pairs, float(beyond_m), *out)
        return distance

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """Every pair of bodies nearer than `within_m`, nearest first."""
        from engine.geometry.kernels.checks import near_pairs

        pairs = self._pairs
        distance, witness = np.empty(len(pairs)), np.empty((len(pairs), 9))
        for _, poses in pose_batches(self._scene, np.asarray(where, dtype=float)[None]):
            near_pairs(poses[0], self._pieces, pairs, float(within_m), distance, witness)
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


def pose_batches(scene: Scene, where: Floats) -> Iterator[tuple[int, Floats]]:
    """The carrier poses (m, k + 1, 3, 4) of stretches of a batch, each with its first row."""
    from engine.geometry.kernels.checks import carriers

    where, joints = np.ascontiguousarray(where, dtype=float), scene.joints
    for first in range(0, len(where), CHUNK):
        count = min(CHUNK, len(where) - first)
        poses = np.empty((count, scene.carriers, 3, 4))
        if scene.free:
            poses[:, 0] = np.eye(4)[:3]
            poses[:, 1] = where[first : first + count, :3]
        else:
            carriers(
                joints.parent, joints.T_parent_origin, joints.axis, joints.prismatic, where, first, poses
            )
        yield first, poses


class BuiltinBackend:
    """Compiled kernels; always there."""

    name = "builtin"
    exact_depths = True

    def checker(self, scene: Scene) -> CollisionChecker:
        """Pack a scene; what stands in it becomes a region tree when it is much."""
        from engine.geometry.region_checker import RegionChecker

        standing = sum(piece.carrier == 0 for piece in scene.pieces)
        return RegionChecker(scene) if standing > MANY else BuiltinChecker(scene)
