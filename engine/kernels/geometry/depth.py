# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""How deep two convex hulls overlap: the distance from the origin to the surface of their
difference.

A polytope inside the difference is grown until its nearest face is one of the difference's own (the
expanding polytope of van den Bergen 2001). As signed distances are compared, it may begin with a
tetrahedron that does not hold the origin: a face that separates it from the origin is the nearest
one and grows first.
"""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry import gjk, vectors
from cellwright.engine.kernels.geometry.gjk import CORNERS, Cores
from cellwright.engine.kernels.geometry.vectors import V

MAX_POINTS = CORNERS
MAX_FACES = 4 * MAX_POINTS  # a hull of n corners has at most 2 n - 4 triangles
INFINITE = math.inf


class Polytope:
    """Room for the polytope that grows, and for two hulls of at most `most` vertices each, drawn
    apart.

    Growing may add up to two faces for each that is replaced, when rounding has made the polytope
    less than convex.
    """

    def __init__(self, most: int) -> None:
        self.faces, self.planes = (
            np.empty((3 * MAX_FACES, 3), np.int64),
            np.empty((3 * MAX_FACES, 4)),
        )
        self.edges = np.empty((3 * MAX_FACES, 2), np.int64)
        self.apart = Cores(np.empty((2 * most, 3)))


def core_depth(c: Cores, p: Polytope, a: int, na: int, b: int, nb: int, out: Floats) -> float:
    """How deep two hulls that meet overlap, with the points and the normal in `out` (9,); of
    flat differences the normal alone.
    """
    if not _first_tetrahedron(c, a, na, b, nb, out):
        return 0.0
    _first_faces(c, p)
    count, face = 4, 0
    for used in range(4, MAX_POINTS):
        face = _nearest_face(p, count)
        normal = _normal(p, face)
        w = gjk.support(c, a, na, b, nb, normal, used)
        if vectors.dot(normal, w) - p.planes[face, 3] <= 1e-11 or count > MAX_FACES:
            break
        count = _grow(c, p, used, count)
    depth = max(0.0, float(p.planes[face, 3]))
    _deepest_points(c, p, a, na, b, nb, _normal(p, face), depth, out)
    return depth


def _first_tetrahedron(c: Cores, a: int, na: int, b: int, nb: int, out: Floats) -> bool:
    """Four corners of the difference that span a volume; if it has none, a normal of it in
    `out` and False.
    """
    size = 0.0
    line = vectors.vector(0.0, 0.0, 0.0)
    for axis in range(3):
        d = vectors.vector(
            1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0
        )
        low = gjk.support(c, a, na, b, nb, vectors.times(-1.0, d), 4)
        high = gjk.support(c, a, na, b, nb, d, 5)
        step = vectors.minus(high, low)
        if vectors.dot(step, step) > size:
            size, line = vectors.dot(step, step), step
            _copy(c, 4, 0)
            _copy(c, 5, 1)
    if size < 1e-24:
        _set_normal(out, vectors.vector(0.0, 0.0, 1.0))
        return False
    return _third_and_fourth(c, a, na, b, nb, out, line)


def _third_and_fourth(c: Cores, a: int, na: int, b: int, nb: int, out: Floats, line: V) -> bool:
    start, along = gjk.corner(c, 0), vectors.dot(line, line)
    across = _aside(line)
    other = vectors.cross(vectors.times(1.0 / math.sqrt(along), line), across)
    normal, best = vectors.vector(0.0, 0.0, 0.0), 0.0
    for turn in range(4):
        d = vectors.times(1.0 if turn < 2 else -1.0, across)
        if turn % 2 == 1:
            d = vectors.times(1.0 if turn < 2 else -1.0, other)
        w = gjk.support(c, a, na, b, nb, d, 4)
        n = vectors.cross(line, vectors.minus(w, start))
        if vectors.dot(n, n) > best:
            normal, best = n, vectors.dot(n, n)
            _copy(c, 4, 2)
    if best <= 1e-20 * along * along:
        _set_normal(out, across)
        return False
    normal = vectors.times(1.0 / math.sqrt(best), normal)
    up = vectors.dot(vectors.minus(gjk.support(c, a, na, b, nb, normal, 3), start), normal)
    w = gjk.support(c, a, na, b, nb, vectors.times(-1.0, normal), 4)
    down = vectors.dot(vectors.minus(w, start), normal)
    if -down > up:
        _copy(c, 4, 3)
    if max(up, -down) <= 1e-10 * math.sqrt(along):
        _set_normal(out, normal)
        return False
    return True


def _copy(c: Cores, start: int, end: int) -> None:
    """Write one corner over another."""
    for x in range(10):
        c.corners[end, x] = c.corners[start, x]


def _set_normal(out: Floats, normal: V) -> None:
    out[6], out[7], out[8] = normal[0], normal[1], normal[2]


def _aside(axis: V) -> V:
    """A unit vector at right angles."""
    x, y, z = abs(axis[0]), abs(axis[1]), abs(axis[2])
    unit = vectors.vector(0.0, 0.0, 1.0)
    if x <= y and x <= z:
        unit = vectors.vector(1.0, 0.0, 0.0)
    elif y <= z:
        unit = vectors.vector(0.0, 1.0, 0.0)
    across = vectors.cross(axis, unit)
    return vectors.times(1.0 / math.sqrt(vectors.dot(across, across)), across)


def _normal(p: Polytope, face: int) -> V:
    return (p.planes[face, 0], p.planes[face, 1], p.planes[face, 2])


def _first_faces(c: Cores, p: Polytope) -> None:
    """The four faces of the first tetrahedron, turned outwards."""
    start = gjk.corner(c, 0)
    one, other = vectors.minus(gjk.corner(c, 1), start), vectors.minus(gjk.corner(c, 2), start)
    i, j = 1, 2
    if vectors.dot(vectors.cross(one, other), vectors.minus(gjk.corner(c, 3), start)) > 0.0:
        i, j = 2, 1
    _set_face(c, p, 0, 0, i, j)
    _set_face(c, p, 1, 0, 3, i)
    _set_face(c, p, 2, i, 3, j)
    _set_face(c, p, 3, j, 3, 0)


def _set_face(c: Cores, p: Polytope, f: int, i: int, j: int, k: int) -> None:
    """A face and its plane; one without area is never the nearest."""
    p.faces[f, 0], p.faces[f, 1], p.faces[f, 2] = i, j, k
    start = gjk.corner(c, i)
    normal = vectors.cross(
        vectors.minus(gjk.corner(c, j), start), vectors.minus(gjk.corner(c, k), start)
    )
    length = math.sqrt(vectors.dot(normal, normal))
    if length < 1e-18:
        p.planes[f, 0], p.planes[f, 1], p.planes[f, 2], p.planes[f, 3] = 0.0, 0.0, 0.0, INFINITE
        return
    normal = vectors.times(1.0 / length, normal)
    p.planes[f, 0], p.planes[f, 1], p.planes[f, 2] = normal[0], normal[1], normal[2]
    p.planes[f, 3] = vectors.dot(normal, start)


def _nearest_face(p: Polytope, count: int) -> int:
    found = 0
    for f in range(count):
        if p.planes[f, 3] < p.planes[found, 3]:
            found = f
    return found


def _grow(c: Cores, p: Polytope, new: int, count: int) -> int:
    """Replace the faces that see the new point by a cone over their rim; returns how many faces
    there are then.
    """
    w = gjk.corner(c, new)
    rim, kept, f = 0, count, 0
    while f < kept:
        if p.planes[f, 3] < INFINITE and vectors.dot(_normal(p, f), w) - p.planes[f, 3] > 1e-13:
            for e in range(3):
                rim = _toggle(p, rim, p.faces[f, e], p.faces[f, (e + 1) % 3])
            kept -= 1
            _move_face(p, kept, f)
        else:
            f += 1
    for e in range(rim):
        _set_face(c, p, kept + e, p.edges[e, 0], p.edges[e, 1], new)
    return kept + rim


def _move_face(p: Polytope, start: int, end: int) -> None:
    """Write one face over another."""
    for x in range(3):
        p.faces[end, x] = p.faces[start, x]
    for x in range(4):
        p.planes[end, x] = p.planes[start, x]


def _toggle(p: Polytope, count: int, start: int, end: int) -> int:
    """Add a directed edge, or remove its reverse."""
    for e in range(count):
        if p.edges[e, 0] == end and p.edges[e, 1] == start:
            p.edges[e, 0], p.edges[e, 1] = p.edges[count - 1, 0], p.edges[count - 1, 1]
            return count - 1
    p.edges[count, 0], p.edges[count, 1] = start, end
    return count + 1


def _deepest_points(
    c: Cores, p: Polytope, a: int, na: int, b: int, nb: int, normal: V, depth: float, out: Floats
) -> None:
    """The points on both hulls where they are deepest: where they are nearest once the second
    is drawn off along `normal`.
    """
    away = vectors.times(depth + 1.0, normal)
    for i in range(na):
        for x in range(3):
            p.apart.rows[i, x] = c.rows[a + i, x]
    for i in range(nb):
        p.apart.rows[na + i, 0] = c.rows[b + i, 0] + away[0]
        p.apart.rows[na + i, 1] = c.rows[b + i, 1] + away[1]
        p.apart.rows[na + i, 2] = c.rows[b + i, 2] + away[2]
    gjk.core_distance(p.apart, 0, na, na, nb, INFINITE)
    gjk.nearest_points(p.apart, out)
    out[3] -= away[0]
    out[4] -= away[1]
    out[5] -= away[2]
    _set_normal(out, normal)
