"""Signed distance of two pieces with the points where they are nearest or deepest."""

import math

from engine.geometry.kernels import compiled
from engine.geometry.kernels.depth import core_depth
from engine.geometry.kernels.gjk import core_distance, nearest_points
from engine.model.geometry import Floats


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
