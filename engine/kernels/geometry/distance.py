# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Signed distance of two pieces with the points where they are nearest or deepest."""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats, refuse_unless
from cellwright.engine.kernels.geometry import depth, gjk
from cellwright.engine.kernels.geometry.depth import Polytope
from cellwright.engine.kernels.geometry.gjk import Cores

INFINITE = math.inf


class Separations:
    """Signed distances between pieces that are stretches of rows of `vertices` (v, 3), of at most
    `most` rows each.

    `found` (9,) has the point on the first, the point on the second, and the unit normal from the
    first to the second, as they were found last. Rows may be written to between two questions.
    Raises `ValueError` for another array.
    """

    def __init__(self, vertices: Floats, most: int) -> None:
        refuse_unless("vertices", vertices, np.float64, (len(vertices), 3))
        self.cores, self.polytope = Cores(vertices), Polytope(most)
        self.found = self._found = np.empty(9)

    def separation(self, a: int, na: int, ra: float, b: int, nb: int, rb: float) -> float:
        """Signed distance of two pieces, each its first row, number of rows and radius; negative
        when they overlap.

        Raises `ValueError` for rows that are not there.
        """
        rows, most = self.cores.rows.shape[0], self.polytope.apart.rows.shape[0] // 2
        if min(a, b) < 0 or min(na, nb) < 1 or max(a + na, b + nb) > rows or max(na, nb) > most:
            raise ValueError(
                f"there are {rows} rows, and pieces of 1 to {most}: not {a}, {na} and {b}, {nb}"
            )
        return self.between(a, na, ra, b, nb, rb)

    def between(self, a: int, na: int, ra: float, b: int, nb: int, rb: float) -> float:
        """The same for kernels, unchecked."""
        found = self._found
        distance = gjk.core_distance(self.cores, a, na, b, nb, INFINITE)
        gjk.nearest_points(self.cores, found)
        if distance > 1e-12:
            for x in range(3):
                found[6 + x] = (found[3 + x] - found[x]) / distance
        else:
            distance = -depth.core_depth(self.cores, self.polytope, a, na, b, nb, found)
        for x in range(3):
            found[x] += ra * found[6 + x]
            found[3 + x] -= rb * found[6 + x]
        return distance - ra - rb
