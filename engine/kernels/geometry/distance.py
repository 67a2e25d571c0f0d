"""Signed distance of two pieces with the points where they are nearest or deepest."""

import math

from engine.kernels.arrays import Floats
from engine.kernels.geometry import compiled
from engine.kernels.geometry.depth import core_depth
from engine.kernels.geometry.gjk import core_distance, nearest_points


@compiled
def separation(
    vertices: Floats, a: int, na: int, ra: float, b: int, nb: int, rb: float, simplex: Floats, out: Floats
) -> float:
    """Signed distance of two pieces, negative when they overlap.

    `out` (9,) gets the point on the first, the point on the second, and the unit normal from the first to the second.
    """
    distance = core_distance(vertices, a, na, b, nb, math.inf, simplex)
    if distance > 1e-12:
        nearest_points(simplex, int(simplex[4, 9]), out)
        for c in range(3):
            out[6 + c] = (out[3 + c] - out[c]) / distance
    else:
        nearest_points(simplex, int(simplex[4, 9]), out)
        distance = -core_depth(vertices, a, na, b, nb, out)
    for c in range(3):
        out[c] += ra * out[6 + c]
        out[3 + c] -= rb * out[6 + c]
    return distance - ra - rb
