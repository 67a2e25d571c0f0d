"""Where a point on a body belongs: on a face, on an edge, or in a hole. Metres, in the frame of the body."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.stages.geometry import transforms
from cellwright.kb.model.shapes import PlacedShape, Plate, Ring

ON_M = 1e-5  # a point so near to a plane lies on it
BESIDE_M = 1e-4  # how far beyond an edge it is checked that the face goes on


class SnapTo(StrEnum):
    """What a point is snapped to."""

    FACE = "face"
    EDGE = "edge"
    HOLE = "hole"


@dataclass(frozen=True, slots=True, eq=False)
class Snapped:
    """A point (3,) on a body, the normal (3,) of its face away from the material, and how wide the hole is that it lies in."""

    point: Floats
    normal: Floats
    bore_m: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Bore:
    """A round hole: T_body_hole (4, 4), whose z is its axis; half of its length, and its radius."""

    T_body_hole: Floats
    half_m: float
    radius_m: float


def bores(shapes: tuple[PlacedShape, ...]) -> Iterator[Bore]:
    """The round holes of a body."""
    for placed in shapes:
        T, shape = transforms.of_pose(placed.pose), placed.shape
        if isinstance(shape, Plate):
            for hole in shape.holes:
                x, y = hole.at_m
                yield Bore(matmul(T, transforms.translation(x, y, 0.0)), shape.size_m[2] / 2, hole.radius_m)
        elif isinstance(shape, Ring):
            yield Bore(T, shape.length_m / 2, shape.inner_m)


def snapped(
    corners: Floats, shapes: tuple[PlacedShape, ...], point: Floats, to: SnapTo, reach_m: float = 0.1
) -> Snapped | None:
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
            return _in_hole(tuple(bores(shapes)), face, reach_m)


def _normals(corners: Floats) -> Floats:
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    found: Floats = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    return found


def _on_face(corners: Floats, point: Floats) -> Snapped:
    """The point on the nearest triangle."""
    near = _nearest(corners, point)
    away = np.linalg.norm(near - point, axis=1)
    normals = _normals(corners)
    level = np.abs(np.einsum("ij,ij->i", normals, point - corners[:, 0]))
    best = int(np.lexsort((level, away.round(7)))[0])
    return Snapped(near[best], normals[best])


def _nearest(corners: Floats, point: Floats) -> Floats:
    """The nearest point (n, 3) of each triangle to a point (3,): its foot if that lies within, else on the nearest side."""
    normals = _normals(corners)
    foot = point - np.einsum("ij,ij->i", normals, point - corners[:, 0])[:, None] * normals
    start, end = corners, np.roll(corners, -1, axis=1)
    way = end - start
    share = np.einsum("nij,nij->ni", point - start, way) / np.maximum(
        np.einsum("nij,nij->ni", way, way), 1e-30
    )
    on_sides = start + np.clip(share, 0.0, 1.0)[..., None] * way
    best = np.linalg.norm(on_sides - point, axis=2).argmin(axis=1)
    found: Floats = np.where(
        _within(corners, normals, foot)[:, None], foot, on_sides[np.arange(len(corners)), best]
    )
    return found


def _within(corners: Floats, normals: Floats, points: Floats) -> Truths:
    """Whether points (n, 3) or (3,) in the planes of triangles lie within them (n,)."""
    way = np.roll(corners, -1, axis=1) - corners
    inward = np.cross(normals[:, None], way)
    side = np.einsum("nij,nij->ni", inward, np.broadcast_to(points, normals.shape)[:, None] - corners)
    length = np.linalg.norm(way, axis=2)
    found: Truths = (side >= -1e-9 * length).all(axis=1)
    return found


def _on_edge(corners: Floats, face: Snapped, reach_m: float) -> Snapped | None:
    """The nearest point on an edge of the face: a side of its triangles behind which the face does not go on."""
    normals = _normals(corners)
    level = np.abs(np.einsum("ij,j->i", corners[:, 0] - face.point, face.normal))
    flat = corners[(level < ON_M) & (normals @ face.normal > 1 - 1e-9)]
    same = np.repeat(face.normal[None], len(flat), axis=0)
    start, way = flat.reshape(-1, 3), (np.roll(flat, -1, axis=1) - flat).reshape(-1, 3)
    squared = np.maximum(np.einsum("ij,ij->i", way, way), 1e-30)
    share = np.clip(np.einsum("ij,ij->i", face.point - start, way) / squared, 0.0, 1.0)
    points = start + share[:, None] * way
    away = np.linalg.norm(points - face.point, axis=1)
    outward = np.cross(way, face.normal) / np.sqrt(squared)[:, None]
    for n in np.argsort(away, kind="stable"):
        if away[n] > reach_m:
            return None
        if not _within(flat, same, points[n] + BESIDE_M * outward[n]).any():
            return Snapped(points[n], face.normal)
    return None


def _in_hole(holes: tuple[Bore, ...], face: Snapped, reach_m: float) -> Snapped | None:
    """The middle of the nearest hole, where it comes out of the face; in the hole's wall, where it comes out nearest."""
    found: list[tuple[float, Snapped]] = []
    for hole in holes:
        x, y, z = transforms.apply(transforms.inverse(hole.T_body_hole), face.point)[0]
        away = float(np.hypot(x, y)) - hole.radius_m
        if away <= reach_m and abs(z) <= hole.half_m + reach_m:
            axis = hole.T_body_hole[:3, 2]
            side = 1.0 if (axis @ face.normal or z) >= 0 else -1.0
            middle = hole.T_body_hole[:3, 3] + side * hole.half_m * axis
            found.append((abs(away), Snapped(middle, side * axis, 2 * hole.radius_m)))
    return min(found, key=lambda each: each[0])[1] if found else None
