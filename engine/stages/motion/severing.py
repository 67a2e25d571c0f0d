"""Proofs that there is no path, where one is cheap: what one joint or two move cannot pass something.

Only pairs of bodies are looked at whose distance no other joint changes: the first links with what stands around, and links
with each other. All else is left out, which can only open ways. The values of the one or two joints are cut into cells. A cell
is blocked when something overlaps in its middle by more than anything moves from there to its corners: then it overlaps in the
whole cell. If the other cells do not join the start with a goal, nothing does. Other walls are not found.
"""

import numpy as np

from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.model.motion import Query, Severed
from cellwright.engine.ports import MotionGround

CELLS = (2048, 192)  # along each joint: of one joint, of two
ROUNDING = 1e-9  # m


def severed(ground: MotionGround, query: Query) -> Severed | None:
    """A proof that no goal can be reached, or None, which says nothing."""
    changing = ground.changing(query.moving or range(ground.scene.joints.count))
    for count, cells in enumerate(CELLS, 1):
        for joints in sorted({tuple(sorted(each)) for each in changing if len(each) == count}):
            rows = [n for n, each in enumerate(changing) if each and each <= set(joints)]
            found = _parted(ground.only(rows), query, joints, cells) if _limited(ground, joints) else None
            if found is not None:
                return found
    return None


def _limited(ground: MotionGround, joints: tuple[int, ...]) -> bool:
    """Whether joints have limits on both sides: else there might be a way around beyond the grid."""
    limits = ground.scene.joints
    return bool(np.isfinite([limits.lower[list(joints)], limits.upper[list(joints)]]).all())


def _parted(near: MotionGround, query: Query, joints: tuple[int, ...], cells: int) -> Severed | None:
    """The proof on a grid over these joints, if there is one."""
    from scipy.ndimage import binary_dilation, label

    chosen, limits = list(joints), near.scene.joints
    low, high = limits.lower[chosen], limits.upper[chosen]
    middles = _middles(query.start, chosen, low, high, cells)
    shut = _shut(near, middles, chosen, (high - low) / (2 * cells), query.margin_m)
    around = np.ones((3,) * len(joints))  # cells that share a corner are neighbours
    regions, _ = label(~shut.reshape((cells,) * len(joints)), around)
    ends = np.vstack([query.start[None], query.goals])[:, chosen]
    at = np.clip((ends - low) / (high - low) * cells, 0, cells - 1).astype(np.int64)
    marks = regions[tuple(at.T)]
    if marks[0] == 0 or (marks[1:] == 0).any() or (marks[1:] == marks[0]).any():
        return None
    wall = binary_dilation(regions == marks[0], around) & (regions == 0)
    worst = _nearest(middles, np.nonzero(wall.ravel())[0], chosen, query.goals)
    contacts = tuple(sorted(near.contacts(worst, query.margin_m), key=lambda each: each.distance_m))
    return Severed(joints, len(middles), worst, contacts)


def _middles(start: Floats, joints: list[int], low: Floats, high: Floats, cells: int) -> Floats:
    """The middle of every cell (n, k); the joints that the grid is not about stay at the start."""
    share = (np.arange(cells) + 0.5) / cells
    values = np.stack(np.meshgrid(*[share] * len(joints), indexing="ij"), axis=-1).reshape(-1, len(joints))
    found = np.repeat(start[None], len(values), axis=0)
    found[:, joints] = low + values * (high - low)
    return found


def _shut(near: MotionGround, middles: Floats, joints: list[int], half: Floats, margin_m: float) -> Truths:
    """Which cells (n,) are blocked as a whole."""
    corner = middles[0].copy()
    corner[joints] += half
    moves = near.travel(middles[0], corner)
    shut: Truths = near.clearance(middles, margin_m) <= margin_m - moves - ROUNDING
    return shut


def _nearest(middles: Floats, rows: Longs, joints: list[int], goals: Floats) -> Floats:
    """Of the middles (n, k) in some rows, the one (k,) that is nearest to a goal."""
    away = np.linalg.norm(middles[rows][:, None, joints] - goals[None][:, :, joints], axis=2).min(axis=1)
    found: Floats = middles[rows[int(np.argmin(away))]]
    return found
