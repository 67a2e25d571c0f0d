"""A box in place of all that some joints carry, so large that it covers them wherever these joints stand between two values.

Handey plans with such a box for the last three links, the hand and what it holds (Mazer and others 1992, section 4.2).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats, Joints, Longs, Piece, Scene, Truths
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arms import carrier_poses

COVER = "the box around the hand"
SAMPLES = 33  # places between start and goal at which the box is measured; it grows by what moves in between
CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))


def covered(scene: Scene, wrist: Sequence[int], start: Floats, goal: Floats) -> Scene:
    """The scene with a box for all that the joints `wrist` carry.

    The box stands on what the first of these joints stands on, and covers their values between two configurations (k,). It is
    checked against all bodies that anything in it was checked against. What is in it is not checked against one another.
    """
    below = int(scene.joints.parent[wrist[0]])
    inside = np.array([_hangs_on(scene.joints, piece.carrier, wrist) for piece in scene.pieces], dtype=bool)
    low, high = _extent(scene, inside, below, wrist, start, goal)
    at = transforms.translation(*((low + high) / 2))
    box = Piece(COVER, below, at, CORNERS * (high - low), 0.0, box=True)
    kept = np.nonzero(~inside)[0]
    pieces = (*(scene.pieces[n] for n in kept), box)
    pairs = _pairs(scene, inside, below)
    return replace(scene, pieces=pieces, pairs=pairs, bodies=tuple(dict.fromkeys(p.body for p in pieces)))


def _hangs_on(joints: Joints, carrier: int, wrist: Sequence[int]) -> bool:
    while carrier > 0:
        if carrier - 1 in wrist:
            return True
        carrier = int(joints.parent[carrier - 1])
    return False


def _extent(
    scene: Scene, inside: Truths, below: int, wrist: Sequence[int], start: Floats, goal: Floats
) -> tuple[Floats, Floats]:
    """The least and the greatest corner (3,) of what is inside, in the frame of carrier `below`."""
    share = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    where = np.repeat(start[None], SAMPLES, axis=0)
    where[:, list(wrist)] += share * (goal - start)[list(wrist)]
    carriers = carrier_poses(scene.joints, where)
    inward = transforms.inverse(carriers[:, below])
    turned = np.abs(goal - start)[list(wrist)] / (SAMPLES - 1) / 2
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for piece in (scene.pieces[n] for n in np.nonzero(inside)[0]):
        points = transforms.apply(
            matmul(inward, carriers[:, piece.carrier], piece.T_carrier_piece), piece.vertices
        )
        room = piece.radius_m + _strays(scene.joints, carriers, inward, points, wrist, turned, piece.radius_m)
        low = np.minimum(low, points.min(axis=(0, 1)) - room)
        high = np.maximum(high, points.max(axis=(0, 1)) + room)
    return low, high


def _strays(
    joints: Joints,
    carriers: Floats,
    inward: Floats,
    points: Floats,
    wrist: Sequence[int],
    turned: Floats,
    radius_m: float,
) -> float:
    """How far a piece can be from the nearest of the samples: half a step of each joint, times the distance from its origin."""
    total = 0.0
    for joint, half in zip(wrist, turned, strict=True):
        if joints.prismatic[joint]:
            total += float(half)
            continue
        origin = (matmul(inward, carriers[:, joint + 1]))[:, None, :3, 3]
        away = np.linalg.norm(points - origin, axis=-1).max() + radius_m
        total += float(half) * float(away)
    return total * (1.0 + float(turned.sum()))


def _pairs(scene: Scene, inside: Truths, below: int) -> Longs:
    """The pairs of the pieces that are kept, and those of the box, which has the last number."""
    number = np.cumsum(~inside) - 1
    pairs = scene.pairs.reshape(-1, 2)
    within = inside[pairs]
    kept = number[pairs[~within.any(axis=1)]]
    mixed = pairs[within.sum(axis=1) == 1]
    others = np.unique(mixed[~inside[mixed]])
    others = others[[scene.pieces[n].carrier != below for n in others]]
    last = int((~inside).sum())
    with_box = np.stack([number[others], np.full(len(others), last)], axis=1)
    found: Longs = np.concatenate([kept, with_box]).astype(np.int64).reshape(-1, 2)
    return found
