# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Sixteen configurations on a line checked for collision side by side, in single precision
(`lanes.h`).

This spares work, and changes no answer: a lane that is not surely apart, or surely touching, by
more than all rounding is in doubt, and whoever asks looks at the groups of pairs in doubt in double
precision. Without a C compiler all is in doubt.
"""

import os
from typing import Any

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Floats, Singles
from cellwright.engine.kernels.geometry import layout
from cellwright.engine.kernels.geometry.layout import Pairs, Pieces
from cellwright.engine.kernels.geometry.mechanism import Mechanism
from cellwright.engine.kernels.linear import matmul, norm

# Of all lengths that a position is made of, this share is more than rounding takes, for each joint
# on the way: an angle within half a turn is rounded by 2e-7 rad, its sine by 2e-7, and each of the
# some twenty products and sums of a joint by 6e-8.
ROUNDING = 2.0**-18
NEVER = 2**31 - 1  # what stands is not put in place again
TURNED = 1e6  # rad: joints that turn farther are not looked at in single precision
ZERO = 1e-12  # entries of rotations that are smaller are none


class Narrow:
    """A scene in single precision, made once for many lines: joints, pieces and pairs. All arrays
    of it are read only.

    Carriers have frames of their own here, in which joints turn about z, or slide along it: then
    products with zeros can be left out. `slack` (n,) is how far each piece may be from where it is
    taken to be (m), more than all rounding. Raises `ValueError` for what does not fit together.
    """

    def __init__(self, mechanism: Mechanism, pieces: Pieces, pairs: Pairs) -> None:
        if pairs.numbers > pieces.count or pieces.carriers > mechanism.count + 1:
            raise ValueError(
                f"pairs or carriers beyond {pieces.count} pieces and {mechanism.count} joints"
            )
        self.mechanism, self.pieces, self.pairs = mechanism, pieces, pairs
        frames = _frames(mechanism.axes)
        self.origins, self.bounds = _origins(mechanism, frames), _bounds(pieces, frames)
        self.middle = _in_all_lanes(pieces.bounds[:, :3])
        self.axes = _in_all_lanes(pieces.bounds[:, layout.AXES : layout.HALF])
        self.slack = _slack(mechanism, pieces)
        self.most = np.where(mechanism.sliding, mechanism.travels, TURNED)
        self.placed = (
            np.where(pieces.carrier == 0, NEVER, 0)[None].repeat(2, axis=0).astype(np.int32)
        )
        self.poses = np.zeros((mechanism.count + 1, 12, 16), np.float32)
        self.poses[0, [0, 4, 8]] = 1.0


def _in_all_lanes(entries: Floats) -> Singles:
    """Entries (n, m) once for each lane (n, m, 16)."""
    found: Singles = np.ascontiguousarray(
        np.repeat(entries.astype(np.float32)[:, :, None], 16, axis=2)
    )
    return found


def _frames(axes: Floats) -> Floats:
    """For each carrier (k + 1, 3, 3), in its own frame, axes of which the last is that of its
    joint (k, 3); the world keeps its own.
    """
    found = np.repeat(np.eye(3)[None], len(axes) + 1, axis=0)
    for frame, axis in zip(found[1:], axes, strict=True):
        least = int(
            np.argmin(np.abs(axis))
        )  # of two that are alike, as the zeros of an axis along x, y or z, the first
        beside = np.eye(3)[least] - axis[least] * axis
        frame[:, 0] = beside / norm(beside)
        frame[:, 1], frame[:, 2] = np.cross(axis, frame[:, 0]), axis
    return found


def _origins(m: Mechanism, frames: Floats) -> Singles:
    """Of each joint the rotation, then the origin, on its parent (k, 12), in the frames of the
    carriers.
    """
    up = np.swapaxes(frames, 1, 2)[m.parents]
    rotations = matmul(up, m.origins[:, :3, :3], frames[1:])
    rotations[np.abs(rotations) < ZERO] = 0.0
    moved = np.einsum("kij,kj->ki", up, m.origins[:, :3, 3])
    found: Singles = np.hstack([rotations.reshape(-1, 9), moved]).astype(np.float32)
    return np.ascontiguousarray(found)


def _bounds(pieces: Pieces, frames: Floats) -> Singles:
    """The bounds of pieces (n, 18) in the frames of the carriers."""
    found, into = pieces.bounds.copy(), np.swapaxes(frames, 1, 2)[pieces.carrier]
    for at in (layout.CENTRE, layout.AXES, layout.AXES + 3, layout.AXES + 6):
        found[:, at : at + 3] = np.einsum("nij,nj->ni", into, found[:, at : at + 3])
    narrow: Singles = np.ascontiguousarray(found.astype(np.float32))
    return narrow


def _slack(m: Mechanism, pieces: Pieces) -> Singles:
    """How far rounding may move each piece (n,), rounded up; m."""
    lengths, joints = np.zeros(m.count + 1), np.ones(m.count + 1)
    for j in range(m.count):
        travel = m.travels[j] if m.sliding[j] else 0.0
        lengths[j + 1] = lengths[m.parents[j]] + norm(m.origins[j, :3, 3]) + travel
        joints[j + 1] = joints[m.parents[j]] + 1.0
    own = np.linalg.norm(pieces.bounds[:, :3], axis=1) + pieces.bounds[:, layout.BALL]
    slack = ROUNDING * joints[pieces.carrier] * (lengths[pieces.carrier] + own)
    up: Singles = np.nextafter(slack.astype(np.float32), np.float32(np.inf))
    return up


class Lanes:
    """Room for sixteen configurations of a narrow scene, and what is told of them.

    They lie on a line, which `along` gives, at the places `where` (16,), from 0 to 1. Proofs give
    `reach` (k, n), how far each piece gets from the axis of each joint; they set `away` (k,) and
    `whole` (n,), the motions of joints and pieces on half the line, and `share` (16,), how much of
    that a lane moves to both sides. After `sift`, `doubt` (g,) has the lanes, one bit each, that
    each group of pairs leaves in doubt, `doubted` those of all groups, and `hit` those that surely
    touch.
    """

    def __init__(self, narrow: Narrow, reach: Floats | None = None) -> None:
        count = narrow.mechanism.count
        self.narrow, self.groups, self.small = narrow, len(narrow.pairs.groups), False
        self.start, self.way, self.where = np.zeros(count), np.zeros(count), np.zeros(16)
        self.most, self.doubt = narrow.most, np.zeros(self.groups, np.uint32)
        self.hit, self.doubted, self.proving = 0, 0, reach is not None
        self.middle, self.axes = narrow.middle.copy(), narrow.axes.copy()
        self.poses, self.placed = narrow.poses.copy(), narrow.placed.copy()
        if reach is not None:
            self.reach, self.away = reach, np.zeros(count)
            self.whole, self.share = (
                np.zeros(narrow.pieces.count, np.float32),
                np.zeros(16, np.float32),
            )
        if cython.compiled:
            _bind(self, narrow)

    def along(self, first: Floats, i: int, second: Floats, j: int) -> None:
        """Take the line from row `i` to row `j` of configurations (n, k)."""
        self.small = True
        for x in range(self.start.shape[0]):
            self.start[x], self.way[x] = first[i, x], second[j, x] - first[i, x]
            if not (abs(first[i, x]) <= self.most[x] and abs(second[j, x]) <= self.most[x]):
                self.small = False

    def sift(self, first: int, lanes: int, margin: float, every: bool) -> int:
        """A group with a pair that surely comes within `margin` (m) in one of the `lanes`, one bit
        each; -1 if there is none.

        Group `first` is looked at first. With `every` all groups are looked at, but lanes that
        touch no more; else the first lane that touches ends it.
        """
        if cython.compiled and self.small:
            return int(_sifted(self, first, lanes, margin, every))
        self.hit, self.doubted = 0, lanes
        for g in range(self.groups):
            self.doubt[g] = lanes
        return -1


# Vectors of eight, where the processor has them; what NumPy is told not to use is not used here,
# either.
WIDE = cython.compiled and "AVX2" not in os.environ.get("NPY_DISABLE_CPU_FEATURES", "")

if cython.compiled:
    WIDE = WIDE and lanes_wide()  # type: ignore[name-defined]  # noqa: F821

    def _sifted(room: Any, first: int, lanes: int, margin: float, every: bool) -> int:
        hit, doubted = cython.address(room.hit), cython.address(room.doubted)
        return lanes_sift(cython.address(room.scene), first, lanes, margin, every, hit, doubted)  # type: ignore[name-defined, no-any-return]  # noqa: F821

    def _bind(room: Any, narrow: Narrow) -> None:
        """Tell `lanes.h` where the arrays are."""
        m, p, q = narrow.mechanism, narrow.pieces, narrow.pairs
        room.scene.wide = WIDE
        room.scene.joints, room.scene.pieces, room.scene.groups = m.count, p.count, room.groups
        room.scene.parent, room.scene.slides = (
            cython.address(m.parent[0]),
            cython.address(m.slides[0]),
        )
        room.scene.origins, room.scene.own = (
            cython.address(narrow.origins[0, 0]),
            cython.address(narrow.bounds[0, 0]),
        )
        room.scene.carrier, room.scene.slack = (
            cython.address(p._carrier[0]),
            cython.address(narrow.slack[0]),
        )
        if room.proving:
            room.scene.reach, room.scene.away = (
                cython.address(room.reach[0, 0]),
                cython.address(room.away[0]),
            )
            room.scene.whole, room.scene.share = (
                cython.address(room.whole[0]),
                cython.address(room.share[0]),
            )
        room.scene.rows, room.scene.pairs = (
            cython.address(q._groups[0, 0]),
            cython.address(q._pairs[0, 0]),
        )
        room.scene.after, room.scene.poses = (
            cython.address(q._after[0]),
            cython.address(room.poses[0, 0, 0]),
        )
        room.scene.middle, room.scene.axes = (
            cython.address(room.middle[0, 0, 0]),
            cython.address(room.axes[0, 0, 0]),
        )
        room.scene.placed, room.scene.turned = (
            cython.address(room.placed[0, 0]),
            cython.address(room.placed[1, 0]),
        )
        room.scene.start, room.scene.way = (
            cython.address(room.start[0]),
            cython.address(room.way[0]),
        )
        room.scene.where, room.scene.doubt = (
            cython.address(room.where[0]),
            cython.address(room.doubt[0]),
        )
