"""Finds out whether a convex piece lies within the union of others.

The block around the piece is halved along its axes again and again. A cell that lies within one of the
others, or outside the piece, is not divided further. Cells that are undecided at the last level give a bound:
no point in them is farther than the slack from the others. All pieces are in one frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import Floats, Piece, Truths
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.hull import hull_triangles, planes
from cellwright.engine.stages.geometry.shapes.packing import CORNERS

LEVELS = 6
CLOSE = 1e-9  # metres; allowance for rounding


@dataclass(frozen=True, slots=True, eq=False)
class Covered:
    """The piece lies within the others, or outside them by at most `slack_m`."""

    slack_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Hole:
    """A point (3,) of the piece that lies in none of the others."""

    point: Floats


def covering(piece: Piece, others: Sequence[Piece]) -> Covered | Hole:
    """Whether the others together cover a piece: `Covered`, or a `Hole`."""
    own, around = _Convex(piece), [_Convex(other) for other in others]
    if any(each.holds(own) for each in around):
        return Covered(CLOSE)
    axes, centres, half = own.block
    for level in range(LEVELS):
        open_ = ~_inside_one(centres, axes, half, around) & ~own.surely_without(centres, half)
        centres = centres[open_]
        holes = own.contains(centres, -CLOSE) & ~_in_any(centres, around)
        if holes.any():
            return Hole(centres[holes][0])
        if not len(centres):
            return Covered(CLOSE)
        if level < LEVELS - 1:
            half = half / 2
            centres = (centres[:, None] + matmul(2 * CORNERS * half, axes)).reshape(-1, 3)
    away = np.min([each.distances(centres) for each in around], axis=0).clip(min=0.0)
    return Covered(float(away.max() + norm(half)) + CLOSE)


def _in_any(points: Floats, around: "list[_Convex]") -> Truths:
    found = np.zeros(len(points), dtype=bool)
    for each in around:
        found |= each.contains(points, CLOSE)
    return found


def _inside_one(centres: Floats, axes: Floats, half: Floats, around: "list[_Convex]") -> Truths:
    """Which cells lie within one of the others."""
    corners = (centres[:, None] + matmul(2 * CORNERS * half, axes)).reshape(-1, 3)
    found = np.zeros(len(centres), dtype=bool)
    for each in around:
        found |= each.contains(corners, CLOSE).reshape(-1, 8).all(axis=1)
    return found


@dataclass(frozen=True, eq=False)
class _Convex:
    """A piece in the frame of its carrier."""

    piece: Piece

    @cached_property
    def vertices(self) -> Floats:
        return transforms.apply(self.piece.T_carrier_piece, self.piece.vertices)

    @cached_property
    def block(self) -> tuple[Floats, Floats, Floats]:
        """Axes as rows, the middle (1, 3) and the half sizes of the block around the whole piece."""
        low, high = self.piece.vertices.min(axis=0), self.piece.vertices.max(axis=0)
        middle = transforms.apply(self.piece.T_carrier_piece, ((low + high) / 2)[None])
        return self.piece.T_carrier_piece[:3, :3].T, middle, (high - low) / 2 + self.piece.radius_m

    @cached_property
    def planes(self) -> tuple[Floats, Floats]:
        """Outward normals (m, 3) and offsets (m,) of a polytope's sides."""
        if self.piece.box:
            normals = matmul(np.concatenate([np.eye(3), -np.eye(3)]), self.piece.T_carrier_piece[:3, :3].T)
            return normals, (matmul(self.vertices, normals.T)).max(axis=0)
        return planes(self.vertices, hull_triangles(self.vertices))

    def holds(self, other: "_Convex") -> bool:
        """Whether this piece contains all of another one.

        By the cancellation law of convex sets, a hull grown by r lies in a hull grown by s exactly if the
        first hull, grown by r - s, lies in the second (or, if s > r, the first lies in the second shrunk by s
        - r).
        """
        return bool(
            (self._signed(other.vertices) + other.piece.radius_m - self.piece.radius_m).max() <= CLOSE
        )

    def contains(self, points: Floats, slack: float) -> Truths:
        """Which points (n, 3) the piece contains, or misses by at most `slack`."""
        held: Truths = self._signed(points) <= self.piece.radius_m + slack
        return held

    def distances(self, points: Floats) -> Floats:
        """How far points (n, 3) are from the piece; negative inside."""
        return self._measured(points) - self.piece.radius_m

    def surely_without(self, centres: Floats, half: Floats) -> Truths:
        """Which cells are surely outside the piece. A cell that is outside but near may be missed."""
        far: Truths = self._signed(centres) > self.piece.radius_m + norm(half) + CLOSE
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

        rows, found = np.vstack([np.zeros((1, 3)), self.vertices]), np.empty(len(points))
        count = len(self.vertices)
        separations = Separations(rows, count)
        for n, point in enumerate(points):
            rows[0] = point
            found[n] = separations.separation(0, 1, 0.0, 1, count, 0.0)
        return found


def _from_segment(points: Floats, ends: Floats) -> Floats:
    along = ends[-1] - ends[0]
    square = float(matmul(along, along))
    t = (matmul(points - ends[0], along) / square).clip(0.0, 1.0) if square > 0 else np.zeros(len(points))
    distance: Floats = np.linalg.norm(points - ends[0] - t[:, None] * along, axis=1)
    return distance
