"""Pieces as primitive shapes of other libraries: spheres about the centre, capsules along z."""

import numpy as np

from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import Floats, Piece


def primitive_frame(piece: Piece) -> Floats:
    """T_carrier_primitive (4, 4). For a block or polytope it is the piece's own frame."""
    T = piece.T_carrier_piece.copy()
    if len(piece.vertices) > 2:
        return T
    T[:3, 3] += matmul(T[:3, :3], piece.vertices.mean(axis=0))
    if len(piece.vertices) == 2:
        T[:3, :3] = matmul(T[:3, :3], _onto(piece.vertices[1] - piece.vertices[0]))
    return T


def _onto(along: Floats) -> Floats:
    """A rotation (3, 3) that turns the z axis into a direction."""
    z = along / norm(along)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def length_of(piece: Piece) -> float:
    """The distance between the centres of a capsule's two ends."""
    return norm(piece.vertices[1] - piece.vertices[0])


def refuse_rounded(piece: Piece, library: str) -> None:
    """Raises `ValueError` for a polytope with a radius, because other libraries do not have this shape."""
    if len(piece.vertices) > 2 and piece.radius_m:
        raise ValueError(f"{library} has no rounded polytopes: {piece.body}")
