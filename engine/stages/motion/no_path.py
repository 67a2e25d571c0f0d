"""Why there is no path: forbidden ends, what stands between the trees, and cheap proofs."""

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.linear import norm
from cellwright.engine.kernels.motion.connect import Trees
from cellwright.engine.model.geometry import Contact
from cellwright.engine.model.motion_values import (
    Blocked,
    InCollision,
    OutsideLimits,
    PathQuery,
    Reason,
    Severed,
)
from cellwright.engine.ports import MotionScene

LIMIT_TOLERANCE = 1e-9  # rad or m beyond a limit that rounding explains
PLACES_BETWEEN = 64  # places between the ends of the trees


def forbidden_ends(
    ground: MotionScene, start: Floats, goals: Floats, margin_m: float
) -> tuple[tuple[Reason, ...], tuple[int, ...]]:
    """What forbids the start (k,) and the goals (n, k), and the numbers of the goals that can be
    planned for.

    None can if the start is forbidden.
    """
    of_start = _end_reasons(ground, start, "start", margin_m)
    of_goals = [
        _end_reasons(ground, goal, f"goal {n + 1}", margin_m) for n, goal in enumerate(goals)
    ]
    allowed = () if of_start else tuple(n for n, reasons in enumerate(of_goals) if not reasons)
    return (*of_start, *(reason for reasons in of_goals for reason in reasons)), allowed


def _end_reasons(ground: MotionScene, q: Floats, name: str, margin_m: float) -> tuple[Reason, ...]:
    joints = ground.scene.joints
    outside = np.nonzero(
        (q < joints.lower - LIMIT_TOLERANCE) | (q > joints.upper + LIMIT_TOLERANCE)
    )[0]
    reasons: list[Reason] = [
        OutsideLimits(name, int(j), float(q[j]), float(joints.lower[j]), float(joints.upper[j]))
        for j in outside
    ]
    if ground.clearance(q[None], margin_m + 1e-9)[0] <= margin_m:
        reasons.append(InCollision(name, ground.contacts(q, margin_m)))
    return tuple(reasons)


def blocked_between_trees(
    ground: MotionScene, trees: Trees, looked: int, query: PathQuery
) -> Blocked:
    """Where the trees came nearest, and what is worst in between."""
    first, second = trees.grown()
    ends, apart = _nearest_pair(first, second)
    at, contacts = _worst_between(ground, ends, query)
    return Blocked(ends, apart, looked, (len(first), len(second)), at, contacts)


def blocked_without_trees(
    ground: MotionScene, ends: Floats, why: str, looked: int, query: PathQuery
) -> Blocked:
    """That a strategy without trees found no way between two configurations (2, k), and why."""
    at, contacts = _worst_between(ground, ends, query)
    return Blocked(ends, norm(ends[1] - ends[0]), looked, (1, 1), at, contacts, why)


def _worst_between(
    ground: MotionScene, ends: Floats, query: PathQuery
) -> tuple[Floats, tuple[Contact, ...]]:
    """The worst configuration (k,) on the straight line between two (2, k), and what touches
    there.
    """
    between = ends[0] + np.linspace(0.0, 1.0, PLACES_BETWEEN)[:, None] * (ends[1] - ends[0])
    at = between[int(np.argmin(ground.clearance(between, query.margin_m + 1.0)))]
    return at, ground.contacts(at, query.margin_m)


def _nearest_pair(first: Floats, second: Floats) -> tuple[Floats, float]:
    """The nearest configurations (2, k) of two sets, and how far they are apart."""
    from scipy.spatial import cKDTree

    away, rows = cKDTree(second).query(first)
    n = int(np.argmin(away))
    return np.array([first[n], second[rows[n]]]), float(away[n])


GRID_CELLS = (2048, 192)  # along each joint: of one joint, of two
ROUNDING_M = 1e-9  # m


def prove_severed(ground: MotionScene, query: PathQuery) -> Severed | None:
    """A proof that no goal can be reached, or None, which says nothing."""
    changing = ground.changing(query.moving or range(ground.scene.joints.count))
    for count, cells in enumerate(GRID_CELLS, 1):
        for joints in sorted(
            {tuple(sorted(joint_set)) for joint_set in changing if len(joint_set) == count}
        ):
            rows = [
                n for n, joint_set in enumerate(changing) if joint_set and joint_set <= set(joints)
            ]
            proof = (
                _parting_proof(ground.only(rows), query, joints, cells)
                if _all_limited(ground, joints)
                else None
            )
            if proof is not None:
                return proof
    return None


def _all_limited(ground: MotionScene, joints: tuple[int, ...]) -> bool:
    """Whether joints have limits on both sides: else there might be a way around beyond the
    grid.
    """
    limits = ground.scene.joints
    return bool(np.isfinite([limits.lower[list(joints)], limits.upper[list(joints)]]).all())


def _parting_proof(
    near: MotionScene, query: PathQuery, joints: tuple[int, ...], cells: int
) -> Severed | None:
    """The proof on a grid over these joints, if there is one."""
    from scipy.ndimage import binary_dilation, label

    chosen, limits = list(joints), near.scene.joints
    low, high = limits.lower[chosen], limits.upper[chosen]
    middles = _cell_middles(query.start, chosen, low, high, cells)
    shut = _shut_cells(near, middles, chosen, (high - low) / (2 * cells), query.margin_m)
    around = np.ones((3,) * len(joints))  # cells that share a corner are neighbours
    regions, _ = label(~shut.reshape((cells,) * len(joints)), around)
    ends = np.vstack([query.start[None], query.goals])[:, chosen]
    at = np.clip((ends - low) / (high - low) * cells, 0, cells - 1).astype(np.int64)
    marks = regions[tuple(at.T)]
    if marks[0] == 0 or (marks[1:] == 0).any() or (marks[1:] == marks[0]).any():
        return None
    wall = binary_dilation(regions == marks[0], around) & (regions == 0)
    worst = _nearest_middle(middles, np.nonzero(wall.ravel())[0], chosen, query.goals)
    contacts = tuple(
        sorted(near.contacts(worst, query.margin_m), key=lambda contact: contact.distance_m)
    )
    return Severed(joints, len(middles), worst, contacts)


def _cell_middles(
    start: Floats, joints: list[int], low: Floats, high: Floats, cells: int
) -> Floats:
    """The middle of every cell (n, k); the joints that the grid is not about stay at the start."""
    share = (np.arange(cells) + 0.5) / cells
    values = np.stack(np.meshgrid(*[share] * len(joints), indexing="ij"), axis=-1).reshape(
        -1, len(joints)
    )
    middles = np.repeat(start[None], len(values), axis=0)
    middles[:, joints] = low + values * (high - low)
    return middles


def _shut_cells(
    near: MotionScene, middles: Floats, joints: list[int], half: Floats, margin_m: float
) -> Truths:
    """Which cells (n,) are blocked as a whole."""
    corner = middles[0].copy()
    corner[joints] += half
    moves = near.travel(middles[0], corner)
    shut: Truths = near.clearance(middles, margin_m) <= margin_m - moves - ROUNDING_M
    return shut


def _nearest_middle(middles: Floats, rows: Longs, joints: list[int], goals: Floats) -> Floats:
    """Of the middles (n, k) in some rows, the one (k,) that is nearest to a goal."""
    away = np.linalg.norm(middles[rows][:, None, joints] - goals[None][:, :, joints], axis=2).min(
        axis=1
    )
    nearest: Floats = middles[rows[int(np.argmin(away))]]
    return nearest
