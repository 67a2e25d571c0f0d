"""Range images as a laser ranging tool takes them: the phase of modulated light that came back, of all that the beam met.

What comes back is summed as complex amplitudes over the beam: where it meets two surfaces, the range lies between theirs ("mixed
pixels"), or the two cancel (Hebert & Krotkov, "3D measurements from imaging laser radars: how good are they?", 1992). The strength of a
return falls with the square of the range and with the cosine of the incidence. Noise is added to the amplitude, so ranges
err by so much more as the signal is weaker. The phase tells a range modulo half the wavelength of the modulation.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.ranging import RangeImage, Resolving, Vague, beams_of, picture_of
from cellwright.engine.model.solid import Solid
from cellwright.engine.model.vision import Camera
from cellwright.engine.stages.vision.kernels.rays import Range, draw
from cellwright.engine.stages.vision.slopes import cosines
from cellwright.kb.model.ranging import Ranging

Waves = NDArray[np.complex128]
FINER = 5  # beams across a pixel that are followed
MARGIN_PX = 3  # beside the picture, for beams that reach beyond it
SURE = 4.0  # standard deviations: an expectation this far from the next cycle is not mistaken
STEPPED_PX, FARTHEST_PX = (
    2,
    16,
)  # from a step: so far a beam may meet both sides; how much farther it may be than expected
TURN = 2.0 * np.pi


def scanned(
    solids: Sequence[tuple[Solid, Floats]], tool: Ranging, seed: int, finer: int = FINER
) -> RangeImage:
    """The wrapped image of solids at poses T_eye_solid (4, 4). The same seed gives the same errors.

    `finer` is the number of beams that are followed across a pixel, an odd one.
    """
    random = np.random.default_rng(seed)
    wave = _at_beams(_returned(solids, tool, finer), tool, finer, random)
    signal = 2.0 * TURN / tool.wavelength_m * tool.noise_m
    wave = wave + signal * (random.normal(size=wave.shape) + 1j * random.normal(size=wave.shape))
    strength = np.abs(wave)
    lost = (strength < np.cos(tool.grazing_rad)) | (random.random(wave.shape) < tool.dropouts)
    wrapped = np.mod(np.angle(wave) / TURN, 1.0) * tool.wavelength_m / 2.0
    # A range of exactly 0 would say that there is no answer.
    wrapped = np.maximum(wrapped, np.finfo(float).tiny)
    return RangeImage(tool, np.where(lost, 0.0, wrapped), np.where(lost, 0.0, strength), True)


def seen(solids: Sequence[tuple[Solid, Floats]], camera: Camera) -> tuple[Floats, Floats, Range]:
    """Ranges (h, w) without error, 0 for nothing, cosines (h, w) of the incidence, and the triangles that are seen."""
    picture = Range((camera.height, camera.width), camera.focal_px, camera.centre_px)
    corners = np.concatenate(
        [np.zeros((0, 3, 3)), *(apply(T, solid.vertices).reshape(-1, 3, 3) for solid, T in solids)]
    )
    draw(picture, np.ascontiguousarray(corners), np.arange(len(corners), dtype=np.int64))
    rays = camera.rays(*np.mgrid[: camera.height, : camera.width].astype(float)[::-1])
    length = np.sqrt((rays * rays).sum(axis=-1))
    met = picture.owner >= 0
    its, which = np.unique(picture.owner[met], return_inverse=True)
    a, b, c = np.moveaxis(corners[its], 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    facing = np.zeros(length.shape)
    facing[met] = np.abs((normals[which] * rays[met]).sum(axis=1)) / length[met]
    return picture.depth * length, facing, picture


def _returned(solids: Sequence[tuple[Solid, Floats]], tool: Ranging, finer: int) -> Waves:
    """What comes back from each of many thin beams, over the picture and its margin."""
    camera = picture_of(tool)
    width, height = (finer * (each + 2 * MARGIN_PX) for each in (camera.width, camera.height))
    cx, cy = (finer * (each + MARGIN_PX) + (finer - 1) / 2 for each in camera.centre_px)
    metres, facing, _ = seen(solids, Camera(width, height, finer * camera.focal_px, (cx, cy)))
    met = metres > 0
    strength = np.where(met, facing * (tool.at_m / np.where(met, metres, 1.0)) ** 2, 0.0)
    found: Waves = strength * np.exp(2j * TURN / tool.wavelength_m * metres)
    return found


def beam_px(tool: Ranging) -> float:
    """The standard deviation of the intensity across a beam in pixels: a quarter of its full width at 1/e^2."""
    return tool.beam_rad / 4.0 * picture_of(tool).focal_px


def _at_beams(wave: Waves, tool: Ranging, finer: int, random: np.random.Generator) -> Waves:
    """What comes back of each beam (height, width): summed over its width, where it points."""
    spread = finer * beam_px(tool)
    real, imaginary = (ndimage.gaussian_filter(each, spread, truncate=4.0) for each in (wave.real, wave.imag))
    off = tool.pointing_rad * picture_of(tool).focal_px
    at = np.mgrid[: tool.height, : tool.width] + off * random.normal(size=(2, tool.height, tool.width))
    at = finer * (at + MARGIN_PX) + (finer - 1) / 2
    # Lines between samples would make each beam wider than it is; cubic splines do not.
    found: Waves = ndimage.map_coordinates(real, at, order=3) + 1j * ndimage.map_coordinates(
        imaginary, at, order=3
    )
    return found


def resolved(image: RangeImage, expected_m: Floats, sigma_m: float) -> Resolving:
    """The image with whole ranges: of those that the phase allows, the nearest to the expected ones (height, width).

    `sigma_m` is the standard deviation of the expectation. Where nothing is expected (0), or the nearest range is farther off than
    four standard deviations, something else is there, whose range is not known: these pixels have no answer. Beside an expected
    step a beam may meet both sides; its range may be any, and it is kept.
    """
    cycle = image.tool.wavelength_m / 2.0
    if not image.wrapped:
        return image
    if not SURE * sigma_m <= cycle / 2.0:
        most = cycle / 2.0 / SURE
        return Vague(
            f"ranges repeat every {1e3 * cycle:.4g} mm, so the surface must be expected to {1e3 * most:.3g} mm"
            f" (standard deviation); it is to {1e3 * sigma_m:.3g} mm"
        )
    wide = _reach_px(image, expected_m, sigma_m)
    limit = min(SURE * float(np.hypot(sigma_m, image.tool.noise_m)), cycle / 2.0)
    stepped = _stepped(expected_m, limit, wide)
    expected_m = _spread(expected_m, wide)
    times = np.rint((expected_m - image.range_m) / cycle)
    whole = image.range_m + cycle * times
    known = (image.range_m > 0) & (expected_m > 0) & (whole > 0)
    known &= stepped | (np.abs(whole - expected_m) <= limit)
    return _kept(image, whole, known)


def _reach_px(image: RangeImage, expected_m: Floats, sigma_m: float) -> int:
    """How many pixels from where it is expected a step may be: as far as a beam reaches, and two standard deviations."""
    somewhere = expected_m[expected_m > 0]
    if not len(somewhere):
        return STEPPED_PX
    pitch_m = float(np.median(somewhere)) / image.camera.focal_px
    return STEPPED_PX + min(int(np.ceil(2.0 * sigma_m / pitch_m)), FARTHEST_PX)


def _stepped(expected_m: Floats, by_m: float, wide: int) -> Truths:
    """The pixels (h, w) that are at most `wide` from where the expected ranges of neighbours differ by more than `by_m`, or end."""
    apart = ndimage.maximum_filter(expected_m, 3, mode="nearest") - ndimage.minimum_filter(
        expected_m, 3, mode="nearest"
    )
    # Ranges of a leaning surface differ from pixel to pixel, too.
    step = apart > by_m + 2.0 * np.median(apart)
    found: Truths = ndimage.binary_dilation(step, np.ones((2 * wide + 1,) * 2))
    return found


def _spread(expected_m: Floats, wide: int) -> Floats:
    """The expected ranges (h, w), and beside them, at most `wide` pixels away, those of the nearest pixel."""
    if not (expected_m > 0).any():
        return expected_m
    far, (v, u) = ndimage.distance_transform_edt(expected_m <= 0, return_indices=True)
    found: Floats = np.where(far <= wide * np.sqrt(2.0), expected_m[v, u], 0.0)
    return found


def _kept(image: RangeImage, whole: Floats, known: Truths) -> RangeImage:
    return replace(
        image,
        range_m=np.where(known, whole, 0.0),
        strength=np.where(known, image.strength, 0.0),
        wrapped=False,
    )


def expected(solids: Sequence[tuple[Solid, Floats]], tool: Ranging) -> Floats:
    """The ranges (height, width) that are expected of solids at poses T_eye_solid (4, 4); 0 where nothing is."""
    return seen(solids, picture_of(tool))[0]


def of_depths(depth_m: Floats, tool: Ranging, step_m: float = 0.0) -> RangeImage:
    """The image of depths (height, width) along the axis, as depth cameras write them, in steps of `step_m` if they are rounded.

    Strengths are not known; they are those that a surface of the usual shine has there.
    """
    known = depth_m > 0
    metres = np.where(known, depth_m / beams_of(picture_of(tool))[..., 2], 0.0)
    image = RangeImage(tool, metres, known.astype(float), guessed=True, step_m=step_m)
    strength = cosines(image) * (tool.at_m / np.where(known, metres, 1.0)) ** 2
    return replace(image, strength=np.where(known, strength, 0.0))
