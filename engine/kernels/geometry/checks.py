"""Collision of whole scenes, configuration after configuration. A pair is looked at closely only when its bounding
volumes meet.
"""

import math
from typing import NamedTuple

import numpy as np

from engine.kernels.arrays import Floats, Longs, Truths
from engine.kernels.geometry import compiled, inlined
from engine.kernels.geometry.distance import separation
from engine.kernels.geometry.gjk import core_distance
from engine.kernels.geometry.layout import BLOCK_ITSELF, KIND, Pairs, Pieces
from engine.kernels.geometry.volumes import (
    APART,
    TOUCHING,
    UNDECIDED,
    place_bounds,
    segment_block_gap,
    segment_gap,
    verdict,
)


@compiled
def carriers(parent: Longs, origin: Floats, axis: Floats, prismatic: Truths, q: Floats, out: Floats) -> None:
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


class Room(NamedTuple):
    """What is written while checking; made once for a batch."""

    world: Floats  # (v, 3) vertices in the world
    bounds: Floats  # (n, 18) bounds in the world
    simplex: Floats  # (5, 10)
    found: Floats  # (9,)


@compiled
def room_for(p: Pieces) -> Room:
    """Room for some pieces; those that stand in the world have their place already."""
    return Room(p.vertices.copy(), p.bounds.copy(), np.empty((5, 10)), np.empty(9))


@compiled
def move_bounds(pose: Floats, carrier: Longs, own: Floats, placed: Floats) -> None:
    """Put the bounds (n, 18) of all that moves where the carriers (k + 1, 3, 4) are."""
    for i in range(carrier.shape[0]):
        if carrier[i] != 0:
            place_bounds(pose[carrier[i]], own, i, placed)


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
def move_vertices(pose: Floats, p: Pieces, room: Room) -> None:
    """Put the vertices of all that moves where the carriers are."""
    for i in range(p.carrier.shape[0]):
        if p.carrier[i] != 0:
            place(pose, p, i, room.world)


@compiled
def touches(p: Pieces, room: Room, i: int, j: int, by: float) -> bool:
    """Whether two placed pieces are within `by` (at least 0) of each other.

    Points, segments and blocks by formulas of their own, the rest by GJK.
    """
    a, na, b, nb = p.stretch[i, 0], p.stretch[i, 1], p.stretch[j, 0], p.stretch[j, 1]
    reach, v = p.radius[i] + p.radius[j] + by, room.world
    if na <= 2 and nb <= 2:
        return bool(segment_gap(v, a, na, b, nb) <= reach * reach)
    if na <= 2 and p.bounds[j, KIND] == BLOCK_ITSELF:
        return bool(segment_block_gap(v, a, na, room.bounds, j) <= reach * reach)
    if nb <= 2 and p.bounds[i, KIND] == BLOCK_ITSELF:
        return bool(segment_block_gap(v, b, nb, room.bounds, i) <= reach * reach)
    return bool(core_distance(v, a, na, b, nb, reach, room.simplex) <= reach)


@compiled
def piece_separation(p: Pieces, room: Room, i: int, j: int) -> float:
    """The signed distance of two placed pieces, with points and normal in `room.found`."""
    a, na, b, nb = p.stretch[i, 0], p.stretch[i, 1], p.stretch[j, 0], p.stretch[j, 1]
    return separation(room.world, a, na, p.radius[i], b, nb, p.radius[j], room.simplex, room.found)


@compiled
def first_contacts(poses: Floats, p: Pieces, q: Pairs, out: Longs) -> None:
    """For each of the carrier poses (n, k + 1, 3, 4) the first pair that touches (n,), or -1."""
    room, placed = room_for(p), np.full(p.carrier.shape[0], -1)
    placed[p.carrier == 0] = poses.shape[0]
    for n in range(poses.shape[0]):
        move_bounds(poses[n], p.carrier, p.bounds, room.bounds)
        out[n] = -1
        for g in range(q.groups.shape[0]):
            if verdict(room.bounds, q.groups[g, 0], q.groups[g, 1], 0.0) != APART:
                out[n] = _first_of_group(poses[n], p, q, g, n, placed, room)
                if out[n] >= 0:
                    break


