"""How deep two convex hulls overlap: the distance from the origin to the surface of their difference.

A polytope inside the difference is grown until its nearest face is one of the difference's own (the expanding polytope
of van den Bergen 2001). As signed distances are compared, it may begin with a tetrahedron that does not hold the
origin: a face that separates it from the origin is the nearest one and grows first.
"""

import math

import numpy as np

from engine.kernels.arrays import Floats, Longs
from engine.kernels.geometry import compiled
from engine.kernels.geometry.gjk import core_distance, nearest_points, point_of, support
from engine.kernels.geometry.vectors import V, cross, dot, minus, times

MAX_POINTS = 160
MAX_FACES = 4 * MAX_POINTS  # a hull of n corners has at most 2 n - 4 triangles


@compiled
def core_depth(vertices: Floats, a: int, na: int, b: int, nb: int, out: Floats) -> float:
    """How deep two hulls that meet overlap, with the points and the normal in `out` (9,); of flat differences the normal alone."""
    points = np.zeros((MAX_POINTS, 10))
    if not _first_tetrahedron(vertices, a, na, b, nb, points, out):
        return 0.0
    faces, planes = np.zeros((MAX_FACES, 3), np.int64), np.zeros((MAX_FACES, 4))
    count = _first_faces(points, faces, planes)
    edges = np.zeros((2 * MAX_FACES, 2), np.int64)
    face = 0
    for used in range(4, MAX_POINTS):
        face = _nearest_face(planes, count)
        normal = point_of(planes, face, 0)
        w = support(vertices, a, na, b, nb, normal, points, used)
        if dot(normal, w) - planes[face, 3] <= 1e-11:
            break
        count = _grow(points, used, faces, planes, count, edges)
    depth = max(0.0, float(planes[face, 3]))
    _deepest_points(vertices, a, na, b, nb, point_of(planes, face, 0), depth, out)
    return depth


@compiled
def _first_tetrahedron(
    vertices: Floats, a: int, na: int, b: int, nb: int, points: Floats, out: Floats
) -> bool:
    """Four corners of the difference that span a volume; if it has none, a normal of it in `out` and False."""
    size = 0.0
    line = (0.0, 0.0, 0.0)
    for axis in range(3):
        d = (1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0)
        low = support(vertices, a, na, b, nb, times(-1.0, d), points, 4)
        high = support(vertices, a, na, b, nb, d, points, 5)
        step = minus(high, low)
        if dot(step, step) > size:
            size, line = dot(step, step), step
            points[0], points[1] = points[4], points[5]
    if size < 1e-24:
        _set_normal(out, (0.0, 0.0, 1.0))
        return False
    return _third_and_fourth(vertices, a, na, b, nb, points, out, line)


@compiled
def _third_and_fourth(
    vertices: Floats, a: int, na: int, b: int, nb: int, points: Floats, out: Floats, line: V
) -> bool:
    start = point_of(points, 0, 0)
    across = _aside(line)
    other = cross(times(1.0 / math.sqrt(dot(line, line)), line), across)
    normal, best = (0.0, 0.0, 0.0), 0.0
    for turn in range(4):
        d = across if turn % 2 == 0 else other
        w = support(vertices, a, na, b, nb, times(1.0 if turn < 2 else -1.0, d), points, 4)
        n = cross(line, minus(w, start))
        if dot(n, n) > best:
            normal, best = n, dot(n, n)
            points[2] = points[4]
    if best <= 1e-20 * dot(line, line) * dot(line, line):
        _set_normal(out, across)
        return False
    normal = times(1.0 / math.sqrt(best), normal)
    up = dot(minus(support(vertices, a, na, b, nb, normal, points, 3), start), normal)
    down = dot(minus(support(vertices, a, na, b, nb, times(-1.0, normal), points, 4), start), normal)
    if -down > up:
        points[3] = points[4]
    if max(up, -down) <= 1e-10 * math.sqrt(dot(line, line)):
        _set_normal(out, normal)
        return False
    return True


@compiled
def _set_normal(out: Floats, normal: V) -> None:
    out[6], out[7], out[8] = normal


