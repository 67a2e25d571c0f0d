"""Distances and angles between two fitted shapes, with their uncertainty: step heights, gaps, pitches of bores, how parallel or square things are."""

import math

import numpy as np

from cellwright.engine.model.fits import PARAMETERS, Fit, Related, Shape
from cellwright.engine.model.geometry import Floats

AXIAL = (Shape.PLANE, Shape.CYLINDER, Shape.CONE, Shape.CIRCLE)  # they have a direction
CENTRED = (Shape.SPHERE, Shape.CIRCLE)  # they have a place in every direction
LONG = (Shape.CYLINDER, Shape.CONE)  # they have an axis without a place along it
PARALLEL = math.sin(
    math.radians(10.0)
)  # an axis that leans more meets the other shape, and has no distance from it
SAME = 1e-12  # m or rad: closer, no direction leads from one to the other
MIDDLE = {
    Shape.PLANE: "second's middle",
    Shape.SPHERE: "centre",
    Shape.CIRCLE: "centre",
    Shape.CYLINDER: "axis",
    Shape.CONE: "axis",
}


def between(one: Fit, other: Fit) -> tuple[Related, ...]:
    """What can be said of the two: the distance from a plane or an axis, from centre to centre, the angle between their directions."""
    found = [] if (distance := _distance(one, other)) is None else [distance]
    if one.shape in AXIAL and other.shape in AXIAL:
        found.append(_angle(one, other))
    return tuple(found)


def _distance(one: Fit, other: Fit) -> Related | None:
    """Of a plane and something else it is from the plane, of an axis and something else from the axis."""
    for first, second in ((one, other), (other, one)):
        leaning = second.shape in LONG and abs(float(first.axis @ second.axis)) > PARALLEL
        if first.shape is Shape.PLANE:
            return None if leaning else _from_plane(first, second)
    for first, second in ((one, other), (other, one)):
        across = second.shape in LONG and np.linalg.norm(np.cross(first.axis, second.axis)) > PARALLEL
        if first.shape in LONG:
            return None if across else _from_axis(first, second)
    return _centres(one, other)


def _from_plane(plane: Fit, other: Fit) -> Related:
    """How far the origin of the other shape lies from the plane, in m; of a plane or an axis, that is amid its points."""
    x, y, z = plane.T_world_shape[:3, :3].T @ (other.origin - plane.origin)
    own = np.array([-1.0, x, y]) @ plane.covariance @ np.array([-1.0, x, y])
    told = f"of the {MIDDLE[other.shape]} from the {'first ' if other.shape is Shape.PLANE else ''}plane"
    sigma = math.sqrt(float(own) + _placed(other, plane.axis))
    return Related("distance", abs(float(z)), sigma, told)


def _from_axis(axial: Fit, other: Fit) -> Related:
    """How far the origin of the other shape lies from the axis, in m; of another axis, that is amid its points."""
    x, y, z = axial.T_world_shape[:3, :3].T @ (other.origin - axial.origin)
    length = math.hypot(x, y)
    u, v = (x / length, y / length) if length > SAME else (1.0, 0.0)
    names = PARAMETERS[axial.shape]
    by = np.zeros(len(names))
    for name, slope in (("x", u), ("y", v), ("tilt_x", z * u), ("tilt_y", z * v)):
        by[names.index(name)] = slope
    own = float(by @ axial.covariance @ by)
    along = axial.T_world_shape[:3, :2] @ np.array([u, v])
    told = "of the axes" if other.shape in LONG else "of the centre from the axis"
    return Related("distance", length, math.sqrt(own + _placed(other, along)), told)


def _centres(one: Fit, other: Fit) -> Related:
    apart = other.origin - one.origin
    length = float(np.linalg.norm(apart))
    along = apart / length if length > SAME else np.array([0.0, 0.0, 1.0])
    sigma = math.sqrt(_placed(one, along) + _placed(other, along))
    return Related("distance", length, sigma, "of the centres")


def _placed(fit: Fit, along: Floats) -> float:
    """The variance of a shape's origin along a direction (3,) of the world, as far as the shape has a place in it."""
    local = fit.T_world_shape[:3, :3].T @ along
    names = PARAMETERS[fit.shape]
    kept = [(axis, names.index(name)) for axis, name in enumerate("xyz") if name in names]
    by, places = local[[axis for axis, _ in kept]], [place for _, place in kept]
    return float(by @ fit.covariance[np.ix_(places, places)] @ by)


def _angle(one: Fit, other: Fit) -> Related:
    """The angle between two directions, at most a right one, in rad."""
    facing = float(one.axis @ other.axis)
    across = np.cross(one.axis, other.axis)
    sine = float(np.linalg.norm(across))
    turn = across / sine if sine > SAME else one.T_world_shape[:3, 0]
    sigma = math.sqrt(_turned(one, turn) + _turned(other, turn))
    return Related("angle", math.atan2(sine, abs(facing)), sigma, _directions(one, other))


def _directions(one: Fit, other: Fit) -> str:
    """Whose directions an angle is between."""
    names = ["axis" if each.shape in LONG else "normal" for each in (one, other)]
    if names[0] == names[1]:
        return "of the axes" if names[0] == "axis" else "of the normals"
    return "of the axis and the normal"


def _turned(fit: Fit, about: Floats) -> float:
    """The variance of a turn of a shape's z axis about a direction (3,) square to it."""
    names = PARAMETERS[fit.shape]
    tilts = [names.index("tilt_x"), names.index("tilt_y")]
    x, y, _ = fit.T_world_shape[:3, :3].T @ np.cross(about, fit.axis)
    return float(np.array([x, y]) @ fit.covariance[np.ix_(tilts, tilts)] @ np.array([x, y]))
