"""Edges where a round body turns away choose none of its points; those where it ends do."""

import numpy as np
import pytest

from cellwright.engine.kernels.rigid import rotation_by_vector, transform, translation
from cellwright.engine.model.shape_fits import Fit, FitShape
from cellwright.engine.model.vision import EdgeKind, PixelWindow, RangeImage
from cellwright.engine.pipelines.motion.image_dimensions import (
    DimensionRequest,
    dimensions_in_image,
    without_own_limb,
)
from cellwright.engine.stages.fitting.shape_fit import fit_measured_shape
from cellwright.engine.stages.vision.range_edges import find_edges
from cellwright.engine.stages.vision.range_patches import cloud_of
from cellwright.engine.stages.vision.sensor_images import (
    expected_ranges,
    resolve_ranges,
    scan_solids,
)
from cellwright.kb.model.cell_model import Ranging
from tests.engine.stages.solids import prism

TOOL = Ranging("laser", 48, 48, float(np.radians(7.3)), 0.3, 5e-5, 0.15, 0.0027, 0.00027)
WHOLE = PixelWindow(0, 0, 48, 48)
RADIUS_M, LENGTH_M = 0.006, 0.012


def pin(seed: int) -> RangeImage:
    """A short pin that lies across the picture, its ends and both its limbs in sight, and
    nothing behind it.
    """
    around = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    body = prism("pin", [(RADIUS_M * np.cos(a), RADIUS_M * np.sin(a)) for a in around], LENGTH_M)
    lying = transform(rotation_by_vector(np.array([0.0, np.pi / 2, 0.0])), (0.0, 0.0, 0.0))
    solids = [(body, translation(0.0, 0.0, 0.156) @ lying)]
    found = resolve_ranges(scan_solids(solids, TOOL, seed), expected_ranges(solids, TOOL), 0.001)
    assert isinstance(found, RangeImage)
    return found


def test_the_limb_of_a_pin_is_no_edge_of_it_and_its_ends_are() -> None:
    image = pin(1)
    edges = find_edges(image)
    cloud = cloud_of(image, edges, WHOLE)
    fit = fit_measured_shape(FitShape.CYLINDER, cloud)
    assert isinstance(fit, Fit)
    kept = without_own_limb(image, edges, fit, cloud)
    assert kept is not None
    rows, columns = np.nonzero(kept.on(EdgeKind.STEP))
    limb = RADIUS_M / 0.156 * image.camera.focal_px
    middle = image.camera.centre_px[1]
    assert len(rows)
    assert (
        np.abs(np.abs(columns - image.camera.centre_px[0]) - limb) < 2.5
    ).all()  # it is as long as it is wide
    assert (np.abs(rows - middle) < limb - 4).all()
    before = np.nonzero(edges.on(EdgeKind.STEP))[0]
    assert (np.abs(before - middle) > limb - 4).any()


def test_a_plane_has_no_limb() -> None:
    image = pin(1)
    edges = find_edges(image)
    window = PixelWindow(16, 20, 32, 28)
    cloud = cloud_of(image, edges, window)
    flat = fit_measured_shape(FitShape.PLANE, cloud)
    assert not isinstance(flat, Fit) or without_own_limb(image, edges, flat, cloud) is None


@pytest.mark.slow
def test_the_diameter_of_a_pin_errs_as_stated() -> None:
    off = []
    for seed in range(40):
        found = dimensions_in_image(
            pin(seed), [DimensionRequest("pin", FitShape.CYLINDER, WHOLE)]
        ).fits["pin"]
        assert isinstance(found, Fit)
        off.append((found.radius_m - RADIUS_M) / found.deviation("radius"))
    assert abs(np.mean(off)) < 0.1 + 2.5 / np.sqrt(len(off))
    assert 0.75 < np.std(off) < 1.3
