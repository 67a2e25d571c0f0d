"""Planes through small windows of a range image, at every pixel at once.

On a plane the inverse depth is linear in the picture, whichever way the plane leans. Least squares over a window beside a pixel
tell the inverse depth and its slopes at the pixel itself, and how sure they are.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.ranging import RangeImage
from cellwright.engine.model.vision import Camera

LEAST = 5  # answers in a window: fewer tell no plane
FLATTEST = 0.1  # cosine: of a surface seen flatter, the lean is not known well
SLOPES = 3  # pixels on either side that tell how a surface leans
ACROSS, ALONG = 0, 1  # axes of the picture: rows follow each other down, columns to the right


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """Inverse depth and its slopes to the right and down (h, w, 3), their covariance (h, w, 3, 3) for a noise of 1, and where known."""

    value: Floats
    covariance: Floats
    known: Truths

    def normals(self, camera: Camera) -> Floats:
        """The normals (h, w, 3) of the planes towards the eye; NaN where there is none."""
        v, u = np.mgrid[: camera.height, : camera.width].astype(float)
        w, right, down = np.moveaxis(self.value, -1, 0)
        (cx, cy), f = camera.centre_px, camera.focal_px
        normal = np.stack([right * f, down * f, w - right * (u - cx) - down * (v - cy)], axis=-1)
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        found: Floats = np.where(self.known[..., None], -normal / np.where(length > 0, length, 1.0), np.nan)
        return found


def inverse_depths(image: RangeImage) -> tuple[Floats, Floats]:
    """The inverse depth (h, w) of each pixel, 0 without an answer, and the noise (h, w) of it."""
    known = image.range_m > 0
    axial = image.beams[..., 2]
    inverse = np.where(known, 1.0 / np.where(known, image.range_m * axial, 1.0), 0.0)
    noise = np.where(known, image.noise_m, 0.0) * axial * inverse**2
    return inverse, noise


def cosines(image: RangeImage) -> Floats:
    """The cosine (h, w) of the incidence of each beam, by the pixels around; 1 where that is not known."""
    inverse, _ = inverse_depths(image)
    planes = planes_beside(inverse, (-SLOPES, SLOPES), (-SLOPES, SLOPES))
    cosine = np.abs((planes.normals(image.camera) * image.beams).sum(axis=-1))
    found: Floats = np.clip(np.where(np.isfinite(cosine), cosine, 1.0), FLATTEST, 1.0)
    return found


def planes_beside(inverse: Floats, right: tuple[int, int], down: tuple[int, int]) -> Planes:
    """The planes through the pixels that are right[0] to right[1] columns to the right of each, and down[0] to down[1] rows down."""
    known = (inverse > 0).astype(float)
    powers = [(p, q) for p in range(3) for q in range(3 - p)]
    sums = {key: _summed(known, right, down, *key) for key in powers}
    values = [_summed(inverse, right, down, *key) for key in ((0, 0), (1, 0), (0, 1))]
    basis = ((0, 0), (1, 0), (0, 1))
    normal = np.stack([np.stack([sums[a + c, b + d] for c, d in basis], axis=-1) for a, b in basis], axis=-2)
    scale = np.array([1.0, *(max(1.0, max(map(abs, each))) for each in (right, down))])
    scaled = normal / np.outer(scale, scale)
    enough = (sums[0, 0] >= LEAST) & (np.linalg.det(scaled) > 1e-3)
    scaled = np.where(enough[..., None, None], scaled, np.eye(3))
    covariance = np.linalg.inv(scaled) / np.outer(scale, scale)
    value = (covariance @ np.stack(values, axis=-1)[..., None])[..., 0]
    return Planes(value, covariance, enough & (value[..., 0] > 0))


def _summed(each: Floats, right: tuple[int, int], down: tuple[int, int], p: int, q: int) -> Floats:
    """The sums (h, w), over a window beside each pixel, of values times powers of the steps to the right and down."""
    found = each
    for (first, last), power, axis in ((right, p, ALONG), (down, q, ACROSS)):
        reach = max(abs(first), abs(last))
        steps = np.arange(-reach, reach + 1)
        weights = np.where((steps >= first) & (steps <= last), steps.astype(float) ** power, 0.0)
        found = ndimage.correlate1d(found, weights, axis=axis, mode="constant")
    return found
