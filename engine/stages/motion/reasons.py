"""Why there is no path: what forbids the start or the goals, or what stands between the trees."""

import numpy as np

from cellwright.engine.kernels.linear import norm
from cellwright.engine.kernels.motion.connect import Trees
from cellwright.engine.model.geometry import Contact, Floats
from cellwright.engine.model.motion import Blocked, InCollision, OutsideLimits, Query, Reason
from cellwright.engine.ports import MotionGround

TOLERANCE = 1e-9  # rad or m beyond a limit that rounding explains
LOOKS = 64  # places between the ends of the trees


def refusals(
    ground: MotionGround, start: Floats, goals: Floats, margin_m: float
) -> tuple[tuple[Reason, ...], tuple[int, ...]]:
    """What forbids the start (k,) and the goals (n, k), and the numbers of the goals that can be planned for.

    None can if the start is forbidden.
    """
    of_start = _of(ground, start, "start", margin_m)
    of_goals = [_of(ground, goal, f"goal {n + 1}", margin_m) for n, goal in enumerate(goals)]
    allowed = () if of_start else tuple(n for n, reasons in enumerate(of_goals) if not reasons)
    return (*of_start, *(reason for reasons in of_goals for reason in reasons)), allowed


def _of(ground: MotionGround, q: Floats, name: str, margin_m: float) -> tuple[Reason, ...]:
    joints = ground.scene.joints
    outside = np.nonzero((q < joints.lower - TOLERANCE) | (q > joints.upper + TOLERANCE))[0]
    found: list[Reason] = [
        OutsideLimits(name, int(j), float(q[j]), float(joints.lower[j]), float(joints.upper[j]))
        for j in outside
    ]
    if ground.clearance(q[None], margin_m + 1e-9)[0] <= margin_m:
        found.append(InCollision(name, ground.contacts(q, margin_m)))
    return tuple(found)


def blocked(ground: MotionGround, trees: Trees, looked: int, query: Query) -> Blocked:
    """Where the trees came nearest, and what is worst in between."""
    one, other = trees.grown()
    ends, apart = _nearest(one, other)
    at, contacts = _between(ground, ends, query)
    return Blocked(ends, apart, looked, (len(one), len(other)), at, contacts)


def failed(ground: MotionGround, ends: Floats, why: str, looked: int, query: Query) -> Blocked:
    """That a strategy without trees found no way between two configurations (2, k), and why."""
    at, contacts = _between(ground, ends, query)
    return Blocked(ends, norm(ends[1] - ends[0]), looked, (1, 1), at, contacts, why)


def _between(ground: MotionGround, ends: Floats, query: Query) -> tuple[Floats, tuple[Contact, ...]]:
    """The worst configuration (k,) on the straight line between two (2, k), and what touches there."""
    between = ends[0] + np.linspace(0.0, 1.0, LOOKS)[:, None] * (ends[1] - ends[0])
    at = between[int(np.argmin(ground.clearance(between, query.margin_m + 1.0)))]
    return at, ground.contacts(at, query.margin_m)


def _nearest(one: Floats, other: Floats) -> tuple[Floats, float]:
    """The nearest configurations (2, k) of two sets, and how far they are apart."""
    from scipy.spatial import cKDTree

    away, rows = cKDTree(other).query(one)
    n = int(np.argmin(away))
    return np.array([one[n], other[rows[n]]]), float(away[n])
