"""Convex hulls by Qhull, and whether a convex piece lies within the union of others."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import ConvexPiece
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.convex_pieces import BLOCK_CORNERS


class FlatError(ValueError):
    """The points span no volume."""


def hull_triangles(points: Floats) -> Longs:
    """The hull of points (n, 3) as triangles (m, 3) of indices, counter-clockwise seen from
    outside.

    Raises `FlatError` when all points lie within 1e-9 of their extent of one plane.
    """
    from scipy.spatial import ConvexHull, QhullError

    _refuse_flat(points)
    try:
        hull = ConvexHull(points - points.mean(axis=0))
    except QhullError:
        raise FlatError("the points are too near to one plane") from None
    triangles: Longs = hull.simplices.astype(np.int64)
    normals, _ = hull_planes(points, triangles)
    inwards = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return triangles


def hull_planes(points: Floats, triangles: Longs) -> tuple[Floats, Floats]:
    """Outward unit normals (m, 3) and offsets (m,) of triangles.

    A triangle without area has the normal zero; no point sees it.
    """
    a, b, c = points[triangles[:, 0]], points[triangles[:, 1]], points[triangles[:, 2]]
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit: Floats = normals / np.where(length > 0, length, 1.0)
    return unit, np.einsum("ij,ij->i", unit, a)


def _refuse_flat(points: Floats) -> None:
    """Raise `FlatError` unless some four of the points span a volume."""
    scale = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if len(points) < 4 or scale <= 0:
        raise FlatError("fewer than four different points")
    first = points[int(np.argmin(points[:, int(np.argmax(np.ptp(points, axis=0)))]))]
    line = points[int(np.argmax(np.linalg.norm(points - first, axis=1)))] - first
    across = np.cross(points - first, line)
    normal = np.cross(line, points[int(np.argmax(np.linalg.norm(across, axis=1)))] - first)
    length = norm(normal)
    if length <= 1e-9 * scale * norm(line):
        raise FlatError("the points lie on one line")
    if np.abs(matmul(points - first, normal)).max() <= 1e-9 * scale * length:
        raise FlatError("the points lie in one plane")


def hull_vertices(points: Floats) -> Floats:
    """The points (m, 3) that are corners of the hull of points (n, 3), in the order given."""
    corners: Floats = points[np.unique(hull_triangles(points))]
    return corners


MAX_LEVELS = 6
COVER_ROUNDING_M = 1e-9  # metres; allowance for rounding


@dataclass(frozen=True, slots=True, eq=False)
class CoveredPiece:
    """The piece lies within the others, or outside them by at most `slack_m`."""

    slack_m: float


@dataclass(frozen=True, slots=True, eq=False)
class UncoveredPoint:
    """A point (3,) of the piece that lies in none of the others."""

    point: Floats


def cover_piece(piece: ConvexPiece, covers: Sequence[ConvexPiece]) -> CoveredPiece | UncoveredPoint:
    """Whether the others together cover a piece: `Covered`, or a `Hole`."""
    own, around = _ConvexPiece(piece), [_ConvexPiece(cover) for cover in covers]
    if any(convex.holds(own) for convex in around):
        return CoveredPiece(COVER_ROUNDING_M)
    axes, centres, half = own.block
    for level in range(MAX_LEVELS):
        open_ = ~_inside_one(centres, axes, half, around) & ~own.surely_without(centres, half)
        centres = centres[open_]
        holes = own.contains(centres, -COVER_ROUNDING_M) & ~_in_any(centres, around)
        if holes.any():
            return UncoveredPoint(centres[holes][0])
        if not len(centres):
            return CoveredPiece(COVER_ROUNDING_M)
        if level < MAX_LEVELS - 1:
            half = half / 2
            centres = (centres[:, None] + matmul(2 * BLOCK_CORNERS * half, axes)).reshape(-1, 3)
    away = np.min([convex.distances(centres) for convex in around], axis=0).clip(min=0.0)
    return CoveredPiece(float(away.max() + norm(half)) + COVER_ROUNDING_M)


def _in_any(points: Floats, around: "list[_ConvexPiece]") -> Truths:
    is_covered = np.zeros(len(points), dtype=bool)
    for convex in around:
        is_covered |= convex.contains(points, COVER_ROUNDING_M)
    return is_covered


def _inside_one(
    centres: Floats, axes: Floats, half: Floats, around: "list[_ConvexPiece]"
) -> Truths:
    """Which cells lie within one of the others."""
    corners = (centres[:, None] + matmul(2 * BLOCK_CORNERS * half, axes)).reshape(-1, 3)
    is_inside = np.zeros(len(centres), dtype=bool)
    for convex in around:
        is_inside |= convex.contains(corners, COVER_ROUNDING_M).reshape(-1, 8).all(axis=1)
    return is_inside


@dataclass(frozen=True, eq=False)
class _ConvexPiece:
    """A piece in the frame of its carrier."""

    piece: ConvexPiece

    @cached_property
    def vertices(self) -> Floats:
        return transforms.apply(self.piece.T_carrier_piece, self.piece.vertices)

    @cached_property
    def block(self) -> tuple[Floats, Floats, Floats]:
        """Axes as rows, the middle (1, 3) and the half sizes of the block around the whole
        piece.
        """
        low, high = self.piece.vertices.min(axis=0), self.piece.vertices.max(axis=0)
        middle = transforms.apply(self.piece.T_carrier_piece, ((low + high) / 2)[None])
        return self.piece.T_carrier_piece[:3, :3].T, middle, (high - low) / 2 + self.piece.radius_m

    @cached_property
    def planes(self) -> tuple[Floats, Floats]:
        """Outward normals (m, 3) and offsets (m,) of a polytope's sides."""
        if self.piece.box:
            normals = matmul(
                np.concatenate([np.eye(3), -np.eye(3)]), self.piece.T_carrier_piece[:3, :3].T
            )
            return normals, (matmul(self.vertices, normals.T)).max(axis=0)
        return hull_planes(self.vertices, hull_triangles(self.vertices))

    def holds(self, inner: "_ConvexPiece") -> bool:
        """Whether this piece contains all of another one.

        By the cancellation law of convex sets, a hull grown by r lies in a hull grown by s exactly
        if the first hull, grown by r - s, lies in the second (or, if s > r, the first lies in the
        second shrunk by s
        - r).
        """
        return bool(
            (self._signed(inner.vertices) + inner.piece.radius_m - self.piece.radius_m).max()
            <= COVER_ROUNDING_M
        )

    def contains(self, points: Floats, slack: float) -> Truths:
        """Which points (n, 3) the piece contains, or misses by at most `slack`."""
        inside: Truths = self._signed(points) <= self.piece.radius_m + slack
        return inside

    def distances(self, points: Floats) -> Floats:
        """How far points (n, 3) are from the piece; negative inside."""
        return self._measured(points) - self.piece.radius_m

    def surely_without(self, centres: Floats, half: Floats) -> Truths:
        """Which cells are surely outside the piece.

        A cell that is outside but near may be missed.
        """
        far: Truths = self._signed(centres) > self.piece.radius_m + norm(half) + COVER_ROUNDING_M
        return far

    def _signed(self, points: Floats) -> Floats:
        """Signed distances (n,) from the core.

        Outside a polytope without radius the value is above zero and at most the distance.
        """
        if len(self.vertices) <= 2:
            return _from_segment(points, self.vertices)
        if self.piece.radius_m > 0.0:
            return self._measured(points)
        normals, offsets = self.planes
        height: Floats = (matmul(points, normals.T) - offsets).max(axis=1)
        return height

    def _measured(self, points: Floats) -> Floats:
        """Signed distances (n,) from the core, computed by the kernels."""
        from cellwright.engine.kernels.geometry.distance import Separations

        rows, distances = np.vstack([np.zeros((1, 3)), self.vertices]), np.empty(len(points))
        count = len(self.vertices)
        separations = Separations(rows, count)
        for n, point in enumerate(points):
            rows[0] = point
            distances[n] = separations.separation(0, 1, 0.0, 1, count, 0.0)
        return distances


def _from_segment(points: Floats, ends: Floats) -> Floats:
    along = ends[-1] - ends[0]
    square = float(matmul(along, along))
    t = (
        (matmul(points - ends[0], along) / square).clip(0.0, 1.0)
        if square > 0
        else np.zeros(len(points))
    )
    distance: Floats = np.linalg.norm(points - ends[0] - t[:, None] * along, axis=1)
    return distance
