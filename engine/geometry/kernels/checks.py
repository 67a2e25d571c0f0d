"""Collision of whole scenes, configuration after configuration. A pair is looked at closely only when its bounding
volumes meet.
"""

import math

import numpy as np

from engine.geometry.kernels import compiled
from engine.geometry.kernels.distance import separation
from engine.geometry.kernels.gjk import core_distance
from engine.geometry.kernels.volumes import far_apart, segment_block_gap, segment_gap
from engine.geometry.packing import Pieces
from engine.model.geometry import Floats, Ints, Truths


@compiled
def carriers(parent: Ints, origin: Floats, axis: Floats, prismatic: Truths, q: Floats, out: Floats) -> None:
    """The pose of every carrier (n, k + 1, 3, 4) for configurations q (n, k)."""
    turned = np.empty((3, 3))
    for n in range(out.shape[0]):
        _set_identity(out[n, 0])
        for j in range(parent.shape[0]):
            value = q[n, j]
            _motion(axis[j], 0.0 if prismatic[j] else value, turned)
            above, here, fixed = out[n, parent[j]], out[n, j + 1], origin[j]
            for r in range(3):
                x = above[r, 0] * fixed[0, 0] + above[r, 1] * fixed[1, 0] + above[r, 2] * fixed[2, 0]
                y = above[r, 0] * fixed[0, 1] + above[r, 1] * fixed[1, 1] + above[r, 2] * fixed[2, 1]
                z = above[r, 0] * fixed[0, 2] + above[r, 1] * fixed[1, 2] + above[r, 2] * fixed[2, 2]
                p = (
                    above[r, 0] * fixed[0, 3]
                    + above[r, 1] * fixed[1, 3]
                    + above[r, 2] * fixed[2, 3]
                    + above[r, 3]
                )
                slide = value if prismatic[j] else 0.0
                p += slide * (x * axis[j, 0] + y * axis[j, 1] + z * axis[j, 2])
                for c in range(3):
                    here[r, c] = x * turned[0, c] + y * turned[1, c] + z * turned[2, c]
                here[r, 3] = p


@compiled
def _set_identity(pose: Floats) -> None:
    pose[:] = 0.0
    pose[0, 0] = pose[1, 1] = pose[2, 2] = 1.0


@compiled
def _motion(axis: Floats, angle: float, out: Floats) -> None:
    """The rotation (3, 3) about a unit axis (Rodrigues)."""
    s, c = math.sin(angle), math.cos(angle)
    x, y, z, t = axis[0], axis[1], axis[2], 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + t * x * x, t * x * y - s * z, t * x * z + s * y
    out[1, 0], out[1, 1], out[1, 2] = t * x * y + s * z, c + t * y * y, t * y * z - s * x
    out[2, 0], out[2, 1], out[2, 2] = t * x * z - s * y, t * y * z + s * x, c + t * z * z


@compiled
def place_centres(pose: Floats, p: Pieces, centres: Floats) -> None:
    """The centres (n, 3) of the bounding balls in the world."""
    for i in range(p.carrier.shape[0]):
        T = pose[p.carrier[i]]
        for r in range(3):
            centres[i, r] = T[r, 0] * p.ball[i, 0] + T[r, 1] * p.ball[i, 1] + T[r, 2] * p.ball[i, 2] + T[r, 3]


@compiled
def place(pose: Floats, p: Pieces, i: int, world: Floats) -> None:
    """The vertices of piece `i` in the world."""
    T, vertices = pose[p.carrier[i]], p.vertices
    for row in range(p.stretch[i, 0], p.stretch[i, 0] + p.stretch[i, 1]):
        for r in range(3):
            world[row, r] = (
                T[r, 0] * vertices[row, 0] + T[r, 1] * vertices[row, 1] + T[r, 2] * vertices[row, 2] + T[r, 3]
            )