@compiled
def _aside(axis: V) -> V:
    """A unit vector at right angles."""
    x, y, z = abs(axis[0]), abs(axis[1]), abs(axis[2])
    unit = (1.0, 0.0, 0.0) if x <= y and x <= z else (0.0, 1.0, 0.0) if y <= z else (0.0, 0.0, 1.0)
    across = cross(axis, unit)
    return times(1.0 / math.sqrt(dot(across, across)), across)


@compiled
def _first_faces(points: Floats, faces: Longs, planes: Floats) -> int:
    """The four faces of the first tetrahedron, turned outwards."""
    p = point_of(points, 0, 0)
    normal = cross(minus(point_of(points, 1, 0), p), minus(point_of(points, 2, 0), p))
    swap = dot(normal, minus(point_of(points, 3, 0), p)) > 0.0
    b, c = (2, 1) if swap else (1, 2)
    corners = ((0, b, c), (0, 3, b), (b, 3, c), (c, 3, 0))
    for f in range(4):
        _set_face(points, faces, planes, f, corners[f])
    return 4


@compiled
def _set_face(points: Floats, faces: Longs, planes: Floats, f: int, corners: tuple[int, int, int]) -> None:
    """A face and its plane; one without area is never the nearest."""
    faces[f, 0], faces[f, 1], faces[f, 2] = corners
    p = point_of(points, corners[0], 0)
    normal = cross(minus(point_of(points, corners[1], 0), p), minus(point_of(points, corners[2], 0), p))
    length = math.sqrt(dot(normal, normal))
    if length < 1e-18:
        planes[f, 0], planes[f, 1], planes[f, 2], planes[f, 3] = 0.0, 0.0, 0.0, math.inf
        return
    normal = times(1.0 / length, normal)
    planes[f, 0], planes[f, 1], planes[f, 2] = normal
    planes[f, 3] = dot(normal, p)


@compiled
def _nearest_face(planes: Floats, count: int) -> int:
    found = 0
    for f in range(count):
        if planes[f, 3] < planes[found, 3]:
            found = f
    return found


@compiled
def _grow(points: Floats, new: int, faces: Longs, planes: Floats, count: int, edges: Longs) -> int:
    """Replace the faces that see the new point by a cone over their rim; returns how many faces there are then."""
    w = point_of(points, new, 0)
    rim, kept, f = 0, count, 0
    while f < kept:
        if planes[f, 3] < math.inf and dot(point_of(planes, f, 0), w) - planes[f, 3] > 1e-13:
            for e in range(3):
                rim = _toggle(edges, rim, faces[f, e], faces[f, (e + 1) % 3])
            kept -= 1
            faces[f], planes[f] = faces[kept], planes[kept]
        else:
            f += 1
    for e in range(rim):
        _set_face(points, faces, planes, kept + e, (edges[e, 0], edges[e, 1], new))
    return kept + rim


@compiled
def _toggle(edges: Longs, count: int, start: int, end: int) -> int:
    """Add a directed edge, or remove its reverse."""
    for e in range(count):
        if edges[e, 0] == end and edges[e, 1] == start:
            edges[e, 0], edges[e, 1] = edges[count - 1, 0], edges[count - 1, 1]
            return count - 1
    edges[count, 0], edges[count, 1] = start, end
    return count + 1


@compiled
def _deepest_points(
    vertices: Floats, a: int, na: int, b: int, nb: int, normal: V, depth: float, out: Floats
) -> None:
    """The points on both hulls where they are deepest: where they are nearest once the second is drawn off along `normal`."""
    away = times(depth + 1.0, normal)
    rows, simplex = np.empty((na + nb, 3)), np.empty((5, 10))
    rows[:na] = vertices[a : a + na]
    for i in range(nb):
        for c in range(3):
            rows[na + i, c] = vertices[b + i, c] + away[c]
    core_distance(rows, 0, na, na, nb, math.inf, simplex)
    nearest_points(simplex, int(simplex[4, 9]), out)
    for c in range(3):
        out[3 + c] -= away[c]
    _set_normal(out, normal)
