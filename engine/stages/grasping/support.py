"""What carries a part: where its faces lie on those of others, and how far its centre of mass is inside that."""

from collections.abc import Sequence

import numpy as np

from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.solid import Facet, Solid
from cellwright.engine.stages.grasping.grasps import within
from cellwright.engine.stages.grasping.placements import volume_and_centre

FLAT = np.cos(np.radians(4))  # a face that deviates less from the horizontal carries, or is carried
TOUCH_M = 0.003  # faces nearer than this touch
STEP_M = 0.004  # between the points of a face that are looked at
UNCARRIED = -1.0


def carried_by(solid: Solid, T_world_part: Floats, others: Sequence[tuple[Solid, Floats]]) -> float:
    """How far inside its support a part's centre of mass is, in metres; negative if it tips, -1 if nothing carries it.

    Others have their poses T_world_other. Only faces that are nearly horizontal carry.
    """
    points = [
        points[_held_up(points, other, T)]
        for facet in solid.facets
        if T_world_part[2, :3] @ facet.normal < -FLAT
        for points in [apply(T_world_part, _spread(facet))]
        for other, T in others
    ]
    touching = np.concatenate([np.zeros((0, 3)), *points])[:, :2]
    centre = apply(T_world_part, volume_and_centre(solid)[1][None])[0, :2]
    return _inside(touching, centre)


def _spread(facet: Facet) -> Floats:
    """Points (n, 3) of a facet on a grid, and just inside its corners."""
    corners = facet.edges[:, 0]
    across = corners[1] - corners[0]
    across = across / np.linalg.norm(across)
    axes = np.stack([across, np.cross(facet.normal, across)])
    flat = corners @ axes.T
    low, high = flat.min(axis=0) + 1e-4, flat.max(axis=0) - 1e-4
    counts = np.maximum(np.ceil((high - low) / STEP_M).astype(int) + 1, 2)
    grid = np.stack(
        np.meshgrid(*(np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True))), -1
    )
    points = grid.reshape(-1, 2) @ axes + facet.normal * facet.offset
    found: Floats = points[within(facet, points)]
    return found


def _held_up(points: Floats, other: Solid, T: Floats) -> Floats:
    """Which points (n, 3) of the world lie on a face of another body that looks up (n,)."""
    found = np.zeros(len(points), dtype=bool)
    local = (points - T[:3, 3]) @ T[:3, :3]
    for facet in other.facets:
        if T[2, :3] @ facet.normal > FLAT:
            height = local @ facet.normal - facet.offset
            near = np.abs(height) < TOUCH_M
            found[near] |= within(facet, local[near] - height[near, None] * facet.normal)
    return found


def _inside(touching: Floats, centre: Floats) -> float:
    """How far a point (2,) is inside the hull of others (n, 2)."""
    from scipy.spatial import ConvexHull

    spread = touching - touching.mean(axis=0) if len(touching) else touching
    if len(touching) < 3 or np.linalg.matrix_rank(spread, tol=STEP_M) < 2:
        return UNCARRIED
    hull = ConvexHull(touching)
    return float(-(hull.equations[:, :2] @ centre + hull.equations[:, 2]).max())
