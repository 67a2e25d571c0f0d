"""Fitting: measured points, shapes fitted to them, alignments, and their uncertainty. m, rad."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.rigid import skew


class FitShape(StrEnum):
    """The shapes that can be fitted."""

    PLANE = "plane"
    SPHERE = "sphere"
    CYLINDER = "cylinder"
    CONE = "cone"
    CIRCLE = "circle"


# What can vary in the frame of a fitted shape, in the order of its covariance. Tilts are slopes of
# the z axis.
SHAPE_PARAMETERS: dict[FitShape, tuple[str, ...]] = {
    FitShape.PLANE: ("z", "tilt_x", "tilt_y"),
    FitShape.SPHERE: ("x", "y", "z", "radius"),
    FitShape.CYLINDER: ("x", "y", "tilt_x", "tilt_y", "radius"),
    FitShape.CONE: ("x", "y", "tilt_x", "tilt_y", "radius", "angle"),
    FitShape.CIRCLE: ("x", "y", "z", "tilt_x", "tilt_y", "radius"),
}


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Measured points (n, 3), and the standard deviation (n,) of each.

    `directions` (n, 3), unit vectors, are the beams along which the deviations count; None: they
    count in every direction. `beam_m` (n,) is the standard deviation of the intensity across each
    beam, where it is wide enough to matter. `pointing_m` (n,) is how far beside its direction each
    beam points, the standard deviation in each of the two directions across it; `sigma_m` does not
    hold what follows from it. `range_m` (n,) is how far each point is from where its beam starts;
    None: the beams do not spread.
    """

    points: Floats
    sigma_m: Floats
    directions: Floats | None = None
    beam_m: Floats | None = None
    pointing_m: Floats | None = None
    range_m: Floats | None = None


def why_unfittable(points: Floats, sigma_m: Floats) -> str | None:
    """Why nothing can be fitted to measured points (n, 3) with standard deviations (n,); None
    if something can.
    """
    if not (np.isfinite(points).all() and np.isfinite(sigma_m).all()):
        return "a coordinate or a standard deviation is not a number"
    if not (sigma_m > 0).all():
        return "each point needs a standard deviation of more than 0"
    return None


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A shape at T_world_shape (4, 4), its covariance in its own frame, and the points (n,) that it
    was fitted to.

    The z axis is the normal of a plane or circle, and the axis of a cylinder or cone. The origin is
    amid the points: on the plane, at the centre of the sphere or circle, on the axis. `radius_m` is
    that at the origin. A cone widens along z by the tangent of `angle_rad`. `chi2` over `freedom`
    is about 1 where the points deviate as their standard deviations say.
    """

    shape: FitShape
    T_world_shape: Floats
    radius_m: float
    angle_rad: float
    covariance: Floats
    used: Truths
    chi2: float
    freedom: int

    @property
    def origin(self) -> Floats:
        """The origin (3,) of its frame."""
        origin: Floats = self.T_world_shape[:3, 3]
        return origin

    @property
    def axis(self) -> Floats:
        """The z axis (3,) of its frame."""
        direction: Floats = self.T_world_shape[:3, 2]
        return direction

    def deviation(self, parameter: str) -> float:
        """The standard deviation of one of its parameters.

        Raises `ValueError` for one that the shape does not have.
        """
        number = SHAPE_PARAMETERS[self.shape].index(parameter)
        return math.sqrt(float(self.covariance[number, number]))


@dataclass(frozen=True, slots=True)
class Unfitted:
    """No shape can be fitted, and why."""

    reason: str


Fitting: TypeAlias = Fit | Unfitted


@dataclass(frozen=True, slots=True)
class Related:
    """A distance (m) or an angle (rad) between two fitted shapes, its standard deviation, and
    of what it is.
    """

    what: str
    value: float
    sigma: float
    of: str


@dataclass(frozen=True, slots=True, eq=False)
class Datums:
    """Where a part should be touched, and where it was: nominal points and outward normals (n, 3),
    measured points (n, 3), by name.

    `sigma_m` (n,) are standard deviations, in every direction. Where `whole` (n,), the measured
    point is the nominal point of the part itself; elsewhere it only lies on the same surface.
    """

    names: tuple[str, ...]
    nominal: Floats
    normals: Floats
    measured: Floats
    sigma_m: Floats
    whole: Truths


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Where the part is: T_measured_nominal (4, 4), fitted to the datums `used` (n,).

    `covariance` (6, 6) is that of a shift and a turn about `centre` (3,), a point of the part in
    its nominal place. `off` (n,) is how far each datum is off, by its standard deviations.
    """

    T_measured_nominal: Floats
    centre: Floats
    covariance: Floats
    used: Truths
    off: Floats
    chi2: float
    freedom: int

    @property
    def turn_sigma_rad(self) -> float:
        """The standard deviation of the turn about its least known axis."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1]))

    def sigma_at(self, points: Floats) -> Floats:
        """The standard deviations (n,) of where points (n, 3) of the part are, each in its
        least known direction.
        """
        from_centre = points - self.centre
        by = np.concatenate(
            [np.broadcast_to(np.eye(3), (len(points), 3, 3)), -skew(from_centre)], axis=2
        )
        sigmas: Floats = np.sqrt(
            np.linalg.eigvalsh(by @ self.covariance @ np.swapaxes(by, 1, 2))[:, -1]
        )
        return sigmas


@dataclass(frozen=True, slots=True)
class Unaligned:
    """No alignment holds, and why. `off` names the datums that disagree, where that is known."""

    reason: str
    off: tuple[str, ...] = ()


Aligning: TypeAlias = Alignment | Unaligned
