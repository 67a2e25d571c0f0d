"""Calibration of a range camera: its errors, its intrinsics, and its pose in the arm's world.

The range finder is shown a flat plate at known distances. For its pose the arm holds a known target
at known poses of the hand; where the target sits in the hand is found out, too (robot-world and
hand-eye calibration, AX = YB; Dornaika & Horaud 1998).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import inverse, rotation_by_vector, rotation_vector, transform
from cellwright.engine.model.vision import DepthCamera, DepthImage, LocatedPart

MIN_CALIBRATION_IMAGES = 3  # poses of the hand, distances of the plate, or pixels that show it
FOCAL_SIGMA, CENTRE_SIGMA_PX = 0.01, 3.0  # what is doubted of the maker's intrinsics
# of the normal equations: beyond it, rounding decides what the images do not tell
MAX_CONDITION = 3e13


@dataclass(frozen=True, slots=True, eq=False)
class RangeCalibration:
    """A measured depth is `offset_m` + `scale` times the true one; `covariance` (2, 2) is that of
    both.

    `noise_m` is the standard deviation of one depth, `dropouts` the share of the pixels without
    one.
    """

    offset_m: float
    scale: float
    covariance: Floats
    noise_m: float
    dropouts: float

    def corrected(self, image: DepthImage) -> DepthImage:
        """An image with true depths."""
        depth = np.where(image.depth > 0, (image.depth - self.offset_m) / self.scale, 0.0)
        return DepthImage(image.camera, np.maximum(depth, 0.0), self.noise_m / self.scale)


def fit_range_calibration(
    images: Sequence[DepthImage], distances_m: Sequence[float]
) -> RangeCalibration:
    """What a range finder errs by, from images of a flat plate across its axis at known distances.

    The plate fills the picture, and may lean a little. Raises `ValueError` for fewer than three
    different distances, and for an image without a plate.
    """
    true = np.array(distances_m, dtype=float)
    if len(set(true.tolist())) < MIN_CALIBRATION_IMAGES:
        raise ValueError(f"at least {MIN_CALIBRATION_IMAGES} different distances are needed")
    for number, image in enumerate(images, 1):
        if np.count_nonzero(image.depth > 0) < MIN_CALIBRATION_IMAGES:
            raise ValueError(f"image {number} shows no plate")
    plates = [_plate_depth(image) for image in images]
    middle, rest = (np.array([plate[n] for plate in plates]) for n in (0, 1))
    A = np.stack([np.ones(len(true)), true], axis=1)
    noise = float(np.sqrt((rest**2).mean()))
    (offset, scale), *_ = np.linalg.lstsq(A, middle, rcond=None)
    own = noise**2 / np.mean([plate[2] for plate in plates])
    variance = float(((middle - A @ [offset, scale]) ** 2).sum()) / max(len(true) - 2, 1)
    covariance = np.linalg.inv(A.T @ A) * max(own, variance)
    lost = float(np.mean([(image.depth <= 0).mean() for image in images]))
    return RangeCalibration(float(offset), float(scale), covariance, noise, lost)


def _plate_depth(image: DepthImage) -> tuple[float, float, int]:
    """The depth of a plate on the axis of the camera, the standard deviation beside it, and the
    number of pixels seen.
    """
    v, u = np.nonzero(image.depth > 0)
    depth = image.depth[v, u]
    rays = image.camera.rays(u.astype(float), v.astype(float))
    # On a plane the inverse depth is linear in the picture, whichever way the plane leans.
    A = np.stack([np.ones(len(u)), rays[:, 0], rays[:, 1]], axis=1)
    coefficients, *_ = np.linalg.lstsq(A, 1.0 / depth, rcond=None)
    return 1.0 / float(coefficients[0]), float((depth - 1.0 / (A @ coefficients)).std()), len(u)


@dataclass(frozen=True, slots=True, eq=False)
class CameraCalibration:
    """Where a camera stands: `T_world_camera`, its own `camera` (intrinsics), and where the target
    sat in the hand: `T_hand_target`.

    `covariance` (9, 9) is that of a displacement of the camera (m) and of its turn (rad) about its
    own origin, along the axes of the world, and of its focal length and centre (pixels). `misfit`
    is the mean square of what is left, in its own standard deviations: about 1 if all is as
    assumed.
    """

    T_world_camera: Floats
    T_hand_target: Floats
    camera: DepthCamera
    covariance: Floats
    misfit: float
    images: int


def fit_camera_calibration(
    T_world_hand: Sequence[Floats],
    sightings: Sequence[LocatedPart],
    camera: DepthCamera,
    T_world_camera: Floats,
    T_hand_target: Floats,
    nominal: DepthCamera | None = None,
) -> CameraCalibration:
    """The pose and the intrinsics of a camera from sightings of a target in the hand, beginning
    with what is believed of them.

    The sightings were made with the intrinsics of `camera`. The true ones are sought near those of
    `made`, as the maker tells them (`camera` if left out): within about 1 % and 3 pixels. Raises
    `ValueError` for fewer than three poses of the hand, or if these turn too little to tell.
    """
    if len(sightings) < MIN_CALIBRATION_IMAGES:
        raise ValueError(
            f"the target was found at {len(sightings)} poses of the hand; "
            f"{MIN_CALIBRATION_IMAGES} are needed"
        )
    weights = [np.linalg.inv(np.linalg.cholesky(sighting.covariance)) for sighting in sightings]
    believed, nominal_intrinsics = _camera_intrinsics(camera), _camera_intrinsics(nominal or camera)
    likely = np.array([nominal_intrinsics[0] * FOCAL_SIGMA, CENTRE_SIGMA_PX, CENTRE_SIGMA_PX])

    def rest(x: Floats) -> Floats:
        back, target = (
            inverse(_displace_pose(T_world_camera, x[:6])),
            _displace_pose(T_hand_target, x[6:12]),
        )
        lens = believed + likely * x[12:]
        return np.concatenate(
            [
                *(
                    weight
                    @ _pose_difference(
                        _as_seen(back @ hand @ target, lens, believed), sighting.best.T_camera_part
                    )
                    for hand, sighting, weight in zip(T_world_hand, sightings, weights, strict=True)
                ),
                (lens - nominal_intrinsics) / likely,
            ]
        )

    solved = least_squares(rest, np.zeros(15), x_scale="jac")
    misfit = float(2 * solved.cost / max(6 * len(sightings) - 12, 1))
    covariance = _pose_covariance(solved.jac, np.concatenate([np.ones(6), likely])) * max(
        misfit, 1.0
    )
    focal, *centre = believed + likely * solved.x[12:]
    lens = replace(camera, focal_px=float(focal), centre_px=(float(centre[0]), float(centre[1])))
    T_camera, T_target = (
        _displace_pose(T_world_camera, solved.x[:6]),
        _displace_pose(T_hand_target, solved.x[6:12]),
    )
    return CameraCalibration(T_camera, T_target, lens, covariance, misfit, len(sightings))


def _pose_covariance(jacobian: Floats, units: Floats) -> Floats:
    """The covariance (9, 9) of pose and intrinsics, in their `units` (9,).

    Raises `ValueError` if the images do not tell them.
    """
    information = jacobian.T @ jacobian
    if np.linalg.cond(information) > MAX_CONDITION:
        raise ValueError(
            "the hand turned too little between the images to tell where the camera stands"
        )
    determined = [*range(6), *range(12, 15)]
    covariance: Floats = np.linalg.inv(information)[np.ix_(determined, determined)] * np.outer(
        units, units
    )
    return covariance


def _camera_intrinsics(camera: DepthCamera) -> Floats:
    """The focal length and the centre (3,) in pixels."""
    return np.array([camera.focal_px, *camera.centre_px])


def _as_seen(T: Floats, lens: Floats, believed: Floats) -> Floats:
    """Where a body at T_camera_body (4, 4) seems to be if its picture is read with other
    intrinsics than those that it was made by.
    """
    distorted = T.copy()
    pixel = lens[0] * T[:2, 3] / T[2, 3] + lens[1:]
    distorted[:2, 3] = (pixel - believed[1:]) / believed[0] * T[2, 3]
    return distorted


def _displace_pose(T: Floats, x: Floats) -> Floats:
    """A pose that is displaced by x[:3], and turned about its own origin by the vector x[3:]."""
    return transform(rotation_by_vector(x[3:]) @ T[:3, :3], T[:3, 3] + x[:3])


def _pose_difference(expected: Floats, seen: Floats) -> Floats:
    """The displacement and turn (6,) between two poses, along the axes of the camera."""
    return np.concatenate(
        [expected[:3, 3] - seen[:3, 3], rotation_vector(expected[:3, :3] @ seen[:3, :3].T)]
    )
