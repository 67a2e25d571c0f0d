"""Depth images say what geometry says; parts are found in them, or it is said why not."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import (
    difference,
    rotation,
    rotation_by_vector,
    transform,
    translation,
)
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.vision import DepthCamera, DepthImage, LocatedPart, NotLocated
from cellwright.engine.stages.vision.kernels.rays import Range, draw
from cellwright.engine.stages.vision.part_localisation import KnownScene, locate_in_image
from cellwright.engine.stages.vision.pose_hypotheses import PartModel, solid_symmetries
from cellwright.engine.stages.vision.pose_refinement import AGREEING_NOISE, ImageView, judge_pose
from cellwright.engine.stages.vision.sensor_images import DepthSensor, disturb_image, render_depths
from tests.engine.stages.solids import block, ell

CAMERA = DepthCamera.viewing(640, 480, 0.6, 1.0)
DOWN: Floats = np.diag([1.0, -1.0, -1.0])
T_CAMERA_WORLD = transform(DOWN, (0.0, 0.0, 1.0))
TABLE = (block(2.0, 2.0, 0.1), T_CAMERA_WORLD @ translation(0, 0, -0.05))
FLOOR = np.array([0.0, 0.0, -1.0, -1.0])
PART = ell(0.1, 0.08, 0.03, 0.05)


def lying(x: float, y: float, turn: float, height: float = 0.025) -> Floats:
    """The pose in the camera's frame of a prism that lies on its bottom."""
    return T_CAMERA_WORLD @ transform(rotation((0, 0, 1), turn), (x, y, height))


def seen(
    *things: tuple[Solid, Floats], seed: int = 0, noise: float = 0.001
) -> tuple[DepthImage, KnownScene]:
    """An image of things on the table, and what is known before."""
    image = disturb_image(
        render_depths([TABLE, *things], CAMERA)[0], DepthSensor(noise, 0.01), seed
    )
    known = np.abs(image.depth - render_depths([TABLE], CAMERA)[0].depth) < 4 * noise
    return image, KnownScene(known, (FLOOR,))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_rays_meet_triangles_where_planes_and_weights_say(seed: int) -> None:
    random = np.random.default_rng(seed)
    triangles = random.uniform(-1, 1, (4, 3, 3)) + np.array([0.0, 0.0, 1.2])
    image = Range((9, 12), 8.0, (5.5, 4.0))
    draw(image, triangles, np.arange(4))
    for v, u in product(range(9), range(12)):
        ray = np.array([(u - 5.5) / 8.0, (v - 4.0) / 8.0, 1.0])
        depths = [(z, n) for n, t in enumerate(triangles) if (z := plain_depth(ray, t)) > 0]
        nearest, owner = min(depths, default=(0.0, -1))
        assert image.depth[v, u] == pytest.approx(nearest, abs=1e-9)
        assert image.owner[v, u] == owner


def plain_depth(ray: Floats, triangle: Floats) -> float:
    """The depth at which a ray meets a triangle, from its weights there; 0 if it does not."""
    a, b, c = triangle
    weights = np.linalg.solve(np.stack([b - a, c - a, -ray], axis=1), -a)
    inside = weights[0] >= 0 and weights[1] >= 0 and weights[0] + weights[1] <= 1
    return float(weights[2]) if inside and weights[2] > 1e-6 else 0.0


def test_a_block_of_three_lengths_looks_the_same_in_four_poses_and_a_cube_in_24() -> None:
    assert len(solid_symmetries(block(0.1, 0.2, 0.3))) == 4
    assert len(solid_symmetries(block(0.1, 0.1, 0.1))) == 24
    assert len(solid_symmetries(ell(0.1, 0.08, 0.03, 0.05))) == 1
    assert len(solid_symmetries(ell(0.1, 0.1, 0.03, 0.05))) == 2


@pytest.mark.parametrize("seed", range(4))
def test_a_part_is_found_within_a_millimetre_and_half_a_degree(seed: int) -> None:
    random = np.random.default_rng(seed)
    T = lying(*random.uniform(-0.1, 0.1, 2), random.uniform(-3, 3))
    other = (block(0.06, 0.05, 0.09), lying(0.2, 0.1, 0.4, 0.045))
    found = locate_in_image(PartModel(PART), *seen((PART, T), other, seed=seed))
    assert isinstance(found, LocatedPart)
    metres, radians = difference(found.best.T_camera_part, T)
    assert metres < 0.001
    assert radians < np.radians(0.5)
    sigma = np.sqrt(np.diag(found.covariance)[:3])
    assert (sigma < 0.0005).all()


