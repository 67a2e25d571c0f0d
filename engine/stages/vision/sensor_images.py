"""Depth and range images of solids as a camera or a laser scanner takes them, noise included."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.vision import (
    DepthCamera,
    DepthImage,
    RangeImage,
    Resolving,
    Vague,
    beams_of,
    picture_of,
)
from cellwright.engine.stages.vision.kernels.rays import Range, draw
from cellwright.engine.stages.vision.range_edges import incidence_cosines
from cellwright.kb.model.cell_model import Ranging


@dataclass(frozen=True, slots=True)
class DepthSensor:
    """How a sensor errs: a normal error of `noise_m`, and a share of pixels without an answer.

    Beyond `grazing_rad` between the ray and the surface's normal there is no answer either. At a
    jump in depth, a share `mixed` of the pixels answers with a depth between the two sides.
    """

    noise_m: float = 0.001
    dropouts: float = 0.0
    grazing_rad: float = np.pi / 2
    mixed: float = 0.0


def render_depths(
    solids: Sequence[tuple[Solid, Floats]], camera: DepthCamera
) -> tuple[DepthImage, Longs]:
    """What a camera sees of solids at poses T_camera_solid (4, 4), without error.

    Returns the image, and for each pixel the number of the solid (height, width), -1 for none.
    """
    seen = Range((camera.height, camera.width), camera.focal_px, camera.centre_px)
    for number, (solid, T) in enumerate(solids):
        corners = np.ascontiguousarray(apply(T, solid.vertices).reshape(-1, 3, 3))
        draw(seen, corners, np.full(len(corners), number, dtype=np.int64))
    return DepthImage(camera, seen.depth, 0.0), seen.owner


def disturb_image(image: DepthImage, sensor: DepthSensor, seed: int) -> DepthImage:
    """The image as a sensor gives it; the same seed gives the same errors."""
    random = np.random.default_rng(seed)
    depth = image.depth.copy()
    depth = np.where(
        random.random(depth.shape) < sensor.mixed, _mix_neighbours(depth, random), depth
    )
    seen = depth > 0
    depth = np.where(seen, depth + random.normal(0.0, sensor.noise_m, depth.shape), 0.0)
    lost = (random.random(depth.shape) < sensor.dropouts) | _grazing_pixels(
        image, sensor.grazing_rad
    )
    return replace(image, depth=np.where(lost, 0.0, np.maximum(depth, 0.0)), noise_m=sensor.noise_m)


def _mix_neighbours(depth: Floats, random: np.random.Generator) -> Floats:
    """Depths between those of a pixel and of its neighbour to the right."""
    neighbours = np.roll(depth, -1, axis=1)
    share = random.random(depth.shape)
    mixed_depth: Floats = np.where(
        (depth > 0) & (neighbours > 0), depth + share * (neighbours - depth), depth
    )
    return mixed_depth


def _grazing_pixels(image: DepthImage, grazing_rad: float) -> Truths:
    """Where the surface is seen at a flatter angle than a sensor can measure (height, width)."""
    if grazing_rad >= np.pi / 2:
        return np.zeros(image.depth.shape, dtype=bool)
    camera = image.camera
    v, u = np.mgrid[: camera.height, : camera.width].astype(float)
    rays = camera.rays(u, v)
    points = rays * image.depth[..., None]
    normals = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    length = np.linalg.norm(normals, axis=-1) * np.linalg.norm(rays, axis=-1)
    cosine = np.abs((normals * rays).sum(axis=-1)) / np.where(length > 0, length, 1.0)
    grazing: Truths = cosine < np.cos(grazing_rad)
    return grazing


Waves = NDArray[np.complex128]
BEAMS_PER_PIXEL = 5  # beams across a pixel that are followed
MARGIN_PX = 3  # beside the picture, for beams that reach beyond it
# standard deviations: an expectation this far from the next cycle is not mistaken
SURE_CYCLE_SIGMAS = 4.0
STEPPED_PX, FARTHEST_PX = (
    2,
    16,
)  # from a step: so far a beam may meet both sides; how much farther it may be than expected
FULL_TURN_RAD = 2.0 * np.pi


def scan_solids(
    solids: Sequence[tuple[Solid, Floats]], tool: Ranging, seed: int, finer: int = BEAMS_PER_PIXEL
) -> RangeImage:
    """The wrapped image of solids at poses T_eye_solid (4, 4). The same seed gives the same errors.

    `finer` is the number of beams that are followed across a pixel, an odd one.
    """
    random = np.random.default_rng(seed)
    wave = _at_beams(_returned_waves(solids, tool, finer), tool, finer, random)
    signal = 2.0 * FULL_TURN_RAD / tool.wavelength_m * tool.noise_m
    wave = wave + signal * (random.normal(size=wave.shape) + 1j * random.normal(size=wave.shape))
    strength = np.abs(wave)
    lost = (strength < np.cos(tool.grazing_rad)) | (random.random(wave.shape) < tool.dropouts)
    wrapped = np.mod(np.angle(wave) / FULL_TURN_RAD, 1.0) * tool.wavelength_m / 2.0
    # A range of exactly 0 would say that there is no answer.
    wrapped = np.maximum(wrapped, np.finfo(float).tiny)
    return RangeImage(tool, np.where(lost, 0.0, wrapped), np.where(lost, 0.0, strength), True)


def exact_ranges(
    solids: Sequence[tuple[Solid, Floats]], camera: DepthCamera
) -> tuple[Floats, Floats, Range]:
    """Ranges (h, w) without error, 0 for nothing, cosines (h, w) of the incidence, and the
    triangles that are seen.
    """
    picture = Range((camera.height, camera.width), camera.focal_px, camera.centre_px)
    corners = np.concatenate(
        [np.zeros((0, 3, 3)), *(apply(T, solid.vertices).reshape(-1, 3, 3) for solid, T in solids)]
    )
    draw(picture, np.ascontiguousarray(corners), np.arange(len(corners), dtype=np.int64))
    rays = camera.rays(*np.mgrid[: camera.height, : camera.width].astype(float)[::-1])
    length = np.sqrt((rays * rays).sum(axis=-1))
    met = picture.owner >= 0
    its, triangles = np.unique(picture.owner[met], return_inverse=True)
    a, b, c = np.moveaxis(corners[its], 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    facing = np.zeros(length.shape)
    facing[met] = np.abs((normals[triangles] * rays[met]).sum(axis=1)) / length[met]
    return picture.depth * length, facing, picture


def _returned_waves(solids: Sequence[tuple[Solid, Floats]], tool: Ranging, finer: int) -> Waves:
    """What comes back from each of many thin beams, over the picture and its margin."""
    camera = picture_of(tool)
    width, height = (finer * (pixels + 2 * MARGIN_PX) for pixels in (camera.width, camera.height))
    cx, cy = (finer * (centre + MARGIN_PX) + (finer - 1) / 2 for centre in camera.centre_px)
    metres, facing, _ = exact_ranges(
        solids, DepthCamera(width, height, finer * camera.focal_px, (cx, cy))
    )
    met = metres > 0
    strength = np.where(met, facing * (tool.at_m / np.where(met, metres, 1.0)) ** 2, 0.0)
    returned: Waves = strength * np.exp(2j * FULL_TURN_RAD / tool.wavelength_m * metres)
    return returned


def beam_px(tool: Ranging) -> float:
    """The standard deviation of the intensity across a beam in pixels: a quarter of its full
    width at 1/e^2.
    """
    return tool.beam_rad / 4.0 * picture_of(tool).focal_px


def _at_beams(wave: Waves, tool: Ranging, finer: int, random: np.random.Generator) -> Waves:
    """What comes back of each beam (height, width): summed over its width, where it points."""
    spread = finer * beam_px(tool)
    real, imaginary = (
        ndimage.gaussian_filter(component, spread, truncate=4.0)
        for component in (wave.real, wave.imag)
    )
    off = tool.pointing_rad * picture_of(tool).focal_px
    at = np.mgrid[: tool.height, : tool.width] + off * random.normal(
        size=(2, tool.height, tool.width)
    )
    at = finer * (at + MARGIN_PX) + (finer - 1) / 2
    # Lines between samples would make each beam wider than it is; cubic splines do not.
    waves: Waves = ndimage.map_coordinates(real, at, order=3) + 1j * ndimage.map_coordinates(
        imaginary, at, order=3
    )
    return waves


def resolve_ranges(image: RangeImage, expected_m: Floats, sigma_m: float) -> Resolving:
    """The image with whole ranges: of those that the phase allows, the nearest to the expected ones
    (height, width).

    `sigma_m` is the standard deviation of the expectation. Where nothing is expected (0), or the
    nearest range is farther off than four standard deviations, something else is there, whose range
    is not known: these pixels have no answer. Beside an expected step a beam may meet both sides;
    its range may be any, and it is kept.
    """
    cycle = image.tool.wavelength_m / 2.0
    if not image.wrapped:
        return image
    if not SURE_CYCLE_SIGMAS * sigma_m <= cycle / 2.0:
        most = cycle / 2.0 / SURE_CYCLE_SIGMAS
        return Vague(
            f"ranges repeat every {1e3 * cycle:.4g} mm, so the surface must be expected to "
            f"{1e3 * most:.3g} mm"
            f" (standard deviation); it is to {1e3 * sigma_m:.3g} mm"
        )
    wide = _reach_px(image, expected_m, sigma_m)
    limit = min(SURE_CYCLE_SIGMAS * float(np.hypot(sigma_m, image.tool.noise_m)), cycle / 2.0)
    stepped = _near_steps(expected_m, limit, wide)
    expected_m = _spread_ranges(expected_m, wide)
    times = np.rint((expected_m - image.range_m) / cycle)
    whole = image.range_m + cycle * times
    usable = (image.range_m > 0) & (expected_m > 0) & (whole > 0)
    usable &= stepped | (np.abs(whole - expected_m) <= limit)
    return _keep_known(image, whole, usable)


def _reach_px(image: RangeImage, expected_m: Floats, sigma_m: float) -> int:
    """How many pixels from where it is expected a step may be: as far as a beam reaches, and
    two standard deviations.
    """
    somewhere = expected_m[expected_m > 0]
    if not len(somewhere):
        return STEPPED_PX
    pitch_m = float(np.median(somewhere)) / image.camera.focal_px
    return STEPPED_PX + min(int(np.ceil(2.0 * sigma_m / pitch_m)), FARTHEST_PX)


def _near_steps(expected_m: Floats, by_m: float, wide: int) -> Truths:
    """The pixels (h, w) that are at most `wide` from where the expected ranges of neighbours
    differ by more than `by_m`, or end.
    """
    apart = ndimage.maximum_filter(expected_m, 3, mode="nearest") - ndimage.minimum_filter(
        expected_m, 3, mode="nearest"
    )
    # Ranges of a leaning surface differ from pixel to pixel, too.
    step = apart > by_m + 2.0 * np.median(apart)
    near_steps: Truths = ndimage.binary_dilation(step, np.ones((2 * wide + 1,) * 2))
    return near_steps


def _spread_ranges(expected_m: Floats, wide: int) -> Floats:
    """The expected ranges (h, w), and beside them, at most `wide` pixels away, those of the
    nearest pixel.
    """
    if not (expected_m > 0).any():
        return expected_m
    far, (v, u) = ndimage.distance_transform_edt(expected_m <= 0, return_indices=True)
    spread_ranges: Floats = np.where(far <= wide * np.sqrt(2.0), expected_m[v, u], 0.0)
    return spread_ranges


def _keep_known(image: RangeImage, whole: Floats, known: Truths) -> RangeImage:
    return replace(
        image,
        range_m=np.where(known, whole, 0.0),
        strength=np.where(known, image.strength, 0.0),
        wrapped=False,
    )


def expected_ranges(solids: Sequence[tuple[Solid, Floats]], tool: Ranging) -> Floats:
    """The ranges (height, width) that are expected of solids at poses T_eye_solid (4, 4); 0
    where nothing is.
    """
    return exact_ranges(solids, picture_of(tool))[0]


def of_depths(depth_m: Floats, tool: Ranging, step_m: float = 0.0) -> RangeImage:
    """The image of depths (height, width) along the axis, as depth cameras write them, in steps of
    `step_m` if they are rounded.

    Strengths are not known; they are those that a surface of the usual shine has there.
    """
    is_hit = depth_m > 0
    metres = np.where(is_hit, depth_m / beams_of(picture_of(tool))[..., 2], 0.0)
    image = RangeImage(tool, metres, is_hit.astype(float), guessed=True, step_m=step_m)
    strength = incidence_cosines(image) * (tool.at_m / np.where(is_hit, metres, 1.0)) ** 2
    return replace(image, strength=np.where(is_hit, strength, 0.0))
