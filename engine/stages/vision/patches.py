"""Patches of a range image as measured points, each with the uncertainty that the image itself tells.

A range is uncertain by the noise of its signal, and, where the surface leans, by where the beam pointed. Pixels beside
an edge see two surfaces; they are left out.
"""

import math

import numpy as np
from scipy import ndimage

from engine.model.fits import Cloud
from engine.model.geometry import Floats, Truths
from engine.model.ranging import EdgeKind, Edges, RangeImage, Window
from engine.stages.vision.ranging import beam_px
from engine.stages.vision.slopes import inverse_depths, planes_beside

BESIDE_PX = 1  # of a roof or a crease
FLATTEST = 0.1  # cosine: of a surface seen flatter, the lean is not known well
SLOPES = 3  # pixels on either side that tell how a surface leans


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
    inverse, _ = inverse_depths(image)
    planes = planes_beside(inverse, (-SLOPES, SLOPES), (-SLOPES, SLOPES))
    facing = np.abs((planes.normals(image.camera) * image.beams).sum(axis=-1))
    cosine = np.clip(np.where(np.isfinite(facing), facing, 1.0), FLATTEST, 1.0)
    lean = image.tool.pointing_rad * image.range_m * np.sqrt(1.0 - cosine**2) / cosine
    found: Floats = np.hypot(image.noise_m, lean)
    return found


def cloud_of(image: RangeImage, edges: Edges, window: Window) -> Cloud:
    """The points of a patch in the frame of the eye, with their deviations along the beams."""
    used = np.zeros(image.range_m.shape, dtype=bool)
    used[window.rows, window.columns] = guarded(image, edges)[window.rows, window.columns]
    beam_m = image.tool.beam_rad / 4.0 * image.range_m[used]
    return Cloud(image.points[used], sigma_of(image)[used], image.beams[used], beam_m)
