"""Patches of a range image: as measured points with uncertainty, and where one is best placed.

A range is uncertain by the noise of its signal, and, where the surface leans, by where the beam
pointed. Pixels beside an edge see two surfaces; they are left out.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.shape_fits import Cloud
from cellwright.engine.model.vision import (
    EdgeImage,
    EdgeKind,
    PixelWindow,
    RangeImage,
    beams_of,
    picture_of,
)
from cellwright.engine.stages.vision.range_edges import incidence_cosines
from cellwright.engine.stages.vision.sensor_images import beam_px, exact_ranges
from cellwright.kb.model.cell_model import Ranging

BESIDE_EDGE_PX = 1  # of a roof or a crease
AROUND_PX = 2  # pixels on either side whose strength counts


def guard_pixels(image: RangeImage, edges: EdgeImage) -> Truths:
    """The pixels (h, w) with an answer whose beams met one surface only, as far as is known."""
    wide = math.ceil(4.0 * beam_px(image.tool)) + 1
    step = ndimage.binary_dilation(edges.on(EdgeKind.STEP), np.ones((2 * wide + 1,) * 2))
    turn = edges.on(EdgeKind.ROOF) | edges.on(EdgeKind.CREASE)
    guarded_entry: Truths = (
        (image.range_m > 0)
        & ~step
        & ~ndimage.binary_dilation(turn, np.ones((2 * BESIDE_EDGE_PX + 1,) * 2))
    )
    return guarded_entry


def range_sigmas(image: RangeImage) -> Floats:
    """The standard deviation (h, w) of each range along its beam in metres; infinite without an
    answer.
    """
    cosine = incidence_cosines(image)
    lean = image.tool.pointing_rad * image.range_m * np.sqrt(1.0 - cosine**2) / cosine
    sigmas: Floats = np.hypot(image.noise_m, lean)
    return sigmas


def cloud_of(image: RangeImage, edges: EdgeImage, window: PixelWindow) -> Cloud:
    """The points of a patch in the frame of the eye, with their deviations along the beams.

    What follows from where a beam points is left to the fit, which knows how the surface leans.
    """
    used = np.zeros(image.range_m.shape, dtype=bool)
    used[window.rows, window.columns] = guard_pixels(image, edges)[window.rows, window.columns]
    metres = image.range_m[used]
    beam_m, pointing_m = image.tool.beam_rad / 4.0 * metres, image.tool.pointing_rad * metres
    noise_m = np.hypot(image.tool.noise_m / _usual_strength(image, used)[used], image.rounding_m)
    return Cloud(image.points[used], noise_m, image.beams[used], beam_m, pointing_m, metres)


def _usual_strength(image: RangeImage, used: Truths) -> Floats:
    """The mean strength (h, w) of the used pixels around each.

    A beam that points beside its direction errs in range and in strength together; a weight from
    its own strength would bias the fit.
    """
    size = 2 * AROUND_PX + 1
    total = ndimage.uniform_filter(np.where(used, image.strength, 0.0), size, mode="constant")
    count = ndimage.uniform_filter(used.astype(float), size, mode="constant")
    usual: Floats = total / np.where(used, count, 1.0)
    return usual


# off the plane of the measured point: what is expected so near belongs to its surface
SAME_M = 2e-4
# how far the part may lie from where it is expected: a patch keeps off edges by this much
MISPLACED_M = 0.002


@dataclass(frozen=True, slots=True)
class PlacedPatch:
    """A patch in the picture, and the standard deviation in metres to be expected of the
    surface's distance at the point.
    """

    window: PixelWindow
    sigma_m: float


def place_patch(
    solids: list[tuple[Solid, Floats]],
    tool: Ranging,
    point: Floats,
    normal: Floats,
    sides_m: tuple[float, float],
    sizes: int = 5,
) -> PlacedPatch | None:
    """The square patch, with a side between two lengths, that leaves the least uncertainty of a
    surface at a point (3,) with a normal.

    All is in the frame of the eye; solids stand at T_eye_solid. None if no patch fits on the
    surface that is seen there.
    """
    camera = picture_of(tool)
    if point[2] <= 0:
        return None
    metres, facing, _ = exact_ranges(solids, camera)
    pitch = float(np.linalg.norm(point)) / camera.focal_px
    off = (metres[..., None] * beams_of(camera) - point) @ normal
    free = (metres > 0) & (np.abs(off) < SAME_M)
    guard = math.ceil(4.0 * beam_px(tool) + MISPLACED_M / pitch) + 1
    free = ~ndimage.binary_dilation(~free, np.ones((3, 3)), iterations=guard)
    sums = _running_sums(metres, facing, tool, point, normal, free)
    u, v = (float(coordinate) for coordinate in camera.pixels(point))
    best: PlacedPatch | None = None
    for side_m in np.linspace(sides_m[1], sides_m[0], sizes):
        side = max(3, int(float(side_m) / pitch))
        candidate = _best_square(sums, free, side, (u, v), sides_m[1] / pitch)
        if candidate is not None and (best is None or candidate.sigma_m < best.sigma_m):
            best = candidate
    return best


def _running_sums(
    metres: Floats, facing: Floats, tool: Ranging, point: Floats, normal: Floats, free: Truths
) -> Floats:
    """The running sums (6, h + 1, w + 1) of what pixels tell of a plane: 1, x, y, xx, xy, yy by
    their variances.
    """
    camera = picture_of(tool)
    across = np.eye(3)[int(np.argmin(np.abs(normal)))]
    x_axis = np.cross(across, normal)
    x_axis = x_axis / np.linalg.norm(x_axis)
    from_point = metres[..., None] * beams_of(camera) - point
    x, y = from_point @ x_axis, from_point @ np.cross(normal, x_axis)
    cosine = np.where(free, facing, 1.0)
    strength = np.where(free, facing * (tool.at_m / np.where(free, metres, 1.0)) ** 2, 1.0)
    along = np.hypot(
        tool.noise_m / strength, tool.pointing_rad * metres * np.sqrt(1 - cosine**2) / cosine
    )
    weight = np.where(free, 1.0 / np.maximum(along * cosine, 1e-12) ** 2, 0.0)
    rows = np.stack([weight * value for value in (np.ones_like(x), x, y, x * x, x * y, y * y)])
    return np.pad(rows.cumsum(axis=1).cumsum(axis=2), ((0, 0), (1, 0), (1, 0)))


def _best_square(
    sums: Floats, free: Truths, side: int, at: tuple[float, float], reach_px: float
) -> PlacedPatch | None:
    """The best of all squares of a side whose pixels are all free and not farther than
    `reach_px` from a place (u, v).
    """
    height, width = free.shape
    if side >= min(height, width):
        return None

    def windowed(running: Floats) -> Floats:
        window_sums: Floats = (
            running[..., side:, side:]
            - running[..., :-side, side:]
            - running[..., side:, :-side]
            + running[..., :-side, :-side]
        )
        return window_sums

    count = windowed(np.pad(free.astype(float).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0))))
    top, left = np.mgrid[: count.shape[0], : count.shape[1]]
    far = np.hypot(left + (side - 1) / 2 - at[0], top + (side - 1) / 2 - at[1])
    allowed = (count > side * side - 0.5) & (far <= reach_px)
    if not allowed.any():
        return None
    w, x, y, xx, xy, yy = windowed(sums)[:, allowed]
    matrix = np.stack(
        [np.stack([w, x, y], -1), np.stack([x, xx, xy], -1), np.stack([y, xy, yy], -1)], -2
    )
    variance = np.linalg.inv(matrix)[:, 0, 0]
    # Equal but for rounding: the one nearest to the point.
    order = np.lexsort((far[allowed], np.round(np.log(variance), 6)))
    row, column = np.argwhere(allowed)[order[0]].tolist()
    return PlacedPatch(
        PixelWindow(column, row, column + side, row + side), math.sqrt(float(variance[order[0]]))
    )
