"""How a part lies stably, what carries it, and the shortest sequence of regrasps between holds."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.rigid import apply, transform
from cellwright.engine.model.geometry import Facet, Solid
from cellwright.engine.model.manipulation_values import (
    RegraspAnswer,
    Regrasps,
    TablePlacement,
    Unplaceable,
)
from cellwright.engine.stages.grasping.grasp_synthesis import within_facet

SAME_NORMAL = 1e-6
MIN_STEADY_M = 0.002


def volume_and_centre(solid: Solid) -> tuple[float, Floats]:
    """The volume in cubic metres and the centre of mass (3,) of a closed surface filled evenly."""
    a, b, c = np.moveaxis(solid.corners, 1, 0)
    volumes = np.einsum("mi,mi->m", a, np.cross(b, c)) / 6
    total = float(volumes.sum())
    middle: Floats = (volumes[:, None] * (a + b + c) / 4).sum(axis=0) / total
    return total, middle


def stable_placements(
    solid: Solid, centre: Floats, steady_m: float = MIN_STEADY_M
) -> list[TablePlacement]:
    """All placements that a push by `steady_m` does not tip, the steadiest first."""
    hull = ConvexHull(np.unique(np.round(solid.vertices, 12), axis=0))
    placements_found: list[TablePlacement] = []
    normals: list[Floats] = []
    for n, equation in enumerate(hull.equations):
        normal = equation[:3]
        if any(normal @ taken > 1 - SAME_NORMAL for taken in normals):
            continue
        normals.append(normal)
        same = (hull.equations[:, :3] @ normal > 1 - SAME_NORMAL) & (
            np.abs(hull.equations[:, 3] - equation[3]) < SAME_NORMAL
        )
        corners = hull.points[np.unique(hull.simplices[same])]
        margin = _support_margin(corners, normal, centre)
        if margin > steady_m:
            placements_found.append(
                TablePlacement(
                    _placement_name(solid, normal, n), _placed_pose(solid, normal, centre), margin
                )
            )
    return sorted(placements_found, key=lambda placement: -placement.margin_m)


def _support_margin(corners: Floats, normal: Floats, centre: Floats) -> float:
    """How far inside the hull of a facet's corners (n, 3) the centre of mass projects; negative
    outside.
    """
    R = _rotation_down(normal)
    flat = (corners @ R.T)[:, :2]
    outline = ConvexHull(flat)
    at = (R @ centre)[:2]
    return float(-(outline.equations[:, :2] @ at + outline.equations[:, 2]).max())


def _rotation_down(normal: Floats) -> Floats:
    """A rotation (3, 3) that turns a unit normal straight down."""
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(-normal, across), -normal])


def _placed_pose(solid: Solid, normal: Floats, centre: Floats) -> Floats:
    R = _rotation_down(normal)
    low = float((solid.vertices @ R.T)[:, 2].min())
    x, y, _ = R @ centre
    return transform(R, np.array([-x, -y, -low]))


def _placement_name(solid: Solid, normal: Floats, number: int) -> str:
    """The name of the facet that lies on the table; that of the hull where the part has none
    there.
    """
    named = [facet for facet in solid.facets if facet.normal @ normal > 1 - SAME_NORMAL]
    deepest = max(named, key=lambda facet: facet.offset, default=None)
    top = float((solid.vertices @ normal).max())
    return (
        deepest.name
        if deepest is not None and abs(deepest.offset - top) < 1e-6
        else f"hull_{number + 1}"
    )


# a face that deviates less from the horizontal carries, or is carried
FLAT_COSINE = np.cos(np.radians(4))
MAX_TOUCH_GAP_M = 0.003  # faces nearer than this touch
SUPPORT_STEP_M = 0.004  # between the points of a face that are looked at
UNCARRIED_MARGIN = -1.0


def support_margin(
    solid: Solid, T_world_part: Floats, supports: Sequence[tuple[Solid, Floats]]
) -> float:
    """How far inside its support a part's centre of mass is, in metres; negative if it tips, -1 if
    nothing carries it.

    Others have their poses T_world_other. Only faces that are nearly horizontal carry.
    """
    points = [
        points[_supported_points(points, support, T)]
        for facet in solid.facets
        if T_world_part[2, :3] @ facet.normal < -FLAT_COSINE
        for points in [apply(T_world_part, _facet_points(facet))]
        for support, T in supports
    ]
    touching = np.concatenate([np.zeros((0, 3)), *points])[:, :2]
    centre = apply(T_world_part, volume_and_centre(solid)[1][None])[0, :2]
    return _inside_margin(touching, centre)


def _facet_points(facet: Facet) -> Floats:
    """Points (n, 3) of a facet on a grid, and just inside its corners."""
    corners = facet.edges[:, 0]
    across = corners[1] - corners[0]
    across = across / np.linalg.norm(across)
    axes = np.stack([across, np.cross(facet.normal, across)])
    flat = corners @ axes.T
    low, high = flat.min(axis=0) + 1e-4, flat.max(axis=0) - 1e-4
    counts = np.maximum(np.ceil((high - low) / SUPPORT_STEP_M).astype(int) + 1, 2)
    grid = np.stack(
        np.meshgrid(*(np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True))), -1
    )
    points = grid.reshape(-1, 2) @ axes + facet.normal * facet.offset
    inner_points: Floats = points[within_facet(facet, points)]
    return inner_points


def _supported_points(points: Floats, support: Solid, T: Floats) -> Floats:
    """Which points (n, 3) of the world lie on a face of another body that looks up (n,)."""
    carried = np.zeros(len(points), dtype=bool)
    local = (points - T[:3, 3]) @ T[:3, :3]
    for facet in support.facets:
        if T[2, :3] @ facet.normal > FLAT_COSINE:
            height = local @ facet.normal - facet.offset
            near = np.abs(height) < MAX_TOUCH_GAP_M
            carried[near] |= within_facet(facet, local[near] - height[near, None] * facet.normal)
    return carried


def _inside_margin(touching: Floats, centre: Floats) -> float:
    """How far a point (2,) is inside the hull of others (n, 2)."""
    spread = touching - touching.mean(axis=0) if len(touching) else touching
    if len(touching) < 3 or np.linalg.matrix_rank(spread, tol=SUPPORT_STEP_M) < 2:
        return UNCARRIED_MARGIN
    hull = ConvexHull(touching)
    return float(-(hull.equations[:, :2] @ centre + hull.equations[:, 2]).max())


def shortest_regrasps(
    start: Truths, goal: Truths, possible: Truths, most: int = 16, fewest: int = 0
) -> RegraspAnswer:
    """The shortest way from a hold that is possible at the start (h,) to one that is possible at
    the goal (h,).

    `possible` (h, r) says which holds go with which rests. At least `fewest` and no more than
    `most` regrasps are looked for; a hold that can be had with fewer does not count as reached by
    more.
    """
    came: list[tuple[Truths, Truths]] = []
    reached, new = start.copy(), start.copy()
    rested = np.zeros(possible.shape[1], dtype=bool)
    while len(came) < fewest or not (new & goal).any():
        rests = possible[new].any(axis=0) & ~rested
        holds = possible[:, rests].any(axis=1) & ~reached
        came.append((new, rests))
        if not holds.any() or len(came) > most:
            return Unplaceable(_true_numbers(reached), _true_numbers(goal))
        rested |= rests
        reached |= holds
        new = holds
    return _follow_back(came, int(np.argmax(new & goal)), possible)


def _true_numbers(mask: Truths) -> tuple[int, ...]:
    return tuple(int(n) for n in np.nonzero(mask)[0])


def _follow_back(came: list[tuple[Truths, Truths]], last: int, possible: Truths) -> Regrasps:
    """The sequence that ends in a hold, followed back through what was new in each round."""
    then: list[tuple[int, int]] = []
    for holds, rests in reversed(came):
        rest = int(np.argmax(rests & possible[last] & possible[holds].any(axis=0)))
        then.append((rest, last))
        last = int(np.argmax(holds & possible[:, rest]))
    return Regrasps(last, tuple(reversed(then)))
