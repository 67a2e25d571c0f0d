# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Distance between two convex hulls, given as stretches of rows of one array of vertices.

By the algorithm of Gilbert, Johnson & Keerthi (1988), with the simplex of the difference kept
together with its points on both bodies (van den Bergen 2003); the nearest point of a triangle by
its Voronoi regions (Ericson 2005, 5.1.5).

A row of `corners` holds the difference (0:3), the points on both bodies (3:6, 6:9) and its weight
(9). The simplex is the first `size` of them.
"""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry import vectors
from cellwright.engine.kernels.geometry.vectors import V

ROUNDS = 64
INFINITE = math.inf
CORNERS = 160  # of a difference that are kept: four for a distance, more for a depth


class Cores:
    """Vertices (v, 3) of hulls, and room for the corners of a difference (160, 10) that a
    search looks at.
    """

    def __init__(self, rows: Floats) -> None:
        self.rows, self.corners = rows, np.empty((CORNERS, 10))
        self.size = 0  # of the last simplex


def row(c: Cores, index: int) -> V:
    """A vertex."""
    return (c.rows[index, 0], c.rows[index, 1], c.rows[index, 2])


def corner(c: Cores, index: int) -> V:
    """A corner of the difference."""
    return (c.corners[index, 0], c.corners[index, 1], c.corners[index, 2])


def farthest(c: Cores, start: int, count: int, direction: V) -> int:
    """The row, of `count` from `start`, that lies farthest in a direction."""
    best, found = -INFINITE, start
    for i in range(start, start + count):
        height = (
            c.rows[i, 0] * direction[0] + c.rows[i, 1] * direction[1] + c.rows[i, 2] * direction[2]
        )
        if height > best:
            best, found = height, i
    return found


def support(c: Cores, a: int, na: int, b: int, nb: int, direction: V, at: int) -> V:
    """The corner of the difference A - B farthest in a direction, written to row `at` of the
    corners.
    """
    i = farthest(c, a, na, direction)
    j = farthest(c, b, nb, vectors.times(-1.0, direction))
    for x in range(3):
        c.corners[at, x] = c.rows[i, x] - c.rows[j, x]
        c.corners[at, 3 + x] = c.rows[i, x]
        c.corners[at, 6 + x] = c.rows[j, x]
    c.corners[at, 9] = 1.0
    return corner(c, at)


def core_distance(c: Cores, a: int, na: int, b: int, nb: int, limit: float) -> float:
    """How far the hulls of two stretches of rows are apart; 0 if they meet.

    As soon as it is sure to exceed `limit`, some value above `limit` comes back. The last simplex
    stays in `c`.
    """
    v = vectors.minus(row(c, a), row(c, b))
    size, vv, reach = 0, vectors.dot(v, v), 0.0
    for _ in range(ROUNDS):
        w = support(c, a, na, b, nb, vectors.times(-1.0, v), size)
        vw = vectors.dot(v, w)
        if vw > 0.0 and vw * vw > limit * limit * vv:
            return vw / math.sqrt(vv)
        reach = max(reach, vectors.dot(w, w))
        if size > 0 and (vv - vw <= 1e-14 * vv or _repeated(c, size)):
            break
        size = _reduce(c, size + 1)
        v = _nearest(c, size)
        before, vv = vv, vectors.dot(v, v)
        if size == 4 or vv <= 1e-26 * reach:
            vv = 0.0
            break
        if size > 1 and vv >= before and before > 0.0:
            break
    c.size = size
    return math.sqrt(vv)


def _repeated(c: Cores, size: int) -> bool:
    """Whether row `size` stands among the rows before it."""
    new = corner(c, size)
    for i in range(size):
        apart = vectors.minus(new, corner(c, i))
        if vectors.dot(apart, apart) == 0.0:
            return True
    return False


def _nearest(c: Cores, size: int) -> V:
    """The weighted sum of the rows."""
    x = y = z = 0.0
    for i in range(size):
        x += c.corners[i, 9] * c.corners[i, 0]
        y += c.corners[i, 9] * c.corners[i, 1]
        z += c.corners[i, 9] * c.corners[i, 2]
    return (x, y, z)


def _reduce(c: Cores, size: int) -> int:
    """Weigh the rows so that their sum is nearest to the origin, drop those without weight; 4
    if the origin is inside.
    """
    if size == 1:
        c.corners[0, 9] = 1.0
    elif size == 2:
        first, second = corner(c, 0), corner(c, 1)
        along = vectors.minus(second, first)
        length = vectors.dot(along, along)
        t = min(1.0, max(0.0, -vectors.dot(first, along) / length)) if length > 0.0 else 0.0
        c.corners[0, 9], c.corners[1, 9] = 1.0 - t, t
    elif size == 3:
        u = triangle_weights(corner(c, 0), corner(c, 1), corner(c, 2))
        c.corners[0, 9], c.corners[1, 9], c.corners[2, 9] = u[0], u[1], u[2]
    elif _tetrahedron(c):
        return 4
    return _compressed(c, size)


def _compressed(c: Cores, size: int) -> int:
    kept = 0
    for i in range(size):
        if c.corners[i, 9] > 0.0:
            if kept != i:
                for x in range(10):
                    c.corners[kept, x] = c.corners[i, x]
            kept += 1
    return kept


def _tetrahedron(c: Cores) -> bool:
    """Whether the origin is inside; if not, the weights are those of the nearest point of its
    faces.
    """
    best, outside = INFINITE, False
    weights = vectors.vector(0.0, 0.0, 0.0)
    left_out = 0
    for opposite in range(4):
        i, j, k = (
            corner(c, (opposite + 1) % 4),
            corner(c, (opposite + 2) % 4),
            corner(c, (opposite + 3) % 4),
        )
        if _separates(i, j, k, corner(c, opposite)):
            outside = True
            u = triangle_weights(i, j, k)
            p = vectors.vector(
                u[0] * i[0] + u[1] * j[0] + u[2] * k[0],
                u[0] * i[1] + u[1] * j[1] + u[2] * k[1],
                u[0] * i[2] + u[1] * j[2] + u[2] * k[2],
            )
            if vectors.dot(p, p) < best:
                best, weights, left_out = vectors.dot(p, p), u, opposite
    if outside:
        c.corners[left_out, 9] = 0.0
        c.corners[(left_out + 1) % 4, 9] = weights[0]
        c.corners[(left_out + 2) % 4, 9] = weights[1]
        c.corners[(left_out + 3) % 4, 9] = weights[2]
    return not outside


def _separates(a: V, b: V, c: V, d: V) -> bool:
    """Whether the plane of a, b, c has the origin and `d` on different sides; true if all four
    lie in one plane.
    """
    normal = vectors.cross(vectors.minus(b, a), vectors.minus(c, a))
    inner = vectors.dot(vectors.minus(d, a), normal)
    span = vectors.dot(normal, normal) * vectors.dot(vectors.minus(d, a), vectors.minus(d, a))
    if inner * inner <= 1e-24 * span:
        return True
    return inner * -vectors.dot(a, normal) < 0.0


def triangle_weights(a: V, b: V, c: V) -> V:
    """The weights of the corners in the point of a triangle that is nearest to the origin."""
    ab, ac = vectors.minus(b, a), vectors.minus(c, a)
    d1, d2 = -vectors.dot(ab, a), -vectors.dot(ac, a)
    if d1 <= 0.0 and d2 <= 0.0:
        return (1.0, 0.0, 0.0)
    d3, d4 = -vectors.dot(ab, b), -vectors.dot(ac, b)
    if d3 >= 0.0 and d4 <= d3:
        return (0.0, 1.0, 0.0)
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return (1.0 - d1 / (d1 - d3), d1 / (d1 - d3), 0.0)
    d5, d6 = -vectors.dot(ab, c), -vectors.dot(ac, c)
    if d6 >= 0.0 and d5 <= d6:
        return (0.0, 0.0, 1.0)
    return _inner_weights(d1, d2, d3, d4, d5, d6, vc)


def _inner_weights(
    d1: float, d2: float, d3: float, d4: float, d5: float, d6: float, vc: float
) -> V:
    """The remaining regions: the edges at `c`, and the face."""
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return (1.0 - d2 / (d2 - d6), 0.0, d2 / (d2 - d6))
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return (0.0, 1.0 - t, t)
    total = va + vb + vc
    return (va / total, vb / total, vc / total)


def nearest_points(c: Cores, out: Floats) -> None:
    """The weighted points on both bodies (6,), as the last simplex has them; of one around the
    origin, its middle.
    """
    for x in range(6):
        out[x] = 0.0
    for i in range(c.size):
        weight = c.corners[i, 9] if c.size < 4 else 0.25
        for x in range(6):
            out[x] += weight * c.corners[i, 3 + x]
