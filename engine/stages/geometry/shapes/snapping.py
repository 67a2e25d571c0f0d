"""Snaps a point near a body to a face, an edge or a hole of it, in the frame of the body."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.stages.geometry import transforms
from cellwright.kb.model.body_shapes import PlacedShape, Plate, Ring

ON_M = 1e-5  # a point so near to a plane lies on it
BESIDE_EDGE_M = 1e-4  # how far beyond an edge it is checked that the face goes on


class SnapTo(StrEnum):
    """What a point is snapped to."""

    FACE = "face"
    EDGE = "edge"
    HOLE = "hole"


@dataclass(frozen=True, slots=True, eq=False)
class SnappedPoint:
    """A point (3,) on a body, the normal (3,) of its face away from the material, and how wide
    the hole is that it lies in.
    """

    point: Floats
    normal: Floats
    bore_m: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Bore:
    """A round hole: T_body_hole (4, 4), whose z is its axis; half of its length, and its radius."""

    T_body_hole: Floats
    half_m: float
    radius_m: float


def round_holes(shapes: tuple[PlacedShape, ...]) -> Iterator[Bore]:
    """The round holes of a body."""
    for placed in shapes:
        T, shape = transforms.of_pose(placed.pose), placed.shape
        if isinstance(shape, Plate):
            for hole in shape.holes:
                x, y = hole.at_m
                yield Bore(
                    matmul(T, transforms.translation(x, y, 0.0)), shape.size_m[2] / 2, hole.radius_m
                )
        elif isinstance(shape, Ring):
            yield Bore(T, shape.length_m / 2, shape.inner_m)


def snap_point(
    corners: Floats,
    shapes: tuple[PlacedShape, ...],
    point: Floats,
    to: SnapTo,
    reach_m: float = 0.1,
) -> SnappedPoint | None:
    """Where a point (3,) near the surface belongs; None if there is no such thing within reach.

    `corners` (n, 3, 3) are the triangles of the body, counter-clockwise seen from outside.
    """
    face = _on_face(corners, point)
    match to:
        case SnapTo.FACE:
            return face
        case SnapTo.EDGE:
            return _on_edge(corners, face, reach_m)
        case SnapTo.HOLE:
            return _in_hole(tuple(round_holes(shapes)), face, reach_m)


def _triangle_normals(corners: Floats) -> Floats:
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals: Floats = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    return normals


def _on_face(corners: Floats, point: Floats) -> SnappedPoint:
    """The point on the nearest triangle."""
    near = _nearest_points(corners, point)
    away = np.linalg.norm(near - point, axis=1)
    normals = _triangle_normals(corners)
    level = np.abs(np.einsum("ij,ij->i", normals, point - corners[:, 0]))
    best = int(np.lexsort((level, away.round(7)))[0])
    return SnappedPoint(near[best], normals[best])


def _nearest_points(corners: Floats, point: Floats) -> Floats:
    """The nearest point (n, 3) of each triangle to a point (3,): its foot if that lies within,
    else on the nearest side.
    """
    normals = _triangle_normals(corners)
    foot = point - np.einsum("ij,ij->i", normals, point - corners[:, 0])[:, None] * normals
    start, end = corners, np.roll(corners, -1, axis=1)
    side = end - start
    share = np.einsum("nij,nij->ni", point - start, side) / np.maximum(
        np.einsum("nij,nij->ni", side, side), 1e-30
    )
    on_sides = start + np.clip(share, 0.0, 1.0)[..., None] * side
    best = np.linalg.norm(on_sides - point, axis=2).argmin(axis=1)
    nearest: Floats = np.where(
        _within_triangles(corners, normals, foot)[:, None],
        foot,
        on_sides[np.arange(len(corners)), best],
    )
    return nearest


def _within_triangles(corners: Floats, normals: Floats, points: Floats) -> Truths:
    """Whether points (n, 3) or (3,) in the planes of triangles lie within them (n,)."""
    sides = np.roll(corners, -1, axis=1) - corners
    inward = np.cross(normals[:, None], sides)
    side = np.einsum(
        "nij,nij->ni", inward, np.broadcast_to(points, normals.shape)[:, None] - corners
    )
    length = np.linalg.norm(sides, axis=2)
    is_within: Truths = (side >= -1e-9 * length).all(axis=1)
    return is_within


def _on_edge(corners: Floats, face: SnappedPoint, reach_m: float) -> SnappedPoint | None:
    """The nearest point on an edge of the face: a side of its triangles behind which the face
    does not go on.
    """
    normals = _triangle_normals(corners)
    level = np.abs(np.einsum("ij,j->i", corners[:, 0] - face.point, face.normal))
    flat = corners[(level < ON_M) & (normals @ face.normal > 1 - 1e-9)]
    same = np.repeat(face.normal[None], len(flat), axis=0)
    start, sides = flat.reshape(-1, 3), (np.roll(flat, -1, axis=1) - flat).reshape(-1, 3)
    squared = np.maximum(np.einsum("ij,ij->i", sides, sides), 1e-30)
    share = np.clip(np.einsum("ij,ij->i", face.point - start, sides) / squared, 0.0, 1.0)
    points = start + share[:, None] * sides
    away = np.linalg.norm(points - face.point, axis=1)
    outward = np.cross(sides, face.normal) / np.sqrt(squared)[:, None]
    for n in np.argsort(away, kind="stable"):
        if away[n] > reach_m:
            return None
        if not _within_triangles(flat, same, points[n] + BESIDE_EDGE_M * outward[n]).any():
            return SnappedPoint(points[n], face.normal)
    return None


def _in_hole(holes: tuple[Bore, ...], face: SnappedPoint, reach_m: float) -> SnappedPoint | None:
    """The middle of the nearest hole, where it comes out of the face; in the hole's wall, where
    it comes out nearest.
    """
    candidates: list[tuple[float, SnappedPoint]] = []
    for hole in holes:
        x, y, z = transforms.apply(transforms.inverse(hole.T_body_hole), face.point)[0]
        away = float(np.hypot(x, y)) - hole.radius_m
        if away <= reach_m and abs(z) <= hole.half_m + reach_m:
            axis = hole.T_body_hole[:3, 2]
            side = 1.0 if (axis @ face.normal or z) >= 0 else -1.0
            middle = hole.T_body_hole[:3, 3] + side * hole.half_m * axis
            candidates.append((abs(away), SnappedPoint(middle, side * axis, 2 * hole.radius_m)))
    return min(candidates, key=lambda candidate: candidate[0])[1] if candidates else None
