"""The rim of a plane surface in a range image, to a fraction of a pixel.

What comes back is the sum of what both surfaces return (see `ranging`). The surface is known as a
plane, and what lies beyond the rim from the pixels there; so the share of the beam on the surface
follows, and with it how far the beam's middle is from the rim.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.special import ndtri

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.model.shape_fits import Cloud
from cellwright.engine.model.vision import PixelWindow, RangeImage
from cellwright.engine.stages.vision.sensor_images import FULL_TURN_RAD, Waves, beam_px

SHARE_BOUNDS = (0.1, 0.9)  # of the beam: outside of these, noise decides
MAX_SHARE_SIGMA = 0.05  # standard deviation of a share
SURFACE_SHARE = 0.75  # as much of a beam meets the surface where the pixel counts as on it
SMOOTH_PX = 1.5
STRANGE, LEANING = (
    6.0,
    0.03,
)  # deviations of the signal, and part of both signals' difference, that a mixture may be off
MIN_BEAM_SIGMA_PX = (
    0.1  # the least standard deviation of a beam across which a rim can be told from its signal
)


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceRim:
    """Points of a rim in the frame of the eye, with their deviations, and how they follow from
    pixels and directions in the picture.

    `pixels` (n, 2), as (u, v), are where beams point, `inside_px` (n,) how far each is from the rim
    on the surface's side, `sigma_px` (n,) the standard deviation of that, `outward` (n, 2) the
    directions away from the surface. `beam_m` and `pointing_m` are the standard deviations of the
    beam's intensity and of its direction, on the plane.
    """

    cloud: Cloud
    pixels: Floats
    inside_px: Floats
    sigma_px: Floats
    outward: Floats
    beam_m: float
    pointing_m: float


def find_rim(
    image: RangeImage, normal: Floats, offset_m: float, window: PixelWindow
) -> SurfaceRim | None:
    """The rim of a plane normal . x = offset in a window, where it ends before something
    farther or nothing; None without one.
    """
    if beam_px(image.tool) < MIN_BEAM_SIGMA_PX:
        return None
    wave = _image_waves(image)
    nearer = _surface_waves(image, normal, offset_m)
    if nearer is None:
        return None
    first = _nearer_share(wave, nearer, np.zeros_like(wave))
    alike = np.abs(wave - nearer) < (1.0 - SURFACE_SHARE) * np.abs(nearer)
    outward = _outward_directions(np.where(alike, 1.0, np.minimum(np.clip(first, 0.0, 1.0), 0.5)))
    beyond = _waves_beyond(wave, outward)
    share = _nearer_share(wave, nearer, beyond)
    apart = np.abs(nearer - beyond)
    signal = 2.0 * FULL_TURN_RAD / image.tool.wavelength_m * image.tool.noise_m
    sure = signal / np.where(apart > 0, apart, np.inf)
    usable = (
        (share > SHARE_BOUNDS[0])
        & (share < SHARE_BOUNDS[1])
        & (apart > 0)
        & (sure < MAX_SHARE_SIGMA)
        & (wave != 0)
    )
    # What else a beam meets than these two, or what lies beyond without an answer, tells no share.
    usable &= np.abs(wave - beyond - share * (nearer - beyond)) < STRANGE * signal + LEANING * apart
    usable &= np.isfinite(outward).all(axis=-1) & _within_window(window, usable)
    usable &= ndimage.binary_dilation(alike, np.ones((3, 3)))
    v, u = np.nonzero(usable)
    if not len(u):
        return None
    spread, inside = beam_px(image.tool), ndtri(share[usable])
    noise_px = spread * sure[usable] * math.sqrt(FULL_TURN_RAD) * np.exp(inside**2 / 2.0)
    sigma_px = np.hypot(_pointing_px(image), noise_px)
    pixels = np.stack([u, v], axis=1).astype(float)
    return _rim_points(image, normal, offset_m, pixels, outward[usable], spread * inside, sigma_px)


def _image_waves(image: RangeImage) -> Waves:
    waves: Waves = image.strength * np.exp(
        2j * FULL_TURN_RAD / image.tool.wavelength_m * image.range_m
    )
    return waves


def _surface_waves(image: RangeImage, normal: Floats, offset_m: float) -> Waves | None:
    """What would come back (h, w) if the whole beam met the plane; None where the image shows
    none of it.
    """
    slope = image.beams @ normal
    metres = np.where(
        np.abs(slope) > 1e-6, offset_m / np.where(np.abs(slope) > 1e-6, slope, 1.0), 0.0
    )
    ahead = metres > 0
    strength = np.where(
        ahead, np.abs(slope) * (image.tool.at_m / np.where(ahead, metres, 1.0)) ** 2, 0.0
    )
    near = ahead & (image.range_m > 0) & (np.abs(image.range_m - metres) < 5.0 * image.tool.noise_m)
    if near.sum() < 3:
        return None
    shine = float(np.median(image.strength[near] / strength[near]))
    return np.asarray(
        shine * strength * np.exp(2j * FULL_TURN_RAD / image.tool.wavelength_m * metres),
        dtype=np.complex128,
    )


def _nearer_share(wave: Waves, nearer: Waves, beyond: Waves) -> Floats:
    """The share (h, w) of each beam that meets the nearer surface: least squares over both
    parts of the amplitude.
    """
    apart = nearer - beyond
    square = np.abs(apart) ** 2
    shares: Floats = ((wave - beyond) * np.conj(apart)).real / np.where(square > 0, square, np.inf)
    return shares


def _outward_directions(share: Floats) -> Floats:
    """The unit vectors (h, w, 2) in the picture, as (u, v), away from the surface; NaN where
    there is no direction.
    """
    down, right = (
        ndimage.gaussian_filter(share, SMOOTH_PX, order=order, mode="nearest")
        for order in ((1, 0), (0, 1))
    )
    length = np.hypot(right, down)
    directions: Floats = (
        -np.stack([right, down], axis=-1) / np.where(length > 1e-3, length, np.nan)[..., None]
    )
    return directions


def _waves_beyond(wave: Waves, outward: Floats) -> Waves:
    """What comes back some pixels farther out (h, w)."""
    height, width = wave.shape
    v, u = np.mgrid[:height, :width].astype(float)
    step = 3.0
    away = np.nan_to_num(outward)
    at_u = np.clip(np.rint(u + step * away[..., 0]).astype(int), 0, width - 1)
    at_v = np.clip(np.rint(v + step * away[..., 1]).astype(int), 0, height - 1)
    waves_outside: Waves = wave[at_v, at_u]
    return waves_outside


def _within_window(window: PixelWindow, like: Truths) -> Truths:
    mask = np.zeros_like(like)
    mask[window.rows, window.columns] = True
    return mask


def rim_as_circle(
    image: RangeImage, normal: Floats, offset_m: float, rim: SurfaceRim, centre: Floats
) -> SurfaceRim:
    """The same rim if it is a circle about a centre (3,) in the plane: then this tells the
    directions, not the noisy pixels around.
    """
    (ahead, back), (below, above) = (
        [
            np.linalg.norm(
                _on_plane(image, normal, offset_m, rim.pixels + side * step) - centre, axis=1
            )
            for side in (0.5, -0.5)
        ]
        for step in np.eye(2)
    )
    slope = np.stack([ahead - back, below - above], axis=1)
    slope = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    outward = slope * np.sign((slope * rim.outward).sum(axis=1).sum())
    return _rim_points(image, normal, offset_m, rim.pixels, outward, rim.inside_px, rim.sigma_px)


def _rim_points(
    image: RangeImage,
    normal: Floats,
    offset_m: float,
    pixels: Floats,
    outward: Floats,
    inside_px: Floats,
    sigma_px: Floats,
) -> SurfaceRim:
    """The rim that pixels (n, 2), as (u, v), see so far away in directions of the picture."""
    places = pixels + inside_px[:, None] * outward
    points, ahead = (
        _on_plane(image, normal, offset_m, places),
        _on_plane(image, normal, offset_m, places + outward),
    )
    pitch = np.linalg.norm(ahead - points, axis=1)
    usual = float(np.median(pitch))
    wide_m, beside_m = beam_px(image.tool) * usual, _pointing_px(image) * usual
    return SurfaceRim(
        Cloud(points, sigma_px * pitch), pixels, inside_px, sigma_px, outward, wide_m, beside_m
    )


def _pointing_px(image: RangeImage) -> float:
    return image.tool.pointing_rad * image.camera.focal_px


def _on_plane(image: RangeImage, normal: Floats, offset_m: float, at: Floats) -> Floats:
    """The points (n, 3) of a plane that pixels (n, 2), as (u, v), see."""
    rays = image.camera.rays(at[:, 0], at[:, 1])
    plane_points: Floats = rays * (offset_m / (rays @ normal))[:, None]
    return plane_points
