"""Where a patch is best placed in a range image: where the distance of the surface at the measured point will be known best."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.ranging import Window, beams_of, picture_of
from cellwright.engine.model.solid import Solid
from cellwright.engine.stages.vision.ranging import beam_px, seen
from cellwright.kb.model.ranging import Ranging

SAME_M = 2e-4  # off the plane of the measured point: what is expected so near belongs to its surface
MISPLACED_M = (
    0.002  # how far the part may lie from where it is expected: a patch keeps off edges by this much
)


@dataclass(frozen=True, slots=True)
class PlacedPatch:
    """A patch in the picture, and the standard deviation in metres to be expected of the surface's distance at the point."""

    window: Window
    sigma_m: float


def placed(
    solids: list[tuple[Solid, Floats]],
    tool: Ranging,
    point: Floats,
    normal: Floats,
    sides_m: tuple[float, float],
    sizes: int = 5,
) -> PlacedPatch | None:
    """The square patch, with a side between two lengths, that leaves the least uncertainty of a surface at a point (3,) with a normal.

    All is in the frame of the eye; solids stand at T_eye_solid. None if no patch fits on the surface that is seen there.
    """
    camera = picture_of(tool)
    if point[2] <= 0:
        return None
    metres, facing, _ = seen(solids, camera)
    pitch = float(np.linalg.norm(point)) / camera.focal_px
    off = (metres[..., None] * beams_of(camera) - point) @ normal
    free = (metres > 0) & (np.abs(off) < SAME_M)
    guard = math.ceil(4.0 * beam_px(tool) + MISPLACED_M / pitch) + 1
    free = ~ndimage.binary_dilation(~free, np.ones((3, 3)), iterations=guard)
    sums = _sums(metres, facing, tool, point, normal, free)
    u, v = (float(each) for each in camera.pixels(point))
    best: PlacedPatch | None = None
    for side_m in np.linspace(sides_m[1], sides_m[0], sizes):
        side = max(3, int(float(side_m) / pitch))
        found = _best(sums, free, side, (u, v), sides_m[1] / pitch)
        if found is not None and (best is None or found.sigma_m < best.sigma_m):
            best = found
    return best


def _sums(
    metres: Floats, facing: Floats, tool: Ranging, point: Floats, normal: Floats, free: Truths
) -> Floats:
    """The running sums (6, h + 1, w + 1) of what pixels tell of a plane: 1, x, y, xx, xy, yy by their variances."""
    camera = picture_of(tool)
    across = np.eye(3)[int(np.argmin(np.abs(normal)))]
    x_axis = np.cross(across, normal)
    x_axis = x_axis / np.linalg.norm(x_axis)
    from_point = metres[..., None] * beams_of(camera) - point
    x, y = from_point @ x_axis, from_point @ np.cross(normal, x_axis)
    cosine = np.where(free, facing, 1.0)
    strength = np.where(free, facing * (tool.at_m / np.where(free, metres, 1.0)) ** 2, 1.0)
    along = np.hypot(tool.noise_m / strength, tool.pointing_rad * metres * np.sqrt(1 - cosine**2) / cosine)
    weight = np.where(free, 1.0 / np.maximum(along * cosine, 1e-12) ** 2, 0.0)
    rows = np.stack([weight * each for each in (np.ones_like(x), x, y, x * x, x * y, y * y)])
    return np.pad(rows.cumsum(axis=1).cumsum(axis=2), ((0, 0), (1, 0), (1, 0)))


def _best(
    sums: Floats, free: Truths, side: int, at: tuple[float, float], reach_px: float
) -> PlacedPatch | None:
    """The best of all squares of a side whose pixels are all free and not farther than `reach_px` from a place (u, v)."""
    height, width = free.shape
    if side >= min(height, width):
        return None

    def windowed(each: Floats) -> Floats:
        found: Floats = (
            each[..., side:, side:]
            - each[..., :-side, side:]
            - each[..., side:, :-side]
            + each[..., :-side, :-side]
        )
        return found

    count = windowed(np.pad(free.astype(float).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0))))
    top, left = np.mgrid[: count.shape[0], : count.shape[1]]
    far = np.hypot(left + (side - 1) / 2 - at[0], top + (side - 1) / 2 - at[1])
    allowed = (count > side * side - 0.5) & (far <= reach_px)
    if not allowed.any():
        return None
    w, x, y, xx, xy, yy = windowed(sums)[:, allowed]
    matrix = np.stack([np.stack([w, x, y], -1), np.stack([x, xx, xy], -1), np.stack([y, xy, yy], -1)], -2)
    variance = np.linalg.inv(matrix)[:, 0, 0]
    # Equal but for rounding: the one nearest to the point.
    order = np.lexsort((far[allowed], np.round(np.log(variance), 6)))
    row, column = np.argwhere(allowed)[order[0]].tolist()
    return PlacedPatch(Window(column, row, column + side, row + side), math.sqrt(float(variance[order[0]])))
