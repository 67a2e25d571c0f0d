"""Boxes around what an arm sweeps on a path, for each link by itself: what they keep apart cannot meet."""

from collections.abc import Collection

import numpy as np

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats, Scene
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.carriers import pose_batch
from cellwright.engine.stages.geometry.collision.ground import Ground
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.geometry.world.scenes import pieces_of

STRETCH_M = 0.05  # of a path: so far, at most, anything moves between two looks


class Swept:
    """Some bodies of a world, and the boxes that they sweep."""

    def __init__(self, world: World, bodies: Collection[str]) -> None:
        wanted = set(bodies)
        own = tuple(piece for piece in pieces_of(world) if piece.body in wanted)
        names = tuple(dict.fromkeys(piece.body for piece in own))
        self._ground = Ground(
            BuiltinChecker(Scene(world.joints, own, np.zeros((0, 2), dtype=np.int64), False, names))
        )
        middles = [(piece.vertices.min(axis=0) + piece.vertices.max(axis=0)) / 2 for piece in own]
        self._radius = np.array(
            [
                float(np.linalg.norm(piece.vertices - at, axis=1).max()) + piece.radius_m
                for piece, at in zip(own, middles, strict=True)
            ]
        )
        self._centre = np.array(
            [
                matmul(piece.T_carrier_piece[:3, :3], at) + piece.T_carrier_piece[:3, 3]
                for piece, at in zip(own, middles, strict=True)
            ]
        ).reshape(len(own), 3)
        self._carrier = np.array([piece.carrier for piece in own], dtype=np.int64)

    def boxes(self, path: Floats) -> Floats:
        """For each carrier the box (n, 6: least x, y, z, then greatest) around its bodies on a path (m, all joints)."""
        where, half = self._looks(path)
        poses = pose_batch(self._ground.scene, where)
        found = []
        for carrier in np.unique(self._carrier):
            on = self._carrier == carrier
            R, t = poses[:, carrier, :, :3], poses[:, carrier, :, 3]
            centres = matmul(self._centre[on], R.transpose(0, 2, 1)) + t[:, None]
            around = self._radius[on][None, :, None] + half[:, None, None]
            found.append(
                np.concatenate([(centres - around).min(axis=(0, 1)), (centres + around).max(axis=(0, 1))])
            )
        return np.array(found).reshape(-1, 6)

    def _looks(self, path: Floats) -> tuple[Floats, Floats]:
        """Configurations (n, all joints), and how far (m) anything moves on the stretch around each of them (n,)."""
        if len(path) == 1:
            return path, np.zeros(1)
        ways, where, half = np.diff(path, axis=0), [], []
        far = self._ground.travels(ways)
        for start, way, metres in zip(path, ways, far, strict=False):
            count = max(1, int(np.ceil(metres / STRETCH_M)))
            where.append(start + (np.arange(count)[:, None] + 0.5) / count * way)
            half += [metres / count / 2] * count
        return np.concatenate(where), np.array(half)


def crossed(one: Floats, other: Floats) -> Floats:
    """The boxes (m, 6) that boxes (n, 6) and others (k, 6) have in common; none if they keep apart."""
    low = np.maximum(one[:, None, :3], other[None, :, :3]).reshape(-1, 3)
    high = np.minimum(one[:, None, 3:], other[None, :, 3:]).reshape(-1, 3)
    both: Floats = np.concatenate([low, high], axis=1)
    return both[(low <= high).all(axis=1)]
