"""Range images err as the tool is said to; their edges, rims and patches are where the geometry
puts them.
"""

from dataclasses import replace

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import rotation_by_vector, transform, translation
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.shape_fits import Fit, FitShape
from cellwright.engine.model.vision import EdgeKind, PixelWindow, RangeImage, Vague, picture_of
from cellwright.engine.stages.fitting.shape_fit import fit_measured_shape
from cellwright.engine.stages.vision.range_edges import find_edges
from cellwright.engine.stages.vision.range_patches import cloud_of, place_patch, range_sigmas
from cellwright.engine.stages.vision.sensor_images import (
    expected_ranges,
    of_depths,
    resolve_ranges,
    scan_solids,
)
from cellwright.engine.stages.vision.surface_rims import find_rim
from cellwright.kb.model.cell_model import Ranging
from tests.engine.stages.solids import block, prism

TOOL = Ranging("laser", 48, 48, np.radians(8), 0.3, 5e-5, 0.5, 0.0024, 0.0001)
WALL = (block(0.3, 0.3, 0.01), translation(0, 0, 0.505))
STEPPED = [
    (block(0.1, 0.2, 0.01), translation(-0.05, 0, 0.5)),
    (block(0.3, 0.3, 0.01), translation(0, 0, 0.52)),
]
SLANT = transform(rotation_by_vector(np.array([0.0, 0.0, 0.2])), (0.0, 0.0, 0.0))
SLANTING = [(each, SLANT @ T) for each, T in STEPPED]
Placed = list[tuple[Solid, Floats]]


def image_of(solids: Placed, tool: Ranging = TOOL, seed: int = 1) -> RangeImage:
    found = resolve_ranges(scan_solids(solids, tool, seed), expected_ranges(solids, tool), 0.002)
    assert isinstance(found, RangeImage)
    return found


def test_ranges_scatter_as_the_strength_of_the_signal_says() -> None:
    for lean in (0.0, 1.0):
        solids = [
            (WALL[0], transform(rotation_by_vector(np.array([0.0, lean, 0.0])), (0.0, 0.0, 0.505)))
        ]
        image = image_of(solids)
        off = (image.range_m - expected_ranges(solids, TOOL)) / range_sigmas(image)
        assert 0.9 < float(off[4:-4, 4:-4].std()) < 1.1


def test_noise_grows_with_range_and_incidence() -> None:
    near, far = (
        float(np.median(image_of([(WALL[0], translation(0, 0, z))]).noise_m))
        for z in (0.505, 0.705)
    )
    flat = image_of(
        [(WALL[0], transform(rotation_by_vector(np.array([0.0, 1.0, 0.0])), (0.0, 0.0, 0.505)))]
    )
    assert far / near == pytest.approx(1.96, rel=0.02)
    assert float(np.median(flat.noise_m)) / near == pytest.approx(1.0 / np.cos(1.0), rel=0.1)


def test_the_same_seed_gives_the_same_image() -> None:
    one, other, another = (scan_solids([WALL], TOOL, seed) for seed in (3, 3, 4))
    assert (one.range_m == other.range_m).all()
    assert (one.range_m != another.range_m).any()


def test_ranges_are_known_modulo_half_the_wavelength_only() -> None:
    wrapped = scan_solids([WALL], TOOL, 1)
    assert wrapped.wrapped
    assert wrapped.range_m.max() < TOOL.wavelength_m / 2
    shifted = [(WALL[0], translation(0, 0, 0.505 + TOOL.wavelength_m / 2))]
    alias = resolve_ranges(wrapped, expected_ranges(shifted, TOOL), 0.002)
    assert isinstance(alias, RangeImage)
    cycle = np.abs(
        np.median((alias.range_m - image_of([WALL]).range_m)[20:28, 20:28]) - TOOL.wavelength_m / 2
    )
    assert cycle < 1e-9


@pytest.mark.parametrize("sigma_m", [0.02, 1.0, float("nan"), float("inf")])
def test_a_vague_expectation_is_refused(sigma_m: float) -> None:
    found = resolve_ranges(scan_solids([WALL], TOOL, 1), expected_ranges([WALL], TOOL), sigma_m)
    assert isinstance(found, Vague)
    assert "repeat every 150 mm" in found.reason


def test_what_lies_elsewhere_than_expected_has_no_range() -> None:
    there = [(WALL[0], translation(0, 0, 0.545))]
    found = resolve_ranges(scan_solids(there, TOOL, 1), expected_ranges([WALL], TOOL), 0.002)
    assert isinstance(found, RangeImage)
    assert not found.range_m.any()


