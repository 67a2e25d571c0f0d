"""What a calibration answers, as text and as content for JSON."""

from typing import Any

import numpy as np

from cellwright.engine.formats.report.placing import pose
from cellwright.engine.kernels.rigid import difference
from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.placing.optics import Optics
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.vision.calibration import CameraCalibration, RangeCalibration


def range_text(found: RangeCalibration, hidden: tuple[float, float] | None) -> str:
    """What a range finder errs by, for people."""
    own = 3 * np.sqrt(np.diag(found.covariance))
    lines = [
        f"a measured depth is {1000 * found.offset_m:.2f} mm (within {1000 * own[0]:.2f}) and {found.scale:.5f} times "
        f"(within {own[1]:.5f}) the true one",
        f"noise {1000 * found.noise_m:.2f} mm, {found.dropouts:.1%} of the pixels without a depth",
    ]
    if hidden is not None:
        lines.append(f"hidden were {1000 * hidden[0]:.2f} mm and {hidden[1]:.5f}")
    return "\n".join(lines)


def range_content(found: RangeCalibration) -> dict[str, Any]:
    """The same for JSON: metres."""
    return {
        "offset_m": found.offset_m,
        "scale": found.scale,
        "covariance": found.covariance.tolist(),
        "noise_m": found.noise_m,
        "dropouts": found.dropouts,
    }


def camera_text(found: CameraCalibration, believed: Floats, hidden: Optics | None) -> str:
    """Where a camera stands, for people, and the line that says it in a scene file."""
    own = 3 * np.sqrt(np.diag(found.covariance))
    lens = found.camera
    metres, radians = difference(believed, found.T_world_camera)
    at = transforms.to_pose(found.T_world_camera)
    place = ", ".join(f"{1000 * x:.3f}" for x in at.position_m)
    turn = ", ".join(f"{np.degrees(x):.4f}" for x in at.rpy_rad)
    lines = [
        f"the camera stands at {pose(found.T_world_camera)}",
        f"within {1000 * own[:3].max():.2f} mm and {np.degrees(own[3:6].max()):.3f} degrees (three standard deviations), from "
        f"{found.images} images",
        f"its focal length is {lens.focal_px:.2f} pixels (within {own[6]:.2f}), its centre at {lens.centre_px[0]:.2f}, "
        f"{lens.centre_px[1]:.2f} (within {own[7:].max():.2f})",
        f"that is {1000 * float(metres):.1f} mm and {np.degrees(float(radians)):.2f} degrees from where the scene has it",
        f"what is left is {np.sqrt(found.misfit):.1f} times what the images' own errors explain",
        f"in the scene: camera: {{at: [{place}], rpy: [{turn}]}}, in mm and degrees of the world",
    ]
    if hidden is not None:
        metres, radians = difference(hidden.T_world_camera, found.T_world_camera)
        lines.append(
            f"hidden was a pose {1000 * float(metres):.2f} mm and {np.degrees(float(radians)):.3f} degrees from this one, "
            f"and a focal length of {hidden.camera.focal_px:.2f} pixels"
        )
    return "\n".join(lines)


def camera_content(found: CameraCalibration) -> dict[str, Any]:
    """The same for JSON: metres and radians, poses as rows of matrices."""
    return {
        "T_world_camera": found.T_world_camera.tolist(),
        "T_hand_target": found.T_hand_target.tolist(),
        "focal_px": found.camera.focal_px,
        "centre_px": list(found.camera.centre_px),
        "covariance": found.covariance.tolist(),
        "misfit": found.misfit,
        "images": found.images,
    }