@compiled
def touches(pose: Floats, world: Floats, p: Pieces, i: int, j: int, by: float, simplex: Floats) -> bool:
    """Whether two placed pieces are within `by` (at least 0) of each other.

    Points, segments and blocks by formulas of their own, the rest by GJK.
    """
    a, na, b, nb = p.stretch[i, 0], p.stretch[i, 1], p.stretch[j, 0], p.stretch[j, 1]
    reach = p.radius[i] + p.radius[j] + by
    if na <= 2 and nb <= 2:
        return bool(segment_gap(world, a, na, b, nb) <= reach * reach)
    if na <= 2 and p.is_block[j]:
        return bool(segment_block_gap(world, a, na, pose[p.carrier[j]], p.block[j]) <= reach * reach)
    if nb <= 2 and p.is_block[i]:
        return bool(segment_block_gap(world, b, nb, pose[p.carrier[i]], p.block[i]) <= reach * reach)
    return bool(core_distance(world, a, na, b, nb, reach, simplex) <= reach)


@compiled
def piece_separation(world: Floats, p: Pieces, i: int, j: int, simplex: Floats, out: Floats) -> float:
    """The signed distance of two placed pieces, with points and normal in `out` (9,)."""
    a, na, b, nb = p.stretch[i, 0], p.stretch[i, 1], p.stretch[j, 0], p.stretch[j, 1]
    return separation(world, a, na, p.radius[i], b, nb, p.radius[j], simplex, out)


@compiled
def first_contacts(poses: Floats, p: Pieces, pairs: Ints, out: Ints) -> None:
    """For each of the carrier poses (n, k + 1, 3, 4) the first pair (m, 2) that touches (n,), or -1."""
    count = p.carrier.shape[0]
    world, centres, simplex = p.vertices.copy(), np.empty((count, 3)), np.empty((5, 10))
    placed = np.full(count, -1)
    placed[p.carrier == 0] = poses.shape[0]
    for n in range(poses.shape[0]):
        pose = poses[n]
        place_centres(pose, p, centres)
        out[n] = -1
        for m in range(pairs.shape[0]):
            i, j = pairs[m, 0], pairs[m, 1]
            if far_apart(pose, p, centres, i, j, 0.0):
                continue
            for each in (i, j):
                if placed[each] != n and placed[each] != poses.shape[0]:
                    place(pose, p, each, world)
                    placed[each] = n
            if touches(pose, world, p, i, j, 0.0, simplex):
                out[n] = m
                break


@compiled
def nearest_pairs(
    poses: Floats, p: Pieces, pairs: Ints, beyond: float, distance: Floats, pair: Ints, witness: Floats
) -> None:
    """The least signed distance (n,) below `beyond`, its pair (n,) or -1, and its points and normal (n, 9)."""
    count = p.carrier.shape[0]
    world, centres, simplex, found = p.vertices.copy(), np.empty((count, 3)), np.empty((5, 10)), np.empty(9)
    for n in range(poses.shape[0]):
        place_centres(poses[n], p, centres)
        for i in range(count):
            place(poses[n], p, i, world)
        distance[n], pair[n], witness[n] = beyond, -1, 0.0
        for m in range(pairs.shape[0]):
            i, j = pairs[m, 0], pairs[m, 1]
            if far_apart(poses[n], p, centres, i, j, max(distance[n], 0.0)):
                continue
            gap = piece_separation(world, p, i, j, simplex, found)
            if gap < distance[n]:
                distance[n], pair[n], witness[n] = gap, m, found


@compiled
def near_pairs(
    pose: Floats, p: Pieces, pairs: Ints, within: float, distance: Floats, witness: Floats
) -> None:
    """For one set of carrier poses, the signed distance of every pair (m,) nearer than `within`, else infinity."""
    count = p.carrier.shape[0]
    world, centres, simplex = p.vertices.copy(), np.empty((count, 3)), np.empty((5, 10))
    place_centres(pose, p, centres)
    for i in range(count):
        place(pose, p, i, world)
    for m in range(pairs.shape[0]):
        i, j = pairs[m, 0], pairs[m, 1]
        distance[m] = math.inf
        if not far_apart(pose, p, centres, i, j, within):
            distance[m] = piece_separation(world, p, i, j, simplex, witness[m])
