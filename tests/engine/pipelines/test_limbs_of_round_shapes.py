"""Edges where a round body turns away choose none of its points; those where it ends do."""

import numpy as np
import pytest

from cellwright.engine.kernels.rigid import transform, translation, turned
from cellwright.engine.model.fits import Fit, Shape
from cellwright.engine.model.ranging import EdgeKind, RangeImage, Window
from cellwright.engine.pipelines.dimensions import Asked, dimensions
from cellwright.engine.pipelines.dimensions.limbs import without_own_limb
from cellwright.engine.stages.fitting.surfaces import fitted
from cellwright.engine.stages.vision.edges import edges_of
from cellwright.engine.stages.vision.patches import cloud_of
from cellwright.engine.stages.vision.ranging import expected, resolved, scanned
from cellwright.kb.model.ranging import Ranging
from tests.engine.stages.solids import prism

TOOL = Ranging("laser", 48, 48, float(np.radians(7.3)), 0.3, 5e-5, 0.15, 0.0027, 0.00027)
WHOLE = Window(0, 0, 48, 48)
RADIUS_M, LENGTH_M = 0.006, 0.012


def pin(seed: int) -> RangeImage:
    """A short pin that lies across the picture, its ends and both its limbs in sight, and nothing behind it."""
    around = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    body = prism("pin", [(RADIUS_M * np.cos(a), RADIUS_M * np.sin(a)) for a in around], LENGTH_M)
    lying = transform(turned(np.array([0.0, np.pi / 2, 0.0])), (0.0, 0.0, 0.0))
    solids = [(body, translation(0.0, 0.0, 0.156) @ lying)]
    found = resolved(scanned(solids, TOOL, seed), expected(solids, TOOL), 0.001)
    assert isinstance(found, RangeImage)
    return found


def test_the_limb_of_a_pin_is_no_edge_of_it_and_its_ends_are() -> None:
    image = pin(1)
    edges = edges_of(image)
    cloud = cloud_of(image, edges, WHOLE)
    fit = fitted(Shape.CYLINDER, cloud)
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
    edges = edges_of(image)
    window = Window(16, 20, 32, 28)
    cloud = cloud_of(image, edges, window)
    flat = fitted(Shape.PLANE, cloud)
    assert not isinstance(flat, Fit) or without_own_limb(image, edges, flat, cloud) is None


@pytest.mark.slow
def test_the_diameter_of_a_pin_errs_as_stated() -> None:
    off = []
    for seed in range(40):
        found = dimensions(pin(seed), [Asked("pin", Shape.CYLINDER, WHOLE)]).fits["pin"]
        assert isinstance(found, Fit)
        off.append((found.radius_m - RADIUS_M) / found.deviation("radius"))
    assert abs(np.mean(off)) < 0.1 + 2.5 / np.sqrt(len(off))
    assert 0.75 < np.std(off) < 1.3
