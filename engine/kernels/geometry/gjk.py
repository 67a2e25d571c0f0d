"""Distance between two convex hulls given as stretches of rows of one vertex array.

By the algorithm of Gilbert, Johnson & Keerthi (1988), with the simplex of the difference kept together with its points
on both bodies (van den Bergen 2003); the nearest point of a triangle by its Voronoi regions (Ericson 2005, 5.1.5).

A row of a simplex holds the difference (0:3), the points on both bodies (3:6, 6:9) and its weight (9).
"""

import math

from engine.kernels.arrays import Floats
from engine.kernels.geometry import compiled
from engine.kernels.geometry.vectors import V, cross, dot, minus, times

ROUNDS = 64


@compiled
def point_of(rows: Floats, index: int, column: int) -> V:
    """Three entries of a row."""
    return (rows[index, column], rows[index, column + 1], rows[index, column + 2])


@compiled
def farthest(vertices: Floats, start: int, count: int, direction: V) -> int:
    """The row, of `count` from `start`, that lies farthest in a direction."""
    best, found = -math.inf, start
    for i in range(start, start + count):
        height = vertices[i, 0] * direction[0] + vertices[i, 1] * direction[1] + vertices[i, 2] * direction[2]
        if height > best:
            best, found = height, i
    return found


@compiled
def support(vertices: Floats, a: int, na: int, b: int, nb: int, direction: V, out: Floats, at: int) -> V:
    """The corner of the difference A - B farthest in a direction, written to row `at` of `out`."""
    i = farthest(vertices, a, na, direction)
    j = farthest(vertices, b, nb, times(-1.0, direction))
    for c in range(3):
        out[at, c] = vertices[i, c] - vertices[j, c]
        out[at, 3 + c], out[at, 6 + c] = vertices[i, c], vertices[j, c]
    out[at, 9] = 1.0
    return point_of(out, at, 0)


@compiled
def core_distance(vertices: Floats, a: int, na: int, b: int, nb: int, limit: float, simplex: Floats) -> float:
    """How far the hulls of two stretches of rows are apart; 0 if they meet.

    As soon as it is sure to exceed `limit`, some value above `limit` comes back. `simplex` (5, 10) keeps the last
    simplex, its size in [4, 9].
    """
    v = minus(point_of(vertices, a, 0), point_of(vertices, b, 0))
    size, vv, reach = 0, dot(v, v), 0.0
    for _ in range(ROUNDS):
        w = support(vertices, a, na, b, nb, times(-1.0, v), simplex, size)
        vw = dot(v, w)
        if vw > 0.0 and vw * vw > limit * limit * vv:
            return vw / math.sqrt(vv)
        reach = max(reach, dot(w, w))
        if size > 0 and (vv - vw <= 1e-14 * vv or _repeated(simplex, size)):
            break
        size = _reduce(simplex, size + 1)
        v = _nearest(simplex, size)
        before, vv = vv, dot(v, v)
        if size == 4 or vv <= 1e-26 * reach:
            vv = 0.0
            break
        if size > 1 and vv >= before and before > 0.0:
            break
    simplex[4, 9] = size
    return math.sqrt(vv)


@compiled
def _repeated(simplex: Floats, size: int) -> bool:
    """Whether row `size` stands among the rows before it."""
    new = point_of(simplex, size, 0)
    for i in range(size):
        apart = minus(new, point_of(simplex, i, 0))
        if dot(apart, apart) == 0.0:
            return True
    return False


@compiled
def _nearest(simplex: Floats, size: int) -> V:
    """The weighted sum of the rows."""
    x = y = z = 0.0
    for i in range(size):
        x += simplex[i, 9] * simplex[i, 0]
        y += simplex[i, 9] * simplex[i, 1]
        z += simplex[i, 9] * simplex[i, 2]
    return (x, y, z)


