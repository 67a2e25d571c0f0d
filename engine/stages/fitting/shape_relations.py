"""Distances and angles between two fitted shapes, with their uncertainty."""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.shape_fits import SHAPE_PARAMETERS, Fit, FitShape, Related

SHAPES_WITH_DIRECTION = (
    FitShape.PLANE,
    FitShape.CYLINDER,
    FitShape.CONE,
    FitShape.CIRCLE,
)  # they have a direction
SHAPES_WITH_CENTRE = (FitShape.SPHERE, FitShape.CIRCLE)  # they have a place in every direction
SHAPES_WITH_AXIS = (FitShape.CYLINDER, FitShape.CONE)  # they have an axis without a place along it
PARALLEL_SINE = math.sin(
    math.radians(10.0)
)  # an axis that leans more meets the other shape, and has no distance from it
SAME_PLACE = 1e-12  # m or rad: closer, no direction leads from one to the other
MIDDLE_NAMES = {
    FitShape.PLANE: "second's middle",
    FitShape.SPHERE: "centre",
    FitShape.CIRCLE: "centre",
    FitShape.CYLINDER: "axis",
    FitShape.CONE: "axis",
}


def relate_fits(first: Fit, second: Fit) -> tuple[Related, ...]:
    """What can be said of the two: the distance from a plane or an axis, from centre to centre,
    the angle between their directions.
    """
    relations = [] if (distance := _distance_between(first, second)) is None else [distance]
    if first.shape in SHAPES_WITH_DIRECTION and second.shape in SHAPES_WITH_DIRECTION:
        relations.append(_angle_between(first, second))
    return tuple(relations)


def _distance_between(fit_a: Fit, fit_b: Fit) -> Related | None:
    """Of a plane and something else it is from the plane, of an axis and something else from
    the axis.
    """
    for first, second in ((fit_a, fit_b), (fit_b, fit_a)):
        leaning = (
            second.shape in SHAPES_WITH_AXIS
            and abs(float(first.axis @ second.axis)) > PARALLEL_SINE
        )
        if first.shape is FitShape.PLANE:
            return None if leaning else _from_plane(first, second)
    for first, second in ((fit_a, fit_b), (fit_b, fit_a)):
        across = (
            second.shape in SHAPES_WITH_AXIS
            and np.linalg.norm(np.cross(first.axis, second.axis)) > PARALLEL_SINE
        )
        if first.shape in SHAPES_WITH_AXIS:
            return None if across else _from_axis(first, second)
    return _centre_distance(fit_a, fit_b)


def _from_plane(plane: Fit, second: Fit) -> Related:
    """How far the origin of the other shape lies from the plane, in m; of a plane or an axis,
    that is amid its points.
    """
    x, y, z = plane.T_world_shape[:3, :3].T @ (second.origin - plane.origin)
    own = np.array([-1.0, x, y]) @ plane.covariance @ np.array([-1.0, x, y])
    meaning = (
        f"of the {MIDDLE_NAMES[second.shape]} from the "
        f"{'first ' if second.shape is FitShape.PLANE else ''}plane"
    )
    sigma = math.sqrt(float(own) + _origin_variance(second, plane.axis))
    return Related("distance", abs(float(z)), sigma, meaning)


def _from_axis(axial: Fit, second: Fit) -> Related:
    """How far the origin of the other shape lies from the axis, in m; of another axis, that is
    amid its points.
    """
    x, y, z = axial.T_world_shape[:3, :3].T @ (second.origin - axial.origin)
    length = math.hypot(x, y)
    u, v = (x / length, y / length) if length > SAME_PLACE else (1.0, 0.0)
    names = SHAPE_PARAMETERS[axial.shape]
    by = np.zeros(len(names))
    for name, slope in (("x", u), ("y", v), ("tilt_x", z * u), ("tilt_y", z * v)):
        by[names.index(name)] = slope
    own = float(by @ axial.covariance @ by)
    along = axial.T_world_shape[:3, :2] @ np.array([u, v])
    meaning = "of the axes" if second.shape in SHAPES_WITH_AXIS else "of the centre from the axis"
    return Related("distance", length, math.sqrt(own + _origin_variance(second, along)), meaning)


def _centre_distance(first: Fit, second: Fit) -> Related:
    apart = second.origin - first.origin
    length = float(np.linalg.norm(apart))
    along = apart / length if length > SAME_PLACE else np.array([0.0, 0.0, 1.0])
    sigma = math.sqrt(_origin_variance(first, along) + _origin_variance(second, along))
    return Related("distance", length, sigma, "of the centres")


def _origin_variance(fit: Fit, along: Floats) -> float:
    """The variance of a shape's origin along a direction (3,) of the world, as far as the shape
    has a place in it.
    """
    local = fit.T_world_shape[:3, :3].T @ along
    names = SHAPE_PARAMETERS[fit.shape]
    placed_axes = [(axis, names.index(name)) for axis, name in enumerate("xyz") if name in names]
    by, places = local[[axis for axis, _ in placed_axes]], [place for _, place in placed_axes]
    return float(by @ fit.covariance[np.ix_(places, places)] @ by)


def _angle_between(first: Fit, second: Fit) -> Related:
    """The angle between two directions, at most a right one, in rad."""
    facing = float(first.axis @ second.axis)
    across = np.cross(first.axis, second.axis)
    sine = float(np.linalg.norm(across))
    turn = across / sine if sine > SAME_PLACE else first.T_world_shape[:3, 0]
    sigma = math.sqrt(_tilt_variance(first, turn) + _tilt_variance(second, turn))
    return Related(
        "angle", math.atan2(sine, abs(facing)), sigma, _directions_in_words(first, second)
    )


def _directions_in_words(first: Fit, second: Fit) -> str:
    """Whose directions an angle is between."""
    names = ["axis" if fit.shape in SHAPES_WITH_AXIS else "normal" for fit in (first, second)]
    if names[0] == names[1]:
        return "of the axes" if names[0] == "axis" else "of the normals"
    return "of the axis and the normal"


def _tilt_variance(fit: Fit, about: Floats) -> float:
    """The variance of a turn of a shape's z axis about a direction (3,) square to it."""
    names = SHAPE_PARAMETERS[fit.shape]
    tilts = [names.index("tilt_x"), names.index("tilt_y")]
    x, y, _ = fit.T_world_shape[:3, :3].T @ np.cross(about, fit.axis)
    return float(np.array([x, y]) @ fit.covariance[np.ix_(tilts, tilts)] @ np.array([x, y]))
