# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Collision checks of straight lines between configurations: samples from coarse to fine, until one
touches.

Sixteen configurations, spread over the whole line, are looked at side by side. What touched last is
looked at first, because the next line is near the last one.
"""

import math
from collections.abc import Callable

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Bytes, Floats, refuse_unless
from cellwright.engine.kernels.geometry import checks, mechanism, room
from cellwright.engine.kernels.geometry.lanes import Lanes, Narrow
from cellwright.engine.kernels.geometry.room import Room

LANES = 16  # configurations side by side
Ask = Callable[[Floats, Floats], bool]


class Edges:
    """The straight lines between the configurations of one scene.

    A line is looked at every `step`, measured in the space of the joints (rad, m). What comes
    within `margin` (m) of another thing touches it. `looked` counts the configurations looked at.
    With `ask`, that function says whether a line is free, in place of the scene: so any checker can
    take part. Raises `ValueError` for a step or margin that cannot be.
    """

    def __init__(
        self, scene: Narrow, step: float, margin: float = 0.0, ask: Ask | None = None
    ) -> None:
        if not (step > 0.0 and margin >= 0.0 and math.isfinite(step) and math.isfinite(margin)):
            raise ValueError(
                f"the step must be above 0, the margin 0 or more, not {step} and {margin}"
            )
        self.mechanism, self.pairs, self.count = scene.mechanism, scene.pairs, scene.mechanism.count
        self.step, self.margin, self.ask, self.foreign = step, margin, ask, ask is not None
        self.poses = np.empty((1, self.count + 1, 3, 4))
        self.room, self.lanes = Room(scene.pieces, np.asarray(self.poses)), Lanes(scene)
        self.at = np.zeros(self.count)
        self.looked, self.latest = 0, 0

    def free(self, first: Floats, i: int, second: Floats, j: int) -> int:
        """Whether nothing touches on the way from row `i` to row `j` of configurations (n, k),
        its start left out.
        """
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
    """Whether something touches on the way.

    Each block of sixteen places is spread over the whole line.
    """
    away = length(first, i, second, j, e.count)
    steps = max(1, cython.cast(cython.longlong, math.ceil(away / e.step)))
    blocks, stride = (steps + LANES - 1) // LANES, 1
    e.lanes.along(first, i, second, j)
    while stride < blocks:
        stride *= 2
    if _block_touches(e, steps, blocks, 0):
        return True
    while stride > 1:
        b = stride // 2
        while b < blocks:
            if _block_touches(e, steps, blocks, b):
                return True
            b += stride
        stride //= 2
    return False


def _block_touches(e: Edges, steps: int, blocks: int, b: int) -> bool:
    """Whether something touches at the places b + 1, b + 1 + blocks, and so on, of those after
    each step.
    """
    lanes, share = 0, 1.0
    share /= steps
    for n in range(LANES):
        s = min(b + 1 + n * blocks, steps)
        e.lanes.where[n] = 1.0 if s == steps else s * share
        if b + n * blocks < steps:
            e.looked += 1
            lanes |= 1 << n
    g = e.lanes.sift(e.latest, lanes, e.margin, False)
    if g >= 0:
        e.latest = g
        return True
    n = 0
    while n < LANES and not (e.lanes.doubted & (1 << n) and _touches_in(e, n)):
        n += 1
    return n < LANES


def _touches_in(e: Edges, n: int) -> bool:
    """Whether the groups that lane `n` leaves in doubt touch in its configuration."""
    for x in range(e.count):
        e.at[x] = e.lanes.start[x] + e.lanes.where[n] * e.lanes.way[x]
    mechanism.place_carriers(e.mechanism, e.at, 0, e.poses)
    room.forget(e.room)
    for g in range(e.lanes.groups):
        if (
            e.lanes.doubt[g] & (1 << n)
            and checks.first_of_group(e.room, e.pairs, g, 0, e.margin) >= 0
        ):
            e.latest = g
            return True
    return False


def free_edges(e: Edges, first: Floats, second: Floats, out: Bytes) -> None:
    """Whether nothing touches on the way from each configuration (n, k) to its second (n, k),
    both ends included (n,).
    """
    refuse_unless("first configurations", first, np.float64, (len(out), e.count))
    refuse_unless("second configurations", second, np.float64, (len(out), e.count))
    a, b, found = first, second, out
    with cython.nogil:
        for n in range(found.shape[0]):
            free = e.free(a, n, a, n)
            found[n] = e.free(a, n, b, n) if free else 0
