"""Dimensions from range images: shapes fitted to patches, the rims of holes, and what is between them, with covariance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.model.fits import PARAMETERS, Cloud, Fit, Fitting, Related, Shape, Unfitted
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.ranging import Edges, RangeImage, Window
from cellwright.engine.pipelines.dimensions.limbs import without_own_limb
from cellwright.engine.stages.fitting.between import between
from cellwright.engine.stages.fitting.surfaces import fitted
from cellwright.engine.stages.vision.edges import edges_of
from cellwright.engine.stages.vision.patches import cloud_of
from cellwright.engine.stages.vision.rims import Rim, rim_of, round_rim


@dataclass(frozen=True, slots=True)
class Asked:
    """A shape that is asked for: where in the picture it is seen. A circle is the rim of a hole or disc in a plane there."""

    name: str
    shape: Shape
    window: Window


@dataclass(frozen=True, slots=True, eq=False)
class Dimensions:
    """What was found of each shape that was asked for, by name, in the frame of the eye; and the edges of the image."""

    fits: dict[str, Fitting]
    edges: Edges


def dimensions(image: RangeImage, asked: Sequence[Asked]) -> Dimensions:
    """Shapes fitted to patches of an image with whole ranges. Raises `ValueError` for an image whose ranges are wrapped."""
    if image.wrapped:
        raise ValueError("the ranges are known modulo half a wavelength: resolve them first")
    edges = edges_of(image)
    return Dimensions({each.name: _found(image, edges, each) for each in asked}, edges)


def related(found: Dimensions, one: str, other: str) -> tuple[Related, ...]:
    """What is between two of the shapes; nothing if one was not found."""
    first, second = found.fits[one], found.fits[other]
    return between(first, second) if isinstance(first, Fit) and isinstance(second, Fit) else ()


def _found(image: RangeImage, edges: Edges, asked: Asked) -> Fitting:
    shape = Shape.PLANE if asked.shape is Shape.CIRCLE else asked.shape
    cloud = cloud_of(image, edges, asked.window)
    found = fitted(shape, cloud)
    if isinstance(found, Fit) and (own := without_own_limb(image, edges, found, cloud)) is not None:
        more = cloud_of(image, own, asked.window)
        again = fitted(shape, more, near=found)
        found, cloud = (again, more) if isinstance(again, Fit) else (found, cloud)
    found = _rounded(found, cloud, image) if isinstance(found, Fit) else found
    return _circle(image, found, asked) if asked.shape is Shape.CIRCLE else found


def _rounded(found: Fit, cloud: Cloud, image: RangeImage) -> Fit:
    """The fit, as sure as rounded depths let it be: all points of one depth were rounded alike, so they count as one."""
    if not image.step_m:
        return found
    depths = np.rint(cloud.points[found.used, 2] / image.step_m)
    alike = len(depths) / len(np.unique(depths))
    own, rounding = float(np.median(cloud.sigma_m)) ** 2, image.rounding_m**2
    return replace(found, covariance=found.covariance * (own + (alike - 1.0) * rounding) / own)


def _circle(image: RangeImage, plane: Fitting, asked: Asked) -> Fitting:
    """The rim of a plane."""
    if image.guessed:
        return Unfitted(
            "a depth image does not tell how strong answers were, and with them how much of a beam met the plane"
        )
    if isinstance(plane, Unfitted):
        return Unfitted(f"a circle is the rim of a plane, and there is none: {plane.reason}")
    offset_m = float(plane.axis @ plane.origin)
    rim = rim_of(image, plane.axis, offset_m, asked.window)
    if rim is None:
        return Unfitted("the plane ends nowhere in the patch")
    first = fitted(Shape.CIRCLE, rim.cloud)
    if isinstance(first, Unfitted):
        return first
    rim = round_rim(image, plane.axis, offset_m, rim, first.origin)
    circle = fitted(Shape.CIRCLE, rim.cloud)
    return _on(plane, circle, rim) if isinstance(circle, Fit) else circle


def _on(plane: Fit, circle: Fit, rim: Rim) -> Fit:
    """A circle on a plane: its height and tilts are those of the plane, which its rim does not tell.

    A round rim seen with a wide beam seems nearer to its centre, by the square of the beam over twice the radius: what is summed
    over a Gaussian spreads as heat does, whose level lines move towards the centre of their curvature. Where a beam points beside its
    direction, along the rim, it seems farther by as much.
    """
    R = plane.T_world_shape[:3, :3]
    T = circle.T_world_shape.copy()
    turn = R.T @ circle.T_world_shape[:3, :3]
    T[:3, :3] = R
    x, y, _ = R.T @ (circle.origin - plane.origin)
    names = PARAMETERS[Shape.CIRCLE]
    flat = [names.index(each) for each in ("x", "y", "radius")]
    own = np.eye(3)
    own[:2, :2] = turn[:2, :2]
    covariance = np.zeros((6, 6))
    covariance[np.ix_(flat, flat)] = own @ circle.covariance[np.ix_(flat, flat)] @ own.T
    # The height of the plane at the centre, and its tilts, by the plane's own height and tilts.
    by: Floats = np.array([[1.0, -x, -y], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    high = [names.index(each) for each in ("z", "tilt_x", "tilt_y")]
    covariance[np.ix_(high, high)] = by @ plane.covariance @ by.T
    radius = circle.radius_m + (rim.beam_m**2 - rim.pointing_m**2) / (2.0 * circle.radius_m)
    return replace(circle, T_world_shape=T, covariance=covariance, radius_m=radius)
