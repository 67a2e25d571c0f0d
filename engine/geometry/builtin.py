"""The built-in geometry backend: compiled kernels over packed arrays."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from engine.geometry import transforms
from engine.model.geometry import Contact, Floats, Ints, Piece, Scene, Truths

CHUNK = 1024  # configurations whose carrier poses are held at a time


@dataclass(frozen=True, slots=True, eq=False)
class Packed:
    """A scene as the kernels want it; see `engine.geometry.kernels.checks`."""

    vertices: Floats  # (v, 3) in their carriers
    stretch: Ints  # (p, 2) first row and number of rows
    radius: Floats  # (p,)
    carrier: Ints  # (p,)
    ball: Floats  # (p, 4) centre in the carrier, radius
    block: Floats  # (p, 15) axes as rows, middle in the carrier, half sizes; around the vertices alone
    is_block: Truths  # (p,) whether the block is the piece itself
    pairs: Ints  # (m, 2)


def pack(scene: Scene) -> Packed:
    """The arrays of a scene."""
    placed = [transforms.apply(piece.T_carrier_piece, piece.vertices) for piece in scene.pieces]
    counts = np.array([len(vertices) for vertices in placed], dtype=np.int64)
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]]) if len(counts) else counts
    bounds = [_bounds(piece) for piece in scene.pieces]
    return Packed(
        np.ascontiguousarray(np.concatenate([np.zeros((0, 3)), *placed])),
        np.stack([starts, counts], axis=1).astype(np.int64).reshape(-1, 2),
        np.array([piece.radius_m for piece in scene.pieces], dtype=float),
        np.array([piece.carrier for piece in scene.pieces], dtype=np.int64),
        np.array([ball for ball, _ in bounds]).reshape(-1, 4),
        np.array([block for _, block in bounds]).reshape(-1, 15),
        np.array([piece.box and not piece.radius_m for piece in scene.pieces], dtype=bool),
        np.ascontiguousarray(scene.pairs, dtype=np.int64).reshape(-1, 2),
    )


def _bounds(piece: Piece) -> tuple[Floats, Floats]:
    """The ball around a piece, and the block around its vertices along the axes of its own frame."""
    low, high = piece.vertices.min(axis=0), piece.vertices.max(axis=0)
    middle = (low + high) / 2
    reach = float(np.linalg.norm(piece.vertices - middle, axis=1).max()) + piece.radius_m
    centre = transforms.apply(piece.T_carrier_piece, middle[None])[0]
    axes = piece.T_carrier_piece[:3, :3].T
    return np.append(centre, reach), np.concatenate([axes.ravel(), centre, (high - low) / 2])


class BuiltinChecker:
    """A scene packed for the kernels."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._packed = pack(scene)

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

        p = self._packed
        found = np.full(len(where), -1, dtype=np.int64)
        for first, poses in self._poses(where):
            out = found[first : first + len(poses)]
            first_contacts(
                poses, p.vertices, p.stretch, p.radius, p.carrier, p.ball, p.block, p.is_block, p.pairs, out
            )
        return found

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """The least signed distance (n,), at most `beyond_m`."""
        from engine.geometry.kernels.checks import nearest_pairs

        p, n = self._packed, len(where)
        distance, pair, witness = np.empty(n), np.empty(n, dtype=np.int64), np.empty((n, 9))
        for first, poses in self._poses(where):
            rows = slice(first, first + len(poses))
            nearest_pairs(
                *(poses, p.vertices, p.stretch, p.radius, p.carrier, p.ball, p.block, p.pairs, beyond_m),
                *(distance[rows], pair[rows], witness[rows]),
            )
        return distance

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """Every pair of bodies nearer than `within_m`, nearest first."""
        from engine.geometry.kernels.checks import near_pairs

        p = self._packed
        distance, witness = np.empty(len(p.pairs)), np.empty((len(p.pairs), 9))
        for _, poses in self._poses(np.asarray(where, dtype=float)[None]):
            near_pairs(
                *(poses[0], p.vertices, p.stretch, p.radius, p.carrier, p.ball, p.block, p.pairs),
                *(float(within_m), distance, witness),
            )
        near = np.nonzero(distance <= within_m)[0]
        return nearest_of_bodies(
            Contact(
                self._scene.pieces[p.pairs[m, 0]].body,
                self._scene.pieces[p.pairs[m, 1]].body,
                float(distance[m]),
                *(part.copy() for part in np.split(witness[m], 3)),
            )
            for m in near
        )

    def _poses(self, where: Floats) -> Iterator[tuple[int, Floats]]:
        """The carrier poses (m, k + 1, 3, 4) of stretches of the batch, each with its first row."""
        from engine.geometry.kernels.checks import carriers

        where = np.ascontiguousarray(where, dtype=float)
        joints = self._scene.joints
        for first in range(0, len(where), CHUNK):
            count = min(CHUNK, len(where) - first)
            poses = np.empty((count, self._scene.carriers, 3, 4))
            if self._scene.free:
                poses[:, 0] = np.eye(4)[:3]
                poses[:, 1] = where[first : first + count, :3]
            else:
                carriers(
                    joints.parent, joints.T_parent_origin, joints.axis, joints.prismatic, where, first, poses
                )
            yield first, poses


def nearest_of_bodies(contacts: Iterator[Contact]) -> tuple[Contact, ...]:
    """Of contacts between the same two bodies the nearest, all in order of distance and name."""
    best: dict[frozenset[str], Contact] = {}
    for contact in contacts:
        key = frozenset((contact.first, contact.second))
        if key not in best or contact.distance_m < best[key].distance_m:
            best[key] = contact
    return tuple(sorted(best.values(), key=lambda each: (each.distance_m, each.first, each.second)))


class BuiltinBackend:
    """Compiled kernels; always there."""

    name = "builtin"
    exact_depths = True

    def checker(self, scene: Scene) -> BuiltinChecker:
        """Pack a scene."""
        return BuiltinChecker(scene)
