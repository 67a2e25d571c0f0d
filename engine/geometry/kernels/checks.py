"""Collision of whole scenes, configuration after configuration.

A scene is a bundle of arrays (`engine.geometry.builtin` packs them): vertices in their carriers' frames; for each
piece its stretch of rows, radius, carrier, bounding ball and bounding block; and the pairs to be checked. A pair is
looked at closely only when its bounding volumes meet.
"""

import math

import numpy as np

from engine.geometry.kernels import compiled
from engine.geometry.kernels.distance import separation
from engine.geometry.kernels.gjk import core_distance
from engine.geometry.kernels.volumes import far_apart, segment_block_gap, segment_gap
from engine.model.geometry import Floats, Ints, Truths


@compiled
def carriers(
    parent: Ints, origin: Floats, axis: Floats, prismatic: Truths, q: Floats, first: int, out: Floats
) -> None:
    """The pose of every carrier (m, k + 1, 3, 4) for the m configurations of q (n, k) from row `first`."""
    turned = np.empty((3, 3))
    for n in range(out.shape[0]):
        _set_identity(out[n, 0])
        for j in range(parent.shape[0]):
            value = q[first + n, j]
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
def place_centres(pose: Floats, carrier: Ints, ball: Floats, centres: Floats) -> None:
    """The centres (p, 3) of the bounding balls (p, 4) in the world."""
    for p in range(carrier.shape[0]):
        T = pose[carrier[p]]
        for r in range(3):
            centres[p, r] = T[r, 0] * ball[p, 0] + T[r, 1] * ball[p, 1] + T[r, 2] * ball[p, 2] + T[r, 3]


@compiled
def place(pose: Floats, vertices: Floats, start: int, count: int, out: Floats) -> None:
    """The vertices of one piece in the world."""
    for i in range(start, start + count):
        for r in range(3):
            out[i, r] = (
                pose[r, 0] * vertices[i, 0]
                + pose[r, 1] * vertices[i, 1]
                + pose[r, 2] * vertices[i, 2]
                + pose[r, 3]
            )


@compiled
def first_contacts(
    poses: Floats,
    vertices: Floats,
    stretch: Ints,
    radius: Floats,
    carrier: Ints,
    ball: Floats,
    block: Floats,
    is_block: Truths,
    pairs: Ints,
    out: Ints,
) -> None:
    """For each of the carrier poses (n, k + 1, 3, 4) the first pair that touches (n,), or -1."""
    count = carrier.shape[0]
    world, centres, simplex = vertices.copy(), np.empty((count, 3)), np.empty((5, 10))
    placed = np.full(count, -1)
    placed[carrier == 0] = poses.shape[0]
    for n in range(poses.shape[0]):
        pose = poses[n]
        place_centres(pose, carrier, ball, centres)
        out[n] = -1
        for m in range(pairs.shape[0]):
            i, j = pairs[m, 0], pairs[m, 1]
            if far_apart(pose, carrier, ball, block, radius, centres, i, j, 0.0):
                continue
            for p in (i, j):
                if placed[p] != n and placed[p] != poses.shape[0]:
                    place(pose[carrier[p]], vertices, stretch[p, 0], stretch[p, 1], world)
                    placed[p] = n
            if touches(pose, world, stretch, radius, carrier, block, is_block, i, j, simplex):
                out[n] = m
                break


@compiled
def touches(
    pose: Floats,
    world: Floats,
    stretch: Ints,
    radius: Floats,
    carrier: Ints,
    block: Floats,
    is_block: Truths,
    i: int,
    j: int,
    simplex: Floats,
) -> bool:
    """Whether two placed pieces touch: points, segments and blocks by formulas of their own, the rest by GJK."""
    a, na, b, nb = stretch[i, 0], stretch[i, 1], stretch[j, 0], stretch[j, 1]
    reach = radius[i] + radius[j]
    if na <= 2 and nb <= 2:
        return bool(segment_gap(world, a, na, b, nb) <= reach * reach)
    if na <= 2 and is_block[j]:
        return bool(segment_block_gap(world, a, na, pose[carrier[j]], block[j]) <= reach * reach)
    if nb <= 2 and is_block[i]:
        return bool(segment_block_gap(world, b, nb, pose[carrier[i]], block[i]) <= reach * reach)
    return bool(core_distance(world, a, na, b, nb, reach, simplex) <= reach)


@compiled
def nearest_pairs(
    poses: Floats,
    vertices: Floats,
    stretch: Ints,
    radius: Floats,
    carrier: Ints,
    ball: Floats,
    block: Floats,
    pairs: Ints,
    beyond: float,
    distance: Floats,
    pair: Ints,
    witness: Floats,
) -> None:
    """The least signed distance (n,) below `beyond`, its pair (n,) or -1, and its points and normal (n, 9)."""
    count = carrier.shape[0]
    world, centres, simplex, found = vertices.copy(), np.empty((count, 3)), np.empty((5, 10)), np.empty(9)
    for n in range(poses.shape[0]):
        place_centres(poses[n], carrier, ball, centres)
        for p in range(count):
            place(poses[n, carrier[p]], vertices, stretch[p, 0], stretch[p, 1], world)
        distance[n], pair[n], witness[n] = beyond, -1, 0.0
        for m in range(pairs.shape[0]):
            i, j = pairs[m, 0], pairs[m, 1]
            if far_apart(poses[n], carrier, ball, block, radius, centres, i, j, max(distance[n], 0.0)):
                continue
            gap = separation(
                world,
                stretch[i, 0],
                stretch[i, 1],
                radius[i],
                stretch[j, 0],
                stretch[j, 1],
                radius[j],
                simplex,
                found,
            )
            if gap < distance[n]:
                distance[n], pair[n], witness[n] = gap, m, found


@compiled
def near_pairs(
    pose: Floats,
    vertices: Floats,
    stretch: Ints,
    radius: Floats,
    carrier: Ints,
    ball: Floats,
    block: Floats,
    pairs: Ints,
    within: float,
    distance: Floats,
    witness: Floats,
) -> None:
    """For one set of carrier poses, the signed distance of every pair (m,) nearer than `within`, else infinity."""
    count = carrier.shape[0]
    world, centres, simplex = vertices.copy(), np.empty((count, 3)), np.empty((5, 10))
    place_centres(pose, carrier, ball, centres)
    for p in range(count):
        place(pose[carrier[p]], vertices, stretch[p, 0], stretch[p, 1], world)
    for m in range(pairs.shape[0]):
        i, j = pairs[m, 0], pairs[m, 1]
        distance[m] = math.inf
        if not far_apart(pose, carrier, ball, block, radius, centres, i, j, within):
            distance[m] = separation(
                world,
                stretch[i, 0],
                stretch[i, 1],
                radius[i],
                stretch[j, 0],
                stretch[j, 1],
                radius[j],
                simplex,
                witness[m],
            )