@compiled
def _reduce(simplex: Floats, size: int) -> int:
    """Weigh the rows so that their sum is nearest to the origin, drop those without weight; 4 if the origin is inside."""
    if size == 1:
        simplex[0, 9] = 1.0
    elif size == 2:
        first, second = point_of(simplex, 0, 0), point_of(simplex, 1, 0)
        along = minus(second, first)
        length = dot(along, along)
        t = min(1.0, max(0.0, -dot(first, along) / length)) if length > 0.0 else 0.0
        simplex[0, 9], simplex[1, 9] = 1.0 - t, t
    elif size == 3:
        u = triangle_weights(point_of(simplex, 0, 0), point_of(simplex, 1, 0), point_of(simplex, 2, 0))
        simplex[0, 9], simplex[1, 9], simplex[2, 9] = u
    elif _tetrahedron(simplex):
        return 4
    return _compressed(simplex, size)


@compiled
def _compressed(simplex: Floats, size: int) -> int:
    kept = 0
    for i in range(size):
        if simplex[i, 9] > 0.0:
            if kept != i:
                for c in range(10):
                    simplex[kept, c] = simplex[i, c]
            kept += 1
    return kept


@compiled
def _tetrahedron(simplex: Floats) -> bool:
    """Whether the origin is inside; if not, the weights are those of the nearest point of its faces."""
    best, outside = math.inf, False
    weights = (0.0, 0.0, 0.0)
    left_out = 0
    for opposite in range(4):
        i, j, k = (opposite + 1) % 4, (opposite + 2) % 4, (opposite + 3) % 4
        a, b, c = point_of(simplex, i, 0), point_of(simplex, j, 0), point_of(simplex, k, 0)
        if _separates(a, b, c, point_of(simplex, opposite, 0)):
            outside = True
            u = triangle_weights(a, b, c)
            p = (
                u[0] * a[0] + u[1] * b[0] + u[2] * c[0],
                u[0] * a[1] + u[1] * b[1] + u[2] * c[1],
                u[0] * a[2] + u[1] * b[2] + u[2] * c[2],
            )
            if dot(p, p) < best:
                best, weights, left_out = dot(p, p), u, opposite
    if outside:
        simplex[left_out, 9] = 0.0
        for n in range(3):
            simplex[(left_out + 1 + n) % 4, 9] = weights[n]
    return not outside


@compiled
def _separates(a: V, b: V, c: V, d: V) -> bool:
    """Whether the plane of a, b, c has the origin and `d` on different sides; true if all four lie in one plane."""
    normal = cross(minus(b, a), minus(c, a))
    inner = dot(minus(d, a), normal)
    span = dot(normal, normal) * dot(minus(d, a), minus(d, a))
    if inner * inner <= 1e-24 * span:
        return True
    return inner * -dot(a, normal) < 0.0


@compiled
def triangle_weights(a: V, b: V, c: V) -> V:
    """The weights of the corners in the point of a triangle that is nearest to the origin."""
    ab, ac = minus(b, a), minus(c, a)
    d1, d2 = -dot(ab, a), -dot(ac, a)
    if d1 <= 0.0 and d2 <= 0.0:
        return (1.0, 0.0, 0.0)
    d3, d4 = -dot(ab, b), -dot(ac, b)
    if d3 >= 0.0 and d4 <= d3:
        return (0.0, 1.0, 0.0)
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return (1.0 - d1 / (d1 - d3), d1 / (d1 - d3), 0.0)
    d5, d6 = -dot(ab, c), -dot(ac, c)
    if d6 >= 0.0 and d5 <= d6:
        return (0.0, 0.0, 1.0)
    return _inner_weights(d1, d2, d3, d4, d5, d6, vc)


@compiled
def _inner_weights(d1: float, d2: float, d3: float, d4: float, d5: float, d6: float, vc: float) -> V:
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


@compiled
def nearest_points(simplex: Floats, size: int, out: Floats) -> None:
    """The weighted points on both bodies (6,), as the last simplex has them; of one around the origin, its middle."""
    out[:6] = 0.0
    for i in range(size):
        weight = simplex[i, 9] if size < 4 else 0.25
        for c in range(6):
            out[c] += weight * simplex[i, 3 + c]
