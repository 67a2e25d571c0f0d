"""Convex pieces of what has round holes: rings, and plates with holes.

A hole becomes a prism within the round one, so that the pieces leave out nothing that is solid.
"""

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.geometry.angles import sine_cosine, unit_vectors
from cellwright.engine.model.geometry import Floats
from cellwright.kb.model.shapes import Hole, Plate, Ring

SIDES = 16  # of a ring
KNOWN = 256  # shapes whose pieces are kept: a scene is made anew for every state
HOLE_SIDES = 12  # of a hole in a plate
Rectangle = tuple[float, float, float, float]  # least x and y, greatest x and y


@lru_cache(maxsize=KNOWN)
def ring_pieces(ring: Ring) -> list[Floats]:
    """A sector (8, 3) for each side; the outer sides touch the ring from outside."""
    outer = _around(SIDES) * (ring.radius_m / sine_cosine(math.pi / SIDES)[1])
    return _sectors(_around(SIDES) * ring.inner_m, outer, ring.length_m)


@lru_cache(maxsize=KNOWN)
def plate_pieces(plate: Plate) -> list[Floats]:
    """The prisms (n, 3) that fill a plate."""
    x, y, z = plate.size_m
    rest: list[Rectangle] = [(-x / 2, -y / 2, x / 2, y / 2)]
    pieces: list[Floats] = []
    for hole in plate.holes:
        square = _square(hole)
        rest = [part for each in rest for part in _without(each, square)]
        pieces += _framing(hole, z)
    return [*(_block(each, z) for each in rest), *pieces]


def _around(sides: int) -> Floats:
    angles = (np.arange(sides) + 0.5) * 2 * math.pi / sides
    return unit_vectors(angles)


def _sectors(inner: Floats, outer: Floats, length_m: float) -> list[Floats]:
    """The prisms between the corners (n, 2) of an inner and an outer polygon."""
    found = []
    for n in range(len(inner)):
        m = (n + 1) % len(inner)
        found.append(_prism(np.stack([inner[n], outer[n], outer[m], inner[m]]), length_m))
    return found


def _prism(corners: Floats, length_m: float) -> Floats:
    half = length_m / 2
    return np.concatenate([np.column_stack([corners, np.full(len(corners), z)]) for z in (-half, half)])


def _square(hole: Hole) -> Rectangle:
    (x, y), r = hole.at_m, hole.radius_m
    return (x - r, y - r, x + r, y + r)


def _framing(hole: Hole, length_m: float) -> list[Floats]:
    """What the square around a hole keeps: the prisms between the round hole and the square."""
    around, each = _around(HOLE_SIDES), HOLE_SIDES // 4
    found = []
    for quarter in range(4):
        angle = (quarter + 0.5) * math.pi / 2
        corner = math.sqrt(2.0) * unit_vectors(np.array(angle))
        arc = around[quarter * each : (quarter + 1) * each]
        sides = [_axis(quarter), *arc, _axis(quarter + 1)]
        for first, second in pairwise(sides):
            corners = np.stack([first, corner, second]) * hole.radius_m + hole.at_m
            found.append(_prism(corners, length_m))
    return found


def _axis(quarter: int) -> Floats:
    angle = quarter * math.pi / 2
    return unit_vectors(np.array(angle))


def _block(each: Rectangle, length_m: float) -> Floats:
    x, y, u, v = each
    return _prism(np.array([[x, y], [u, y], [u, v], [x, v]]), length_m)


def _without(each: Rectangle, hole: Rectangle) -> list[Rectangle]:
    """The rectangles that are left of one when a square is cut out."""
    x, y, u, v = each
    left, low, right, high = max(x, hole[0]), max(y, hole[1]), min(u, hole[2]), min(v, hole[3])
    if left >= right or low >= high:
        return [each]
    parts = [(x, y, left, v), (right, y, u, v), (left, y, right, low), (left, high, right, v)]
    return [part for part in parts if part[2] > part[0] and part[3] > part[1]]
