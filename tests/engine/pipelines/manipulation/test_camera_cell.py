"""What a camera does in a run: it is calibrated, checked and used, and what it was found to be
is kept.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import difference, rotation_by_vector, transform
from cellwright.engine.model.vision import DepthCamera, LocatedPart, PoseHypothesis
from cellwright.engine.pipelines.manipulation.camera_cell import RunCamera
from cellwright.engine.pipelines.manipulation.camera_optics import CameraErrors, CameraOptics
from cellwright.engine.pipelines.manipulation.scene_camera import (
    add_camera_doubt,
    camera_of,
    camera_pose,
    correct_depths,
)
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.calibration_file import calibration_text, load_calibration
from cellwright.kb.loader.scene_file import load_scene
from cellwright.kb.model.part_scene import CameraFound
from cellwright.kb.targets import BUNDLED_DOMAINS

SCENE = load_scene(BUNDLED_DOMAINS / "handey" / "scene.yaml")
WORLD = GeometricWorld.of(SCENE.cell)
OFF = CameraErrors((0.006, -0.004, 0.003), (0.004, -0.006, 0.01), 1.003, (1.2, -0.8), 0.004, 1.003)


def seeing(errors: CameraErrors, keep: Path | None = None) -> RunCamera:
    return RunCamera(SCENE, CameraOptics.of(SCENE, errors), lambda: WORLD, seed=1, keep=keep)


def found(text: str, name: str) -> list[int]:
    head, _, rest = text.partition("(")
    assert head == name
    return [int(each) for each in rest.rstrip(")").split(",")]


def test_a_calibration_is_read_as_it_was_written(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    T = transform(rotation_by_vector(random.normal(size=3)), random.normal(size=3))
    rows = tuple(tuple(map(float, row)) for row in T)
    covariance = tuple(tuple(map(float, row)) for row in np.diag(random.random(9)))
    known = CameraFound(rows, 1001.5, (319.0, 241.25), covariance, 0.003, 1.002, 0.0012)
    (tmp_path / "kept.json").write_text(calibration_text(known))
    assert load_calibration(tmp_path / "kept.json") == known


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"focal_px": 1000.0', '"focal_px": -1.0', "above zero"),
        ('"focal_px": 1000.0', '"focal_px": null', "no number"),
        ('"centre_px"', '"center"', "has the keys"),
        ("1.0,\n   0.0,\n   0.0,\n   0.5", "2.0,\n   0.0,\n   0.0,\n   0.5", "no pose"),
        ("{", "[", "no JSON"),
    ],
)
def test_a_calibration_that_cannot_be_one_is_refused(
    old: str, new: str, said: str, tmp_path: Path
) -> None:
    rows = tuple(tuple(map(float, row)) for row in transform(np.eye(3), (0.5, 0.0, 1.0)))
    text = calibration_text(CameraFound(rows, 1000.0, (320.0, 240.0), ((0.0,) * 9,) * 9))
    assert old in text
    (tmp_path / "kept.json").write_text(text.replace(old, new, 1))
    with pytest.raises(InvalidInput, match=said):
        load_calibration(tmp_path / "kept.json")


def seen_at(T_camera_part: Floats) -> LocatedPart:
    return LocatedPart(
        PoseHypothesis(T_camera_part, 1.0, 1.0, 1.0, 1000, 1000.0),
        np.zeros((6, 6)),
        (T_camera_part,),
        None,
    )


def test_what_is_doubted_of_a_camera_is_doubted_of_what_it_sees() -> None:
    """The covariance agrees with that of poses that are drawn, and read with drawn cameras."""
    random = np.random.default_rng(0)
    camera, T_world_camera = camera_of(SCENE), camera_pose(SCENE, WORLD)
    T = transform(rotation_by_vector(np.array([0.2, -0.1, 0.7])), (0.11, -0.07, 0.9))
    sigma = np.array([1e-3, 2e-3, 5e-4, 1e-3, 2e-3, 3e-3, 2.0, 1.0, 1.5])
    drawn = []
    for x in random.normal(size=(4000, 9)) * sigma:
        lens = DepthCamera(
            camera.width,
            camera.height,
            camera.focal_px + x[6],
            (camera.centre_px[0] + x[7], camera.centre_px[1] + x[8]),
        )
        u, v = camera.pixels(T[:3, 3])
        p = lens.rays(u, v) * T[2, 3]
        R = rotation_by_vector(x[3:6]) @ T_world_camera[:3, :3]
        at = R @ p + T_world_camera[:3, 3] + x[:3]
        back = T_world_camera[:3, :3].T @ (at - T_world_camera[:3, 3])
        drawn.append(back - T[:3, 3])
    found_it = add_camera_doubt(seen_at(T), camera, T_world_camera, np.diag(sigma**2))
    assert isinstance(found_it, LocatedPart)
    expected = np.cov(np.array(drawn).T)
    assert np.abs(found_it.covariance[:3, :3] - expected).max() < 0.1 * expected.max()
    turns = T_world_camera[:3, :3].T @ np.diag(sigma[3:6] ** 2) @ T_world_camera[:3, :3]
    assert np.allclose(found_it.covariance[3:, 3:], turns)


def test_a_range_finder_is_calibrated_and_its_images_are_corrected(tmp_path: Path) -> None:
    camera = seeing(CameraErrors(offset_m=0.004, scale=1.003), tmp_path / "kept.json")
    assert not camera.range_is_true()
    offset, scale, noise = found(camera.calibrate_range(), "range")
    assert abs(offset - 4000) < 300
    assert abs(scale - 1_003_000) < 300
    assert 900 < noise < 1100
    assert camera.range_is_true()
    exact = CameraOptics.of(SCENE).image(WORLD, 7)
    image = correct_depths(camera.scene, camera.image())
    both = (exact > 0) & (image.depth > 0)
    assert abs(float(np.median((image.depth - exact)[both]))) < 0.0003
    assert load_calibration(tmp_path / "kept.json") == camera.scene.calibrated


@pytest.mark.slow
def test_a_camera_that_was_moved_is_found_out_and_calibrated() -> None:
    camera = seeing(OFF)
    found(camera.calibrate_range(), "range")
    assert camera.check_camera() == "displaced"
    focal, column, row, within = found(camera.calibrate_camera(), "camera")
    true = camera.optics
    metres, radians = difference(camera_pose(camera.scene, WORLD), true.T_world_camera)
    assert metres < 0.0005
    assert radians < np.radians(0.05)
    assert abs(focal / 1000 - true.camera.focal_px) < 1.0
    assert np.abs(np.array([column, row]) / 1000 - true.camera.centre_px).max() < 1.5
    assert within < 1000
    assert found(camera.check_camera(), "off")[0] < 1000


def test_a_depth_map_is_kept(tmp_path: Path) -> None:
    camera = replace(seeing(CameraErrors()), maps=tmp_path / "maps")
    number, seen = found(camera.take_depth_map(), "map")
    kept = np.load(tmp_path / "maps" / f"map_{number}.npy")
    assert round(1000 * float((kept > 0).mean())) == seen