def test_a_part_that_is_half_hidden_is_found() -> None:
    T = lying(0.0, 0.0, 0.7)
    cover = (block(0.12, 0.3, 0.01), lying(-0.065, 0.0, 0.7, 0.1))
    found = locate_in_image(PartModel(PART), *seen((PART, T), cover))
    assert isinstance(found, LocatedPart)
    assert difference(found.best.T_camera_part, T)[0] < 0.002


def test_a_leaning_part_is_found() -> None:
    lean = rotation_by_vector(np.array([0.3, -0.2, 0.5]))
    T = T_CAMERA_WORLD @ transform(lean, (0.02, 0.03, 0.06))
    low = (T[:3, :3] @ PART.vertices.T).T[:, 2].max() + T[2, 3]
    T[2, 3] -= low - 1.0
    found = locate_in_image(PartModel(PART), *seen((PART, T)))
    assert isinstance(found, LocatedPart)
    assert difference(found.best.T_camera_part, T)[0] < 0.002


def test_all_poses_of_a_symmetric_part_are_given() -> None:
    part, T = block(0.1, 0.06, 0.05), lying(0.05, -0.04, 1.0)
    found = locate_in_image(PartModel(part), *seen((part, T)))
    assert isinstance(found, LocatedPart)
    assert len(found.equivalent) == 4
    assert min(difference(each, T)[0] for each in found.equivalent) < 0.001


def test_what_is_not_there_is_not_found() -> None:
    others = [
        (block(0.06, 0.05, 0.09), lying(0.1, 0.1, 0.4, 0.045)),
        (block(0.1, 0.08, 0.05), lying(-0.1, 0, 1.0)),
    ]
    assert isinstance(locate_in_image(PartModel(PART), *seen(*others)), NotLocated)
    assert isinstance(locate_in_image(PartModel(PART), *seen()), NotLocated)


def test_a_part_in_mid_air_over_a_smaller_top_is_not_believed() -> None:
    post = (block(0.1, 0.06, 0.12), lying(0.0, 0.0, 0.3, 0.06))
    found = locate_in_image(PartModel(block(0.1, 0.06, 0.04)), *seen(post))
    assert isinstance(found, NotLocated)


def test_the_same_seed_gives_the_same_errors() -> None:
    image, _ = render_depths([TABLE], CAMERA)
    one, other = (disturb_image(image, DepthSensor(0.001, 0.02, mixed=0.05), 3) for _ in range(2))
    assert (one.depth == other.depth).all()
    assert (one.depth == 0).mean() == pytest.approx(0.02, abs=0.002)


def test_what_shows_through_a_part_counts_against_it_more_than_what_is_not_seen() -> None:
    """Otherwise a pose that claims a few more pixels wins over the true one, although the table
    is seen through it.
    """
    T = lying(0.0, 0.0, 0.3)
    image, ground = seen((PART, T))
    table, owner = (
        render_depths([TABLE], CAMERA)[0].depth,
        render_depths([TABLE, (PART, T)], CAMERA)[1],
    )
    inside = ndimage.binary_erosion(owner == 1, iterations=8)
    some = inside & (np.cumsum(inside).reshape(inside.shape) <= 40)
    through, unseen = (
        judge_pose(
            PartModel(PART),
            ImageView(DepthImage(CAMERA, np.where(some, other, image.depth), 0.001), ground.known),
            T,
        )
        for other in (table, np.zeros_like(table))
    )
    assert through is not None
    assert unseen is not None
    assert through.evidence < unseen.evidence - 40 * AGREEING_NOISE**2 * 0.9


@pytest.mark.parametrize("longer_m", [0.0025, -0.0025])
def test_a_part_of_nearly_the_same_size_is_not_taken_for_the_one_that_is_looked_for(
    longer_m: float,
) -> None:
    """Place by place its outline agrees, but whole edges of it are off one way."""
    part, other = block(0.1, 0.06, 0.05), block(0.1 + longer_m, 0.06, 0.05)
    there, instead = (
        locate_in_image(PartModel(part), *seen((each, lying(0.05, -0.04, 1.0))))
        for each in (part, other)
    )
    assert isinstance(there, LocatedPart)
    assert there.best.off_px < 0.5
    assert isinstance(instead, NotLocated)