def test_a_beam_on_two_surfaces_tells_a_range_between_them() -> None:
    tool = replace(TOOL, pointing_rad=0.0, noise_m=1e-7)
    image = image_of(SLANTING, tool)
    off = np.minimum(np.abs(image.range_m - 0.495), np.abs(image.range_m - 0.515))
    mixed = off[10:-10] > 0.002
    assert mixed.any()
    assert mixed.sum(axis=1).max() <= 3
    between = image.range_m[10:-10][mixed]
    assert ((between > 0.494) & (between < 0.518)).all()


def test_a_surface_that_is_seen_too_flat_gives_no_answer() -> None:
    solids = [
        (WALL[0], transform(rotation_by_vector(np.array([0.0, 1.45, 0.0])), (0.0, 0.0, 0.505)))
    ]
    assert not scan_solids(solids, replace(TOOL, grazing_rad=1.0), 1).range_m[20:28, 20:28].any()
    assert scan_solids(solids, replace(TOOL, grazing_rad=1.5), 1).range_m[20:28, 20:28].all()


@pytest.mark.parametrize(("height", "kind"), [(0.02, EdgeKind.ROOF), (-0.02, EdgeKind.CREASE)])
def test_roofs_and_creases_are_told_apart(height: float, kind: EdgeKind) -> None:
    low = min(height, 0.0) - 0.03
    ridge = prism("w", [(-0.06, low), (0.06, low), (0.06, 0.0), (0.0, height), (-0.06, 0.0)], 0.2)
    image = image_of(
        [(ridge, transform(rotation_by_vector(np.array([-np.pi / 2, 0, 0])), (0, 0, 0.5)))]
    )
    edges = find_edges(image)
    columns = np.nonzero(edges.on(kind)[8:-8])[1]
    other = EdgeKind.CREASE if kind is EdgeKind.ROOF else EdgeKind.ROOF
    assert len(columns) > 20
    assert np.abs(columns - 23.5).max() < 3
    assert not edges.on(other).any()
    assert not edges.on(EdgeKind.STEP).any()
    wanted = 2 * np.arctan(0.02 / 0.06)
    assert np.median(edges.turn_rad[edges.on(kind)]) == pytest.approx(wanted, rel=0.1)


def test_steps_are_where_one_surface_ends() -> None:
    edges = find_edges(image_of(STEPPED))
    columns = np.nonzero(edges.on(EdgeKind.STEP))[1]
    where = picture_of(TOOL).pixels(np.array([[0.0, 0.0, 0.495]]))[0][0]
    assert np.abs(columns - where).max() <= 2
    assert np.median(edges.jump_m[edges.on(EdgeKind.STEP)]) == pytest.approx(0.02, rel=0.05)
    assert not (edges.on(EdgeKind.ROOF) | edges.on(EdgeKind.CREASE)).any()


def test_a_round_body_has_no_roof() -> None:
    around = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    cylinder = prism("c", [(0.05 * np.cos(a), 0.05 * np.sin(a)) for a in around], 0.2)
    edges = find_edges(
        image_of(
            [(cylinder, transform(rotation_by_vector(np.array([-np.pi / 2, 0, 0])), (0, 0, 0.55)))]
        )
    )
    assert not (edges.on(EdgeKind.ROOF) | edges.on(EdgeKind.CREASE)).any()


def test_a_patch_across_a_step_leaves_out_what_is_mixed() -> None:
    image = image_of(STEPPED)
    found = fit_measured_shape(
        FitShape.PLANE, cloud_of(image, find_edges(image), PixelWindow(0, 0, 20, 48))
    )
    assert isinstance(found, Fit)
    assert found.used.mean() > 0.98
    assert abs(float(found.axis @ found.origin)) == pytest.approx(
        0.495, abs=5 * found.deviation("z")
    )


def test_the_rim_of_a_step_is_told_to_a_fraction_of_a_pixel() -> None:
    tool = replace(TOOL, pointing_rad=0.0)
    rim = find_rim(
        image_of(SLANTING, tool), np.array([0.0, 0.0, 1.0]), 0.495, PixelWindow(0, 4, 48, 44)
    )
    assert rim is not None
    pixel = 0.495 / picture_of(tool).focal_px
    off = rim.cloud.points @ SLANT[:3, 0]
    assert len(off) > 10
    assert abs(float(np.median(off))) < 0.05 * pixel
    assert float(np.abs(off).max()) < 0.5 * pixel


