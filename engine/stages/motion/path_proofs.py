"""Proofs about paths: that one is free, what touches by intention, and whether two arms may
meet.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.geometry.edges import free_edges
from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.kernels.geometry.proof import proved as proved_lines
from cellwright.engine.model.geometry import Contact
from cellwright.engine.model.motion_values import FINEST_M, Blocked, Moved, PathQuery
from cellwright.engine.ports import MotionScene
from cellwright.engine.stages.motion.no_path import blocked_without_trees

MAX_PROOF_ROUNDS = 6  # plans, the last of which looks 32 times as often as the first
WIDER_M = 0.001  # the margin that the second plan adds; each further one doubles it
GRAZES_BETWEEN = (
    "every path that was found touches something between two places that the search looked at"
)


def plan_until_proved(
    ground: MotionScene,
    query: PathQuery,
    search: Callable[[MotionScene, PathQuery], Moved | Blocked],
) -> Moved | Blocked:
    """The first path of a search that is proved.

    A path that grazes something between two looks is not. If there is no path with a wider margin,
    the same step is tried without. All plans share the budget. What is left unproved in the end
    touches nothing when looked at every `FINEST_M`; what does touch is no path.
    """
    asked, answer, looked = query, search(ground, query), 0
    unproved: Moved | None = None
    for round_ in range(MAX_PROOF_ROUNDS):
        looked += answer.looked
        if isinstance(answer, Moved):
            unproved = replace(
                prove_moved(ground, answer, query.margin_m), looked=looked, cleared_m=asked.margin_m
            )
            if unproved.proved:
                return unproved
            wider = query.margin_m + min(
                WIDER_M * 2**round_, 0.5 * spare_margin_at_ends(ground, query)
            )
            asked = replace(asked, step=asked.step / 2, margin_m=wider)
        elif asked.margin_m > query.margin_m:
            asked = replace(asked, margin_m=query.margin_m)
        else:
            break
        if looked >= query.budget or round_ == MAX_PROOF_ROUNDS - 1:
            break
        answer = search(ground, replace(asked, budget=query.budget - looked))
    return _unproved_answer(ground, query, unproved, answer, looked)


def _unproved_answer(
    ground: MotionScene,
    query: PathQuery,
    unproved: Moved | None,
    last: Moved | Blocked,
    looked: int,
) -> Moved | Blocked:
    """The last path that was found, unless it touches something; then that there is none."""
    if unproved is not None:
        touched = _first_touching(ground, unproved.path, query.margin_m)
        if touched is None:
            return unproved
        if isinstance(last, Moved):
            return blocked_without_trees(
                ground, unproved.path[touched : touched + 2], GRAZES_BETWEEN, looked, query
            )
    assert isinstance(last, Blocked)
    return replace(last, looked=looked)


def prove_moved(ground: MotionScene, moved: Moved, margin_m: float) -> Moved:
    """A path with what a proof says of it: whether it keeps more than the margin everywhere,
    and the work that it took.
    """
    proof = ground.proof(margin_m, FINEST_M)
    proved = proved_lines(proof, moved.path) == len(moved.path) - 1
    return replace(moved, proved=proved, stretches=proof.looked, refined=proof.refined)


def unproved_lines(ground: MotionScene, path: Floats, margin_m: float, finest_m: float) -> Truths:
    """Which lines (m - 1,) of a path (m, k) are not proved to keep more than a margin
    everywhere.
    """
    is_unproved, n = np.zeros(len(path) - 1, dtype=bool), 0
    while n < len(is_unproved):
        n += proved_lines(ground.proof(margin_m, finest_m), np.ascontiguousarray(path[n:]))
        is_unproved[n : n + 1] = True
        n += 1
    return is_unproved


def _first_touching(ground: MotionScene, path: Floats, margin_m: float) -> int | None:
    """The first line of a path (m, k) on which something is within the margin, looked at every
    `FINEST_M` (rad, m).
    """
    free = np.zeros(len(path) - 1, dtype=np.uint8)
    lines = ground.lines(FINEST_M, margin_m)
    free_edges(lines, np.ascontiguousarray(path[:-1]), np.ascontiguousarray(path[1:]), free)
    return None if free.all() else int(np.argmin(free))


def spare_margin_at_ends(ground: MotionScene, query: PathQuery) -> float:
    """How much wider than asked the margin can be at start and goals."""
    ends = np.vstack([query.start[None], query.goals])
    return max(0.0, float(ground.clearance(ends, query.margin_m + 1.0).min()) - query.margin_m)


FINEST_SHARE = 1e-5  # the least share of a line that is looked at
LOOKS_PER_LINE = 4000  # configurations for one line
PROOF_CUTS = 8  # places of a line up to which a proof is tried

Pair = tuple[str, str]


@dataclass(frozen=True, slots=True)
class BodyTouch:
    """Two bodies that touch on a path: how deep at the most where it was looked at, and whether
    `allowed_m` is proved.
    """

    first: str
    second: str
    deepest_m: float
    allowed_m: float
    proved: bool


@dataclass(slots=True)
class _SeenTouches:
    """The greatest depth that was seen of each pair, and the pairs that are not proved."""

    allowed_m: float
    deepest: dict[Pair, float] = field(default_factory=dict)
    doubted: set[Pair] = field(default_factory=set)

    def note(self, near: Sequence[Contact], half_m: float) -> set[Pair]:
        """The pairs that may overlap too much within `half_m` of motion, without those that are
        known to.
        """
        over = set()
        for contact in near:
            pair = (min(contact.first, contact.second), max(contact.first, contact.second))
            self.deepest[pair] = max(self.deepest.get(pair, 0.0), contact.depth_m)
            if contact.depth_m > self.allowed_m:
                self.doubted.add(pair)
            elif half_m - contact.distance_m > self.allowed_m:
                over.add(pair)
        return over - self.doubted


def touches_on_path(ground: MotionScene, path: Floats, allowed_m: float) -> tuple[BodyTouch, ...]:
    """The pairs that touch on a path (m, k), and those that may for all that is known; each
    with its proof.
    """
    seen, finest_m = _SeenTouches(allowed_m), max(FINEST_M, allowed_m / 5)
    departure = _from_first_touch(ground, path, finest_m)[::-1]
    departure = _from_first_touch(ground, departure, finest_m)[::-1]
    seen.note(ground.contacts(departure[0]), 0.0)
    for first, second in pairwise(departure):
        _go_through(ground, first, second, seen)
        seen.note(ground.contacts(second), 0.0)
    return tuple(
        BodyTouch(*pair, depth, allowed_m, pair not in seen.doubted)
        for pair, depth in sorted(seen.deepest.items())
        if depth > 0.0 or pair in seen.doubted
    )


def lines_too_deep(ground: MotionScene, path: Floats, allowed_m: float, stray_m: float) -> Truths:
    """On which lines (m - 1,) of a path (m, k) some pair is not proved to overlap by no more than
    it may.

    Every point of the motion that is meant may be so far (`stray_m`) from where it is on the path.
    """
    meeting_m = 2.0 * stray_m  # both bodies may be off
    too_deep_lines = unproved_lines(ground, path, meeting_m, max(FINEST_M, allowed_m / 5))
    for n in np.nonzero(too_deep_lines)[0]:
        seen = _SeenTouches(allowed_m - meeting_m)
        seen.note(ground.contacts(path[n]), 0.0)
        _go_through(ground, path[n], path[n + 1], seen)
        too_deep_lines[n] = bool(seen.doubted)
    return too_deep_lines


def _from_first_touch(ground: MotionScene, path: Floats, finest_m: float) -> Floats:
    """The rest of a path (m, k) from where it is not proved any more that nothing touches: its
    end alone if all of it is.
    """
    path = np.ascontiguousarray(path)
    if ground.collides(path[:1])[0]:
        return path
    proof = ground.proof(0.0, finest_m)
    lines = proved(proof, path)
    if lines == len(path) - 1:
        return path[-1:]
    first, at = path[lines], path[lines + 1]
    for _ in range(PROOF_CUTS):
        at = first + proof.where * (at - first)
        if proof.where == 0.0 or proved(proof, np.stack([first, at])):
            return np.concatenate([at[None], path[lines + 1 :]])
    return path[lines:]


def _go_through(ground: MotionScene, first: Floats, second: Floats, seen: _SeenTouches) -> None:
    """Look at one line by stretches."""
    stretches, looks = [(0.0, 1.0)], 0
    moved_m = 2.0 * ground.travel(first, second)  # both may move
    while stretches:
        low, high = stretches.pop()
        middle, half_m = (low + high) / 2, moved_m * (high - low) / 2
        looks += 1
        over = seen.note(ground.contacts(first + middle * (second - first), half_m), half_m)
        if over and (high - low < FINEST_SHARE or looks > LOOKS_PER_LINE):
            seen.doubted |= over
        elif over:
            stretches += [(low, middle), (middle, high)]


# parts that are looked at for one pair of paths; beyond them nothing is proved
MAX_PATH_PARTS = 200_000
PARTS_AT_ONCE = 4_096  # of them in one look
FINEST_GAP_M = 10 * FINEST_M  # arms that are nearer than this count as meeting


@dataclass(frozen=True, slots=True, eq=False)
class ArmPath:
    """A path (m, all joints) of one arm among the joints of a ground; all other values are 0.

    A rest has one configuration.
    """

    path: Floats

    @property
    def lines(self) -> tuple[Floats, Floats]:
        """Where each line begins, and its way (n, all joints); a rest is one line without a way."""
        if len(self.path) == 1:
            return self.path, np.zeros_like(self.path)
        return self.path[:-1], np.diff(self.path, axis=0)


@dataclass(frozen=True, slots=True, eq=False)
class _PathParts:
    """Parts of rectangles: the lines of both paths (n, 2), and where on them the part begins,
    and how long it is (n, 2).
    """

    lines: Longs
    first: Floats
    share: Floats

    def only(self, rows: Floats | Longs) -> "_PathParts":
        return _PathParts(self.lines[rows], self.first[rows], self.share[rows])


def arms_may_meet(
    ground: MotionScene, first: ArmPath, second: ArmPath, margin_m: float = 0.0
) -> bool:
    """Whether it is not proved that two arms stay more than `margin_m` apart, wherever each is on
    its course.

    The ground has the pairs of bodies of the two arms, and no others.
    """
    (begin, direction), (start, ride) = first.lines, second.lines
    grid = np.stack(
        np.meshgrid(np.arange(len(begin)), np.arange(len(start)), indexing="ij"), axis=-1
    )
    lines = grid.reshape(-1, 2)
    waiting, looked = [_PathParts(lines, np.zeros((len(lines), 2)), np.ones((len(lines), 2)))], 0
    while waiting:
        parts = waiting.pop()
        if len(parts.lines) > PARTS_AT_ONCE:
            waiting.append(parts.only(np.arange(PARTS_AT_ONCE, len(parts.lines))))
            parts = parts.only(np.arange(PARTS_AT_ONCE))
        looked += len(parts.lines)
        middle = parts.first + parts.share / 2
        a, b = parts.lines.T
        where = begin[a] + middle[:, :1] * direction[a] + start[b] + middle[:, 1:] * ride[b]
        moves = np.stack(
            [
                ground.travels(direction[a] * parts.share[:, :1] / 2),
                ground.travels(ride[b] * parts.share[:, 1:] / 2),
            ],
            1,
        )
        needed = moves.sum(axis=1) + margin_m
        apart = ground.clearance(where, float(needed.max()) + FINEST_GAP_M)
        near = apart <= needed
        if (
            (apart[near] <= margin_m).any()
            or (needed[near] < margin_m + FINEST_GAP_M).any()
            or looked > MAX_PATH_PARTS
        ):
            return True
        if near.any():
            waiting.append(_halve_parts(parts.only(np.nonzero(near)[0]), moves[near]))
    return False


def _halve_parts(parts: _PathParts, moves: Floats) -> _PathParts:
    """Both halves of each part, cut across the path on which more moves (n, 2)."""
    rows = np.arange(len(parts.lines))
    side = np.argmax(moves, axis=1)
    share, second = parts.share.copy(), parts.first.copy()
    share[rows, side] /= 2
    second[rows, side] += share[rows, side]
    return _PathParts(
        np.concatenate([parts.lines, parts.lines]),
        np.concatenate([parts.first, second]),
        np.concatenate([share, share]),
    )
