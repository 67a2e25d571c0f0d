"""Distances and angles between two fitted shapes, with their uncertainty: step heights, gaps, and how parallel or square things are."""

import math

import numpy as np

from engine.model.fits import PARAMETERS, Fit, Related, Shape
from engine.model.geometry import Floats

AXIAL = (Shape.PLANE, Shape.CYLINDER, Shape.CONE, Shape.CIRCLE)  # they have a direction
CENTRED = (Shape.SPHERE, Shape.CIRCLE)  # they have a place in every direction
SAME = 1e-12  # m or rad: closer, no direction leads from one to the other


def between(one: Fit, other: Fit) -> tuple[Related, ...]:
    """What can be said of the two: the distance from a plane, from centre to centre, the angle between their directions."""
    found = []
    if one.shape is Shape.PLANE and other.shape in (Shape.PLANE, *CENTRED):
        found.append(_from_plane(one, other))
    elif other.shape is Shape.PLANE and one.shape in CENTRED:
        found.append(_from_plane(other, one))
    elif one.shape in CENTRED and other.shape in CENTRED:
        found.append(_centres(one, other))
    if one.shape in AXIAL and other.shape in AXIAL:
        found.append(_angle(one, other))
    return tuple(found)


def _from_plane(plane: Fit, other: Fit) -> Related:
    """How far the origin of the other shape lies from the plane, in m; of a plane, that is amid its points."""
    x, y, z = plane.T_world_shape[:3, :3].T @ (other.origin - plane.origin)
    own = np.array([-1.0, x, y]) @ plane.covariance @ np.array([-1.0, x, y])
    along = other.T_world_shape[:3, :3].T @ plane.axis
    places = [PARAMETERS[other.shape].index(each) for each in "xyz" if each in PARAMETERS[other.shape]]
    by = along[2:] if other.shape is Shape.PLANE else along
    others = by @ other.covariance[np.ix_(places, places)] @ by
    return Related("distance", abs(float(z)), math.sqrt(float(own + others)))


def _centres(one: Fit, other: Fit) -> Related:
    apart = other.origin - one.origin
    length = float(np.linalg.norm(apart))
    along = apart / length if length > SAME else np.array([0.0, 0.0, 1.0])
    return Related("distance", length, math.sqrt(_placed(one, along) + _placed(other, along)))


def _placed(fit: Fit, along: Floats) -> float:
    """The variance of a centre along a direction (3,)."""
    local = fit.T_world_shape[:3, :3].T @ along
    return float(local @ fit.covariance[:3, :3] @ local)


def _angle(one: Fit, other: Fit) -> Related:
    """The angle between two directions, at most a right one, in rad."""
    facing = float(one.axis @ other.axis)
    across = np.cross(one.axis, other.axis)
    sine = float(np.linalg.norm(across))
    turn = across / sine if sine > SAME else one.T_world_shape[:3, 0]
    return Related(
        "angle", math.atan2(sine, abs(facing)), math.sqrt(_turned(one, turn) + _turned(other, turn))
    )


def _turned(fit: Fit, about: Floats) -> float:
    """The variance of a turn of a shape's z axis about a direction (3,) square to it."""
    names = PARAMETERS[fit.shape]
    tilts = [names.index("tilt_x"), names.index("tilt_y")]
    x, y, _ = fit.T_world_shape[:3, :3].T @ np.cross(about, fit.axis)
    return float(np.array([x, y]) @ fit.covariance[np.ix_(tilts, tilts)] @ np.array([x, y]))
