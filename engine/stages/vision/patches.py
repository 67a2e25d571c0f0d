"""Patches of a range image as measured points, each with the uncertainty that the image itself tells.

A range is uncertain by the noise of its signal, and, where the surface leans, by where the beam pointed. Pixels beside
an edge see two surfaces; they are left out.
"""

import math

import numpy as np
from scipy import ndimage

from cellwright.engine.model.fits import Cloud
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.ranging import EdgeKind, Edges, RangeImage, Window
from cellwright.engine.stages.vision.ranging import beam_px
from cellwright.engine.stages.vision.slopes import cosines

BESIDE_PX = 1  # of a roof or a crease
AROUND = 2  # pixels on either side whose strength counts


def guarded(image: RangeImage, edges: Edges) -> Truths:
    """The pixels (h, w) with an answer whose beams met one surface only, as far as is known."""
    wide = math.ceil(4.0 * beam_px(image.tool)) + 1
    step = ndimage.binary_dilation(edges.on(EdgeKind.STEP), np.ones((2 * wide + 1,) * 2))
    turn = edges.on(EdgeKind.ROOF) | edges.on(EdgeKind.CREASE)
    found: Truths = (
        (image.range_m > 0) & ~step & ~ndimage.binary_dilation(turn, np.ones((2 * BESIDE_PX + 1,) * 2))
    )
    return found


def sigma_of(image: RangeImage) -> Floats:
    """The standard deviation (h, w) of each range along its beam in metres; infinite without an answer."""
    cosine = cosines(image)
    lean = image.tool.pointing_rad * image.range_m * np.sqrt(1.0 - cosine**2) / cosine
    found: Floats = np.hypot(image.noise_m, lean)
    return found


def cloud_of(image: RangeImage, edges: Edges, window: Window) -> Cloud:
    """The points of a patch in the frame of the eye, with their deviations along the beams.

    What follows from where a beam points is left to the fit, which knows how the surface leans.
    """
    used = np.zeros(image.range_m.shape, dtype=bool)
    used[window.rows, window.columns] = guarded(image, edges)[window.rows, window.columns]
    metres = image.range_m[used]
    beam_m, pointing_m = image.tool.beam_rad / 4.0 * metres, image.tool.pointing_rad * metres
    noise_m = np.hypot(image.tool.noise_m / _usual_strength(image, used)[used], image.rounding_m)
    return Cloud(image.points[used], noise_m, image.beams[used], beam_m, pointing_m, metres)


def _usual_strength(image: RangeImage, used: Truths) -> Floats:
    """The mean strength (h, w) of the used pixels around each.

    A beam that points beside its direction errs in range and in strength together; a weight from its own strength would bias the fit.
    """
    size = 2 * AROUND + 1
    total = ndimage.uniform_filter(np.where(used, image.strength, 0.0), size, mode="constant")
    count = ndimage.uniform_filter(used.astype(float), size, mode="constant")
    found: Floats = total / np.where(used, count, 1.0)
    return found
