"""Calibrations of a range finder and of a camera, as text and as data."""

from typing import Any

import numpy as np

from cellwright.engine.formats.report.cells.placing_report import pose_text
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import difference
from cellwright.engine.pipelines.manipulation.camera_optics import CameraOptics
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.vision.sensor_calibration import CameraCalibration, RangeCalibration


def range_text(range_calibration: RangeCalibration, hidden: tuple[float, float] | None) -> str:
    """What a range finder errs by, for people."""
    own = 3 * np.sqrt(np.diag(range_calibration.covariance))
    lines = [
        f"a measured depth is {1000 * range_calibration.offset_m:.2f} mm (within "
        f"{1000 * own[0]:.2f}) and {range_calibration.scale:.5f} times "
        f"(within {own[1]:.5f}) the true one",
        f"noise {1000 * range_calibration.noise_m:.2f} mm, {range_calibration.dropouts:.1%} of "
        "the pixels without a depth",
    ]
    if hidden is not None:
        lines.append(f"hidden were {1000 * hidden[0]:.2f} mm and {hidden[1]:.5f}")
    return "\n".join(lines)


def range_content(range_calibration: RangeCalibration) -> dict[str, Any]:
    """The same for JSON: metres."""
    return {
        "offset_m": range_calibration.offset_m,
        "scale": range_calibration.scale,
        "covariance": range_calibration.covariance.tolist(),
        "noise_m": range_calibration.noise_m,
        "dropouts": range_calibration.dropouts,
    }


def camera_text(
    camera_calibration: CameraCalibration, believed: Floats, hidden: CameraOptics | None
) -> str:
    """Where a camera stands, for people, and the line that says it in a scene file."""
    own = 3 * np.sqrt(np.diag(camera_calibration.covariance))
    lens = camera_calibration.camera
    metres, radians = difference(believed, camera_calibration.T_world_camera)
    at = transforms.to_pose(camera_calibration.T_world_camera)
    place = ", ".join(f"{1000 * x:.3f}" for x in at.position_m)
    turn = ", ".join(f"{np.degrees(x):.4f}" for x in at.rpy_rad)
    lines = [
        f"the camera stands at {pose_text(camera_calibration.T_world_camera)}",
        f"within {1000 * own[:3].max():.2f} mm and {np.degrees(own[3:6].max()):.3f} degrees "
        "(three standard deviations), from "
        f"{camera_calibration.images} images",
        f"its focal length is {lens.focal_px:.2f} pixels (within {own[6]:.2f}), its centre at "
        f"{lens.centre_px[0]:.2f}, "
        f"{lens.centre_px[1]:.2f} (within {own[7:].max():.2f})",
        f"that is {1000 * float(metres):.1f} mm and {np.degrees(float(radians)):.2f} degrees "
        "from where the scene has it",
        f"what is left is {np.sqrt(camera_calibration.misfit):.1f} times what the images' own "
        "errors explain",
        f"in the scene: camera: {{at: [{place}], rpy: [{turn}]}}, in mm and degrees of the world",
    ]
    if hidden is not None:
        metres, radians = difference(hidden.T_world_camera, camera_calibration.T_world_camera)
        lines.append(
            f"hidden was a pose {1000 * float(metres):.2f} mm and "
            f"{np.degrees(float(radians)):.3f} degrees from this one, "
            f"and a focal length of {hidden.camera.focal_px:.2f} pixels"
        )
    return "\n".join(lines)


def camera_content(camera_calibration: CameraCalibration) -> dict[str, Any]:
    """The same for JSON: metres and radians, poses as rows of matrices."""
    return {
        "T_world_camera": camera_calibration.T_world_camera.tolist(),
        "T_hand_target": camera_calibration.T_hand_target.tolist(),
        "focal_px": camera_calibration.camera.focal_px,
        "centre_px": list(camera_calibration.camera.centre_px),
        "covariance": camera_calibration.covariance.tolist(),
        "misfit": camera_calibration.misfit,
        "images": camera_calibration.images,
    }