@compiled
def count_hits(poses: Floats, p: Pieces, q: Pairs, hits: Longs) -> None:
    """In how many of the carrier poses each group (g,) has a pair that touches."""
    room, placed = room_for(p), np.full(p.carrier.shape[0], -1)
    placed[p.carrier == 0] = poses.shape[0]
    for n in range(poses.shape[0]):
        move_bounds(poses[n], p.carrier, p.bounds, room.bounds)
        for g in range(q.groups.shape[0]):
            if _first_of_group(poses[n], p, q, g, n, placed, room) >= 0:
                hits[g] += 1


@inlined
def _first_of_group(pose: Floats, p: Pieces, q: Pairs, g: int, n: int, placed: Longs, room: Room) -> int:
    """The first pair of a group that touches, or -1. A first piece that is off the other bounds spares its pairs."""
    m, last, checked = q.groups[g, 2], q.groups[g, 3], -1
    while m < last:
        i, j = q.pairs[m, 0], q.pairs[m, 1]
        if i != checked and verdict(room.bounds, i, q.groups[g, 1], 0.0) == APART:
            m = q.after[m]
            continue
        checked = i
        said = verdict(room.bounds, i, j, 0.0)
        if said == TOUCHING or (said == UNDECIDED and _decided(pose, p, i, j, n, placed, room)):
            return int(q.order[m])
        m += 1
    return -1


@compiled
def _decided(pose: Floats, p: Pieces, i: int, j: int, n: int, placed: Longs, room: Room) -> bool:
    """Whether two pieces touch; their vertices are placed first, if their number in `placed` is old."""
    for each in (i, j):
        if placed[each] < n:
            place(pose, p, each, room.world)
            placed[each] = n
    return touches(p, room, i, j, 0.0)


@compiled
def nearest_pairs(
    poses: Floats, p: Pieces, q: Pairs, beyond: float, distance: Floats, pair: Longs, witness: Floats
) -> None:
    """The least signed distance (n,) below `beyond`, its pair (n,) or -1, and its points and normal (n, 9)."""
    room = room_for(p)
    for n in range(poses.shape[0]):
        move_bounds(poses[n], p.carrier, p.bounds, room.bounds)
        move_vertices(poses[n], p, room)
        distance[n], pair[n], witness[n] = beyond, -1, 0.0
        for g in range(q.groups.shape[0]):
            margin = max(distance[n], 0.0)
            if verdict(room.bounds, q.groups[g, 0], q.groups[g, 1], margin) == APART:
                continue
            for m in range(q.groups[g, 2], q.groups[g, 3]):
                i, j = q.pairs[m, 0], q.pairs[m, 1]
                if verdict(room.bounds, i, j, max(distance[n], 0.0)) == APART:
                    continue
                gap = piece_separation(p, room, i, j)
                if gap < distance[n]:
                    distance[n], pair[n], witness[n] = gap, q.order[m], room.found


@compiled
def near_pairs(
    pose: Floats, p: Pieces, pairs: Longs, within: float, distance: Floats, witness: Floats
) -> None:
    """For one set of carrier poses, the signed distance of every pair (m,) nearer than `within`, else infinity."""
    room = room_for(p)
    move_bounds(pose, p.carrier, p.bounds, room.bounds)
    move_vertices(pose, p, room)
    for m in range(pairs.shape[0]):
        i, j = pairs[m, 0], pairs[m, 1]
        distance[m] = math.inf
        if verdict(room.bounds, i, j, within) != APART:
            distance[m] = piece_separation(p, room, i, j)
            witness[m] = room.found
