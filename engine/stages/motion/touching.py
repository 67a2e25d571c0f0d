"""What touches by intention, proved pair by pair: on the whole of a path, no pair overlaps by more than it may.

The ground has the pairs that may touch, and no others. Up to the first touch and after the last, compiled kernels prove that
nothing touches at all. Between them, two bodies come nearer, on a stretch around a configuration, by no more than their fastest
points move; a stretch for which that leaves doubt is halved.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.model.geometry import Contact, Floats, Truths
from cellwright.engine.model.motion import FINEST_M
from cellwright.engine.ports import MotionGround
from cellwright.engine.stages.motion.proving import unproved

FINEST = 1e-5  # the least share of a line that is looked at
LOOKS = 4000  # configurations for one line
CUTS = 8  # places of a line up to which a proof is tried

Pair = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Touch:
    """Two bodies that touch on a path: how deep at the most where it was looked at, and whether `allowed_m` is proved."""

    first: str
    second: str
    deepest_m: float
    allowed_m: float
    proved: bool


@dataclass(slots=True)
class _Seen:
    """The greatest depth that was seen of each pair, and the pairs that are not proved."""

    allowed_m: float
    deepest: dict[Pair, float] = field(default_factory=dict)
    doubted: set[Pair] = field(default_factory=set)

    def note(self, near: Sequence[Contact], half_m: float) -> set[Pair]:
        """The pairs that may overlap too much within `half_m` of motion, without those that are known to."""
        over = set()
        for each in near:
            pair = (min(each.first, each.second), max(each.first, each.second))
            self.deepest[pair] = max(self.deepest.get(pair, 0.0), each.depth_m)
            if each.depth_m > self.allowed_m:
                self.doubted.add(pair)
            elif half_m - each.distance_m > self.allowed_m:
                over.add(pair)
        return over - self.doubted


def touches(ground: MotionGround, path: Floats, allowed_m: float) -> tuple[Touch, ...]:
    """The pairs that touch on a path (m, k), and those that may for all that is known; each with its proof."""
    seen, finest_m = _Seen(allowed_m), max(FINEST_M, allowed_m / 5)
    left = _from_first_touch(ground, path, finest_m)[::-1]
    left = _from_first_touch(ground, left, finest_m)[::-1]
    seen.note(ground.contacts(left[0]), 0.0)
    for first, second in pairwise(left):
        _go_through(ground, first, second, seen)
        seen.note(ground.contacts(second), 0.0)
    return tuple(
        Touch(*pair, depth, allowed_m, pair not in seen.doubted)
        for pair, depth in sorted(seen.deepest.items())
        if depth > 0.0 or pair in seen.doubted
    )


def too_deep(ground: MotionGround, path: Floats, allowed_m: float, stray_m: float) -> Truths:
    """On which lines (m - 1,) of a path (m, k) some pair is not proved to overlap by no more than it may.

    Every point of the motion that is meant may be so far (`stray_m`) from where it is on the path.
    """
    meeting_m = 2.0 * stray_m  # both bodies may be off
    found = unproved(ground, path, meeting_m, max(FINEST_M, allowed_m / 5))
    for n in np.nonzero(found)[0]:
        seen = _Seen(allowed_m - meeting_m)
        seen.note(ground.contacts(path[n]), 0.0)
        _go_through(ground, path[n], path[n + 1], seen)
        found[n] = bool(seen.doubted)
    return found


def _from_first_touch(ground: MotionGround, path: Floats, finest_m: float) -> Floats:
    """The rest of a path (m, k) from where it is not proved any more that nothing touches: its end alone if all of it is."""
    path = np.ascontiguousarray(path)
    if ground.collides(path[:1])[0]:
        return path
    proof = ground.proof(0.0, finest_m)
    lines = proved(proof, path)
    if lines == len(path) - 1:
        return path[-1:]
    first, at = path[lines], path[lines + 1]
    for _ in range(CUTS):
        at = first + proof.where * (at - first)
        if proof.where == 0.0 or proved(proof, np.stack([first, at])):
            return np.concatenate([at[None], path[lines + 1 :]])
    return path[lines:]


def _go_through(ground: MotionGround, first: Floats, second: Floats, seen: _Seen) -> None:
    """Look at one line by stretches."""
    stretches, looks = [(0.0, 1.0)], 0
    moved_m = 2.0 * ground.travel(first, second)  # both may move
    while stretches:
        low, high = stretches.pop()
        middle, half_m = (low + high) / 2, moved_m * (high - low) / 2
        looks += 1
        over = seen.note(ground.contacts(first + middle * (second - first), half_m), half_m)
        if over and (high - low < FINEST or looks > LOOKS):
            seen.doubted |= over
        elif over:
            stretches += [(low, middle), (middle, high)]
