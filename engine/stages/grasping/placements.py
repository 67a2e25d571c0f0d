"""The ways in which a part lies stably on a table: the facets of its convex hull that its centre of mass is above."""

import numpy as np

from cellwright.engine.kernels.rigid import transform
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.grasping import Placement
from cellwright.engine.model.solid import Solid

SAME = 1e-6
STEADY_M = 0.002


def volume_and_centre(solid: Solid) -> tuple[float, Floats]:
    """The volume in cubic metres and the centre of mass (3,) of a closed surface filled evenly."""
    a, b, c = np.moveaxis(solid.corners, 1, 0)
    volumes = np.einsum("mi,mi->m", a, np.cross(b, c)) / 6
    total = float(volumes.sum())
    middle: Floats = (volumes[:, None] * (a + b + c) / 4).sum(axis=0) / total
    return total, middle


def placements(solid: Solid, centre: Floats, steady_m: float = STEADY_M) -> list[Placement]:
    """All placements that a push by `steady_m` does not tip, the steadiest first."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(np.unique(np.round(solid.vertices, 12), axis=0))
    found: list[Placement] = []
    normals: list[Floats] = []
    for n, equation in enumerate(hull.equations):
        normal = equation[:3]
        if any(normal @ each > 1 - SAME for each in normals):
            continue
        normals.append(normal)
        same = (hull.equations[:, :3] @ normal > 1 - SAME) & (
            np.abs(hull.equations[:, 3] - equation[3]) < SAME
        )
        corners = hull.points[np.unique(hull.simplices[same])]
        margin = _margin(corners, normal, centre)
        if margin > steady_m:
            found.append(Placement(_name(solid, normal, n), _lying(solid, normal, centre), margin))
    return sorted(found, key=lambda each: -each.margin_m)


def _margin(corners: Floats, normal: Floats, centre: Floats) -> float:
    """How far inside the hull of a facet's corners (n, 3) the centre of mass projects; negative outside."""
    from scipy.spatial import ConvexHull

    R = _down(normal)
    flat = (corners @ R.T)[:, :2]
    outline = ConvexHull(flat)
    at = (R @ centre)[:2]
    return float(-(outline.equations[:, :2] @ at + outline.equations[:, 2]).max())


def _down(normal: Floats) -> Floats:
    """A rotation (3, 3) that turns a unit normal straight down."""
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(-normal, across), -normal])


def _lying(solid: Solid, normal: Floats, centre: Floats) -> Floats:
    R = _down(normal)
    low = float((solid.vertices @ R.T)[:, 2].min())
    x, y, _ = R @ centre
    return transform(R, np.array([-x, -y, -low]))


def _name(solid: Solid, normal: Floats, number: int) -> str:
    """The name of the facet that lies on the table; that of the hull where the part has none there."""
    named = [each for each in solid.facets if each.normal @ normal > 1 - SAME]
    deepest = max(named, key=lambda each: each.offset, default=None)
    top = float((solid.vertices @ normal).max())
    return deepest.name if deepest is not None and abs(deepest.offset - top) < 1e-6 else f"hull_{number + 1}"
