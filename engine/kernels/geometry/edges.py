# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Straight lines between configurations, each checked whole: from coarse to fine, until a configuration touches.

What touched last is looked at first, because the next configuration is near the last one.
"""

import math
from collections.abc import Callable

import cython
import numpy as np

from engine.kernels.arrays import Bytes, Floats, Longs, Truths, refuse_unless
from engine.kernels.geometry import checks, forward, room
from engine.kernels.geometry.layout import Pairs, Pieces
from engine.kernels.geometry.room import Room

INFINITE = math.inf
Ask = Callable[[Floats, Floats], bool]


class Mechanism:
    """k joints: the parent carriers (k,), the origins there (k, 4, 4), the unit axes (k, 3), which of them slide (k,).

    Raises `ValueError` for arrays that do not fit together.
    """

    def __init__(self, parent: Longs, origin: Floats, axis: Floats, slides: Truths) -> None:
        self.count = len(parent)
        refuse_unless("parents", parent, np.int64, (self.count,))
        refuse_unless("origins", origin, np.float64, (self.count, 4, 4))
        refuse_unless("axes", axis, np.float64, (self.count, 3))
        refuse_unless("what slides", slides, np.bool_, (self.count,))
        if (parent < 0).any() or (parent > np.arange(self.count)).any():
            raise ValueError("a joint hangs on a carrier that does not come before it")
        self.parent, self.origin, self.axis, self.slides = parent, origin, axis, slides.view(np.uint8)


def place_carriers(m: Mechanism, at: Floats, n: int, poses: Floats) -> None:
    """Put all carriers where they are in configuration `at` (k,), in row `n` of poses (n, k + 1, 3, 4)."""
    forward.stand(poses, n)
    for j in range(m.count):
        forward.place_joint(m.origin, m.axis, m.slides[j], m.parent[j], j, at[j], n, poses)


class Edges:
    """The straight lines between the configurations of one scene.

    A line is looked at every `step`, measured in the space of the joints (rad, m). What comes within `margin` (m) of another
    thing touches it. `looked` counts the configurations looked at. With `ask`, that function says whether a line is free, in
    place of the scene: so any checker can take part. Raises `ValueError` for what does not fit together.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        pieces: Pieces,
        pairs: Pairs,
        step: float,
        margin: float = 0.0,
        ask: Ask | None = None,
    ) -> None:
        if not (step > 0.0 and margin >= 0.0 and math.isfinite(step) and math.isfinite(margin)):
            raise ValueError(f"the step must be above 0, the margin 0 or more, not {step} and {margin}")
        if pairs.numbers > pieces.count or pieces.carriers > mechanism.count + 1:
            raise ValueError(f"pairs or carriers beyond {pieces.count} pieces and {mechanism.count} joints")
        self.mechanism, self.pairs, self.count = mechanism, pairs, mechanism.count
        self.step, self.margin, self.ask, self.foreign = step, margin, ask, ask is not None
        poses = np.empty((1, mechanism.count + 1, 3, 4))
        self.poses, self.room = poses, Room(pieces, poses)
        self.at = np.zeros(mechanism.count)
        self.looked, self.latest = 0, 0

    def free(self, first: Floats, i: int, second: Floats, j: int) -> int:
        """Whether nothing touches on the way from row `i` to row `j` of configurations (n, k), its start left out."""
        if self.foreign:
            return _asked(self, first, i, second, j)
        return 0 if _swept(self, first, i, second, j) else 1


def length(first: Floats, i: int, second: Floats, j: int, count: int) -> float:
    """How far two configurations of `count` joints are apart."""
    total = 0.0
    for x in range(count):
        away = second[j, x] - first[i, x]
        total += away * away
    return math.sqrt(total)


def _asked(e: Edges, first: Floats, i: int, second: Floats, j: int) -> int:
    """What `ask` says; a line counts as many configurations as it has steps."""
    one, other = np.array(first[i]), np.array(second[j])
    e.looked += 1 + int(float(np.linalg.norm(other - one)) / e.step)
    return int(e.ask(one, other))  # type: ignore[misc]


def _swept(e: Edges, first: Floats, i: int, second: Floats, j: int) -> bool:
    """Whether something touches on the way. The end comes first, then the middle, then the quarters, and so on."""
    away = length(first, i, second, j, e.count)
    steps = cython.cast(cython.longlong, math.ceil(away / e.step))
    if _touches_at(e, first, i, second, j, 1.0):
        return True
    stride, share = 1, 1.0
    share /= max(1, steps)
    while stride < steps:
        stride *= 2
    while stride > 1:
        s = stride // 2
        while s < steps:
            if _touches_at(e, first, i, second, j, s * share):
                return True
            s += stride
        stride //= 2
    return False


def _touches_at(e: Edges, first: Floats, i: int, second: Floats, j: int, t: float) -> bool:
    for x in range(e.count):
        e.at[x] = first[i, x] + t * (second[j, x] - first[i, x])
    return touches(e)


def touches(e: Edges) -> bool:
    """Whether something touches in configuration `at`."""
    e.looked += 1
    place_carriers(e.mechanism, e.at, 0, e.poses)
    room.forget(e.room)
    latest = e.latest
    if latest < e.pairs._groups.shape[0] and checks.first_of_group(e.room, e.pairs, latest, 0, e.margin) >= 0:
        return True
    for g in range(e.pairs._groups.shape[0]):
        if checks.first_of_group(e.room, e.pairs, g, 0, e.margin) >= 0:
            e.latest = g
            return True
    return False


def free_edges(e: Edges, first: Floats, second: Floats, out: Bytes) -> None:
    """Whether nothing touches on the way from each configuration (n, k) to its second (n, k), both ends included (n,)."""
    refuse_unless("first configurations", first, np.float64, (len(out), e.count))
    refuse_unless("second configurations", second, np.float64, (len(out), e.count))
    a, b, found = first, second, out
    with cython.nogil:
        for n in range(found.shape[0]):
            free = e.free(a, n, a, n)
            found[n] = e.free(a, n, b, n) if free else 0
