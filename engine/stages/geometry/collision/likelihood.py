"""Which pairs of a scene can touch at all, and which do so most often: what a check had better look at first.

Neither changes an answer; both are found once for a scene.
"""

import math

import numpy as np

from cellwright.engine.kernels.geometry.layout import AXES, BALL, HALF, RADIUS, Pairs, Pieces
from cellwright.engine.model.geometry import Floats, Joints, Longs, Scene, Truths

SAMPLES = 512
MOST_TRIED = 16  # pairs that are tried before a walk down a tree
WORTH = 0.03  # of the poses that are left


def touchable(scene: Scene, pieces: Pieces, within_m: float = 0.0) -> Truths:
    """Which pairs (m,) come within a distance of each other in some configuration, as far as their reach tells."""
    if scene.free or not len(scene.pairs):
        return np.ones(len(scene.pairs), dtype=bool)
    anchors, reach = _reaches(scene.joints)
    carrier, bounds = pieces.carrier, pieces.bounds
    around = anchors[carrier]
    far = reach[carrier] + np.linalg.norm(bounds[:, :3], axis=1) + bounds[:, BALL]
    i, j = scene.pairs.T
    first_moves, both = carrier[i] != 0, (carrier[i] != 0) & (carrier[j] != 0)
    moving, other = np.where(first_moves, i, j), np.where(first_moves, j, i)
    gap = _block_gap(bounds[other], around[moving]) - far[moving]
    apart = np.linalg.norm(around[i] - around[j], axis=1) - far[i] - far[j]
    kept: Truths = np.where(both, apart, gap) <= within_m
    return kept


def reachable(scene: Scene, moving: Pieces, standing: Pieces) -> Truths:
    """Which of the standing pieces (m,) come within the reach of some moving piece."""
    if scene.free:
        return np.ones(standing.count, dtype=bool)
    anchors, reach = _reaches(scene.joints)
    far = reach[moving.carrier] + np.linalg.norm(moving.bounds[:, :3], axis=1) + moving.bounds[:, BALL]
    found = np.zeros(standing.count, dtype=bool)
    for carrier in sorted(set(moving.carrier.tolist())):
        around = np.broadcast_to(anchors[carrier], (standing.count, 3))
        found |= _block_gap(standing.bounds, around) <= far[moving.carrier == carrier].max()
    return found


def _reaches(joints: Joints) -> tuple[Floats, Floats]:
    """For each carrier (k + 1,) the point about which the first of its joints turns, and how far its origin gets from it."""
    anchors, reach = np.zeros((joints.count + 1, 3)), np.zeros(joints.count + 1)
    for index, parent in enumerate(joints.parent):
        travel = max(abs(joints.lower[index]), abs(joints.upper[index])) if joints.prismatic[index] else 0.0
        step = joints.T_parent_origin[index, :3, 3]
        anchors[index + 1] = anchors[parent] if parent else step
        reach[index + 1] = reach[parent] + travel + (float(np.linalg.norm(step)) if parent else 0.0)
    return anchors, reach


def _block_gap(bounds: Floats, points: Floats) -> Floats:
    """How far points (n, 3) are from the blocks of bounds (n, 18) in the world, less the pieces' radii."""
    axes = bounds[:, AXES:HALF].reshape(-1, 3, 3)
    along = np.abs(np.einsum("nij,nj->ni", axes, points - bounds[:, :3]))
    gap: Floats = np.linalg.norm((along - bounds[:, HALF:RADIUS]).clip(min=0.0), axis=1) - bounds[:, RADIUS]
    return gap


def sampled(joints: Joints) -> Floats:
    """Configurations (n, k) within the limits, of unlimited joints within a half-turn or a metre."""
    span = np.where(joints.prismatic, 1.0, math.pi)
    low = np.where(np.isfinite(joints.lower), joints.lower, -span)
    high = np.where(np.isfinite(joints.upper), joints.upper, span)
    found: Floats = np.random.default_rng(0).uniform(low, high, (SAMPLES, joints.count))
    return found


def likeliest_first(poses: Floats, pieces: Pieces, pairs: Pairs) -> Pairs:
    """The pairs with the groups first that touch most often in carrier poses (n, k + 1, 3, 4)."""
    from cellwright.engine.kernels.geometry.checks import count_hits

    hits = np.zeros(len(pairs.groups), dtype=np.int64)
    count_hits(poses, pieces, pairs, hits)
    groups = np.ascontiguousarray(pairs.groups[np.argsort(-hits, kind="stable")])
    return Pairs(pairs.pairs, groups, pairs.after, pairs.order)


def settling(hits: Longs) -> Longs:
    """Few pairs (k, 2) of which one touches in as many poses as possible, the best first; at most `MOST_TRIED`.

    `hits` (m, 3) are a pose and two numbers of a pair each. A pair is worth a try in every pose if it settles a share `WORTH` of
    the poses that those before it leave open; poses in which nothing touches never count as settled.
    """
    pairs, which = np.unique(hits[:, 1:], axis=0, return_inverse=True)
    which, pose, found = which.reshape(-1), hits[:, 0], list[int]()
    unsettled = SAMPLES
    while len(found) < MOST_TRIED and len(pose):
        gains = np.bincount(which, minlength=len(pairs))
        best = int(gains.argmax())
        if gains[best] < WORTH * unsettled:
            break
        found.append(best)
        unsettled -= int(gains[best])
        left = ~np.isin(pose, pose[which == best])
        pose, which = pose[left], which[left]
    chosen: Longs = pairs[found].astype(np.int64).reshape(-1, 2)
    return chosen