def test_a_rim_before_something_else_on_a_leaning_part_has_all_its_pixels() -> None:
    """Where a part leans, a step is still where the range jumps from one pixel to the next:
    mixed pixels keep their answers.
    """
    lean = transform(rotation_by_vector(np.array([0.3, -0.25, 0.0])), (0.0, 0.0, 0.5))
    edge = [
        (block(0.1, 0.3, 0.01), lean @ translation(-0.05, 0.0, 0.0)),
        (block(0.4, 0.4, 0.01), translation(0, 0, 0.57)),
    ]
    normal = lean[:3, 2]
    offset = float(normal @ (lean[:3, 3] - 0.005 * normal))
    rim = find_rim(image_of(edge), normal, offset, PixelWindow(0, 4, 48, 44))
    assert rim is not None
    assert len(rim.pixels) >= 18  # of the 40 rows
    off = (rim.cloud.points - lean[:3, 3]) @ lean[:3, 0]
    sigma = rim.cloud.sigma_m
    assert abs(float(np.median(off / sigma))) < 0.6
    assert float((np.abs(off / sigma) < 3.0).mean()) > 0.8


@pytest.mark.slow
def test_beams_beside_their_direction_are_rendered_as_exactly_as_those_that_are_not() -> None:
    """Between the samples of a rendered picture a beam is as wide as it is: samples four times
    as near make no difference.
    """
    around = np.linspace(0.0, 2.0 * np.pi, 601)[:-1]
    rod = prism("rod", [(0.02 * np.cos(each), 0.02 * np.sin(each)) for each in around], 0.4)
    lying = [
        (rod, transform(rotation_by_vector(np.array([np.pi / 2, 0.0, 0.1])), (0.0, 0.0, 0.52)))
    ]
    tool = replace(TOOL, noise_m=1e-9, pointing_rad=1e-3, width=24, height=24)
    coarse, fine = (scan_solids(lying, tool, 7, finer) for finer in (5, 21))
    both = (coarse.range_m > 0) & (fine.range_m > 0)
    inner = both & (np.minimum(coarse.strength, fine.strength) > 0.6 * coarse.strength.max())
    off = (coarse.range_m - fine.range_m)[inner]
    assert inner.sum() > 20
    assert abs(float(off.mean())) < 2e-6


def test_there_is_no_rim_of_a_plane_that_is_not_seen() -> None:
    assert (
        find_rim(image_of([WALL]), np.array([0.0, 0.0, 1.0]), 0.4, PixelWindow(0, 0, 48, 48))
        is None
    )


def test_a_patch_is_placed_clear_of_edges_and_as_sure_as_it_says() -> None:
    found = place_patch(
        STEPPED, TOOL, np.array([-0.003, 0.0, 0.495]), np.array([0.0, 0.0, -1.0]), (0.005, 0.02)
    )
    assert found is not None
    edge = picture_of(TOOL).pixels(np.array([[0.0, 0.0, 0.495]]))[0][0]
    assert found.window.right < edge - 1
    cloud = cloud_of(image := image_of(STEPPED), find_edges(image), found.window)
    fit = fit_measured_shape(FitShape.PLANE, cloud)
    assert isinstance(fit, Fit)
    x, y, _ = fit.T_world_shape[:3, :3].T @ (np.array([-0.003, 0.0, 0.495]) - fit.origin)
    by = np.array([1.0, -x, -y])
    assert float(np.sqrt(by @ fit.covariance @ by)) == pytest.approx(found.sigma_m, rel=0.15)


def test_the_placed_patch_is_the_best_of_all() -> None:
    """Against the covariance of each square of that size that is as far from edges."""
    point, normal = np.array([-0.003, 0.0, 0.495]), np.array([0.0, 0.0, -1.0])
    found = place_patch(STEPPED, TOOL, point, normal, (0.01, 0.01))
    assert found is not None
    side = found.window.right - found.window.left
    x = expected_ranges(STEPPED, TOOL)[..., None] * image_of(STEPPED).beams - point

    def sigma(left: int, top: int) -> float:
        own = x[top : top + side, left : left + side, :2].reshape(-1, 2)
        rows = np.column_stack([np.ones(len(own)), own])
        return float(np.sqrt(np.linalg.inv(rows.T @ rows)[0, 0]))

    best = min(
        sigma(left, top) for left in range(found.window.left + 1) for top in range(0, 48 - side, 2)
    )
    assert sigma(found.window.left, found.window.top) <= 1.02 * best


def test_no_patch_is_placed_where_the_surface_is_too_small() -> None:
    small = [(block(0.004, 0.004, 0.01), translation(0, 0, 0.5))]
    assert (
        place_patch(
            small, TOOL, np.array([0.0, 0.0, 0.495]), np.array([0.0, 0.0, -1.0]), (0.005, 0.02)
        )
        is None
    )


def test_depths_become_ranges_along_the_beams() -> None:
    image = of_depths(np.full((48, 48), 0.5), TOOL)
    assert np.allclose(image.points[..., 2], 0.5)
    assert image.range_m[0, 0] > 0.5
