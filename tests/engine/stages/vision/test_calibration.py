"""What a range finder errs by, and where it stands, are recovered from what it shows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import (
    difference,
    inverse,
    rotation,
    rotation_by_vector,
    rotation_vector,
    transform,
)
from cellwright.engine.model.vision import DepthCamera, DepthImage, LocatedPart, PoseHypothesis
from cellwright.engine.stages.vision.sensor_calibration import (
    fit_camera_calibration,
    fit_range_calibration,
)

CAMERA = DepthCamera.viewing(160, 120, 0.6, 1.0)
SURE = np.diag([0.0003, 0.0003, 0.0006, 0.002, 0.002, 0.001]) ** 2


def plate(
    distance: float, lean: tuple[float, float], offset: float, scale: float, seed: int
) -> DepthImage:
    """A plate that leans a little, as a range finder with errors sees it."""
    random = np.random.default_rng(seed)
    v, u = np.mgrid[:120, :160].astype(float)
    rays = CAMERA.rays(u, v)
    normal = np.array([*lean, 1.0])
    true = distance / (rays @ normal)
    depth = offset + scale * true + random.normal(0, 0.001, true.shape)
    return DepthImage(CAMERA, np.where(random.random(true.shape) < 0.02, 0.0, depth), 0.001)


@given(
    offset=st.floats(-0.02, 0.02),
    scale=st.floats(0.95, 1.05),
    leans=st.lists(
        st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05)), min_size=5, max_size=5
    ),
)
def test_offset_and_scale_are_recovered_from_plates_that_lean(
    offset: float, scale: float, leans: list[tuple[float, float]]
) -> None:
    distances = [0.6, 0.75, 0.9, 1.05, 1.2]
    images = [
        plate(d, lean, 0.0, 1.0, n)
        for n, (d, lean) in enumerate(zip(distances, leans, strict=True))
    ]
    images = [
        DepthImage(CAMERA, np.where(each.depth > 0, offset + scale * each.depth, 0.0), 0.001)
        for each in images
    ]
    found = fit_range_calibration(images, distances)
    assert abs(found.offset_m - offset) < 0.001
    assert abs(found.scale - scale) < 0.001
    assert found.noise_m == pytest.approx(0.001 * scale, rel=0.15)
    assert found.dropouts == pytest.approx(0.02, abs=0.005)
    for image, distance in zip(images, distances, strict=True):
        seen = found.corrected(image).depth
        assert abs(np.median(seen[55:65, 75:85]) - distance) < 0.001


def test_fewer_than_three_distances_are_refused() -> None:
    images = [plate(d, (0.0, 0.0), 0.0, 1.0, 0) for d in (0.6, 0.6, 1.0)]
    with pytest.raises(ValueError, match="3 different distances"):
        fit_range_calibration(images, [0.6, 0.6, 1.0])


def test_an_image_without_a_plate_is_named() -> None:
    images = [plate(d, (0.0, 0.0), 0.0, 1.0, 0) for d in (0.6, 0.8, 1.0)]
    images[1] = DepthImage(CAMERA, np.zeros_like(images[1].depth), 0.001)
    with pytest.raises(ValueError, match="image 2 shows no plate"):
        fit_range_calibration(images, [0.6, 0.8, 1.0])


def sighting(T: Floats, random: np.random.Generator) -> LocatedPart:
    """A target that was seen with errors."""
    error = np.linalg.cholesky(SURE) @ random.normal(size=6)
    seen = transform(rotation_by_vector(error[3:]) @ T[:3, :3], T[:3, 3] + error[:3])
    return LocatedPart(PoseHypothesis(seen, 1.0, 1.0, 1.0, 1000, 1000.0), SURE, (seen,), None)


def hands(random: np.random.Generator, number: int, lean: float) -> list[Floats]:
    made = []
    for _ in range(number):
        R = rotation_by_vector(random.uniform(-lean, lean, 3)) @ rotation((1, 0, 0), np.pi / 2)
        made.append(transform(R, random.uniform([0.35, 0.1, 0.1], [0.55, 0.3, 0.35])))
    return made


def problem(
    seed: int, number: int, lean: float = 0.5
) -> tuple[list[Floats], list[LocatedPart], Floats, Floats]:
    """Poses of a hand, sightings of what it holds, and the hidden poses of camera and target."""
    random = np.random.default_rng(seed)
    camera = transform(np.diag([1.0, -1.0, -1.0]), (0.45, 0.2, 1.0)) @ transform(
        rotation_by_vector(random.normal(0, 0.03, 3)), random.normal(0, 0.01, 3)
    )
    target = transform(rotation_by_vector(random.normal(0, 0.03, 3)), random.normal(0, 0.01, 3))
    poses = hands(random, number, lean)
    seen = [sighting(inverse(camera) @ hand @ target, random) for hand in poses]
    return poses, seen, camera, target


@pytest.mark.parametrize("seed", range(12))
def test_a_hidden_pose_of_the_camera_is_recovered_as_well_as_its_covariance_says(seed: int) -> None:
    poses, seen, camera, _ = problem(seed, 12)
    believed = transform(np.diag([1.0, -1.0, -1.0]), (0.45, 0.2, 1.0))
    found = fit_camera_calibration(poses, seen, CAMERA, believed, np.eye(4))
    metres, radians = difference(found.T_world_camera, camera)
    assert metres < 0.004
    assert radians < np.radians(0.3)
    assert 0.4 < found.misfit < 2.0
    error = np.concatenate(
        [
            camera[:3, 3] - found.T_world_camera[:3, 3],
            rotation_vector(camera[:3, :3] @ found.T_world_camera[:3, :3].T),
        ]
    )
    assert (
        error @ np.linalg.solve(found.covariance[:6, :6], error) < 25.0
    )  # of a chi square with 6 degrees of freedom


def test_a_hand_that_never_turns_does_not_tell_where_the_camera_stands() -> None:
    poses, seen, _, _ = problem(1, 8, lean=0.0)
    with pytest.raises(ValueError, match="turned too little"):
        fit_camera_calibration(
            poses, seen, CAMERA, transform(np.diag([1.0, -1.0, -1.0]), (0.45, 0.2, 1.0)), np.eye(4)
        )


def test_two_sightings_are_too_few() -> None:
    poses, seen, camera, target = problem(1, 2)
    with pytest.raises(ValueError, match="3 are needed"):
        fit_camera_calibration(poses, seen, CAMERA, camera, target)
