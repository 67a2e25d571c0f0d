"""Dimensions from range images: shapes fitted to patches, rims of holes, and their covariance.

Which pixels lie on such an edge is found from ranges, so it depends on their noise. If these edges
decided which points count, points would be left out because of their errors, and the shape would be
biased. How a shape faces each beam is known from the shape, and the fit leaves out beams that meet
it too flat. So these edges need not be guarded.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply, inverse
from cellwright.engine.model.shape_fits import (
    SHAPE_PARAMETERS,
    Cloud,
    Fit,
    FitShape,
    Fitting,
    Related,
    Unfitted,
)
from cellwright.engine.model.vision import EdgeImage, PixelWindow, RangeImage
from cellwright.engine.stages.fitting.shape_distances import beam_hits
from cellwright.engine.stages.fitting.shape_fit import fit_measured_shape
from cellwright.engine.stages.fitting.shape_relations import relate_fits
from cellwright.engine.stages.vision.range_edges import WINDOW_REACH_PX, find_edges
from cellwright.engine.stages.vision.range_patches import cloud_of
from cellwright.engine.stages.vision.surface_rims import SurfaceRim, find_rim, rim_as_circle

ROUND_SHAPES = (FitShape.SPHERE, FitShape.CYLINDER, FitShape.CONE)
LIMB_FLAT_COSINE = 0.3  # cosine: a surface that is met flatter ends soon after
LIMB_MARGIN_PX = WINDOW_REACH_PX + 1  # from there: so far inside an edge may be found


def without_own_limb(
    image: RangeImage, edges: EdgeImage, fit: Fit, cloud: Cloud
) -> EdgeImage | None:
    """The edges without those beside the limb of a shape that was fitted to a cloud; None if these
    are all.

    A shape that is seen from inside has no limb.
    """
    if fit.shape not in ROUND_SHAPES or cloud.directions is None:
        return None
    back, radius, angle = inverse(fit.T_world_shape), fit.radius_m, fit.angle_rad
    beams = image.beams.reshape(-1, 3) @ fit.T_world_shape[:3, :3]
    seen = beam_hits(
        fit.shape,
        apply(back, cloud.points),
        cloud.directions @ fit.T_world_shape[:3, :3],
        radius,
        angle,
    )
    if np.median(seen.facing[fit.used]) > 0.0:
        return None
    # The nearer one of two places is the one that is seen.
    away = np.maximum(image.beams.reshape(-1, 3) @ fit.origin - radius, 0.0)
    facing_angle = beam_hits(
        fit.shape, apply(back, away[:, None] * image.beams.reshape(-1, 3)), beams, radius, angle
    )
    flat = (~facing_angle.hit | (np.abs(facing_angle.facing) < LIMB_FLAT_COSINE)).reshape(
        edges.kind.shape
    )
    beside = ndimage.binary_dilation(flat, np.ones((2 * LIMB_MARGIN_PX + 1,) * 2))
    if not (beside & (edges.kind > 0)).any():
        return None
    return replace(edges, kind=np.where(beside, 0, edges.kind))


@dataclass(frozen=True, slots=True)
class DimensionRequest:
    """A shape that is asked for: where in the picture it is seen.

    A circle is the rim of a hole or disc in a plane there.
    """

    name: str
    shape: FitShape
    window: PixelWindow


@dataclass(frozen=True, slots=True, eq=False)
class Dimensions:
    """What was found of each shape that was asked for, by name, in the frame of the eye; and
    the edges of the image.
    """

    fits: dict[str, Fitting]
    edges: EdgeImage


def dimensions_in_image(image: RangeImage, asked: Sequence[DimensionRequest]) -> Dimensions:
    """Shapes fitted to patches of an image with whole ranges.

    Raises `ValueError` for an image whose ranges are wrapped.
    """
    if image.wrapped:
        raise ValueError("the ranges are known modulo half a wavelength: resolve them first")
    edges = find_edges(image)
    return Dimensions(
        {request.name: _fit_request(image, edges, request) for request in asked}, edges
    )


def relate_shapes(
    dimensions_found: Dimensions, first_name: str, second_name: str
) -> tuple[Related, ...]:
    """What is between two of the shapes; nothing if one was not found."""
    first, second = dimensions_found.fits[first_name], dimensions_found.fits[second_name]
    return relate_fits(first, second) if isinstance(first, Fit) and isinstance(second, Fit) else ()


def _fit_request(image: RangeImage, edges: EdgeImage, asked: DimensionRequest) -> Fitting:
    shape = FitShape.PLANE if asked.shape is FitShape.CIRCLE else asked.shape
    cloud = cloud_of(image, edges, asked.window)
    fit = fit_measured_shape(shape, cloud)
    if isinstance(fit, Fit) and (own := without_own_limb(image, edges, fit, cloud)) is not None:
        more = cloud_of(image, own, asked.window)
        again = fit_measured_shape(shape, more, near=fit)
        fit, cloud = (again, more) if isinstance(again, Fit) else (fit, cloud)
    fit = _with_rounding(fit, cloud, image) if isinstance(fit, Fit) else fit
    return _fit_rim(image, fit, asked) if asked.shape is FitShape.CIRCLE else fit


def _with_rounding(fit: Fit, cloud: Cloud, image: RangeImage) -> Fit:
    """The fit, as sure as rounded depths let it be: all points of one depth were rounded alike,
    so they count as one.
    """
    if not image.step_m:
        return fit
    depths = np.rint(cloud.points[fit.used, 2] / image.step_m)
    alike = len(depths) / len(np.unique(depths))
    own, rounding = float(np.median(cloud.sigma_m)) ** 2, image.rounding_m**2
    return replace(fit, covariance=fit.covariance * (own + (alike - 1.0) * rounding) / own)


def _fit_rim(image: RangeImage, plane: Fitting, asked: DimensionRequest) -> Fitting:
    """The rim of a plane."""
    if image.guessed:
        return Unfitted(
            "a depth image does not tell how strong answers were, and with them how much of a "
            "beam met the plane"
        )
    if isinstance(plane, Unfitted):
        return Unfitted(f"a circle is the rim of a plane, and there is none: {plane.reason}")
    offset_m = float(plane.axis @ plane.origin)
    rim = find_rim(image, plane.axis, offset_m, asked.window)
    if rim is None:
        return Unfitted("the plane ends nowhere in the patch")
    first = fit_measured_shape(FitShape.CIRCLE, rim.cloud)
    if isinstance(first, Unfitted):
        return first
    rim = rim_as_circle(image, plane.axis, offset_m, rim, first.origin)
    circle = fit_measured_shape(FitShape.CIRCLE, rim.cloud)
    return _circle_on_plane(plane, circle, rim) if isinstance(circle, Fit) else circle


def _circle_on_plane(plane: Fit, circle: Fit, rim: SurfaceRim) -> Fit:
    """A circle on a plane: its height and tilts are those of the plane, which its rim does not
    tell.

    A round rim seen with a wide beam seems nearer to its centre, by the square of the beam over
    twice the radius: what is summed over a Gaussian spreads as heat does, whose level lines move
    towards the centre of their curvature. Where a beam points beside its direction, along the rim,
    it seems farther by as much.
    """
    R = plane.T_world_shape[:3, :3]
    T = circle.T_world_shape.copy()
    turn = R.T @ circle.T_world_shape[:3, :3]
    T[:3, :3] = R
    x, y, _ = R.T @ (circle.origin - plane.origin)
    names = SHAPE_PARAMETERS[FitShape.CIRCLE]
    flat = [names.index(parameter) for parameter in ("x", "y", "radius")]
    own = np.eye(3)
    own[:2, :2] = turn[:2, :2]
    covariance = np.zeros((6, 6))
    covariance[np.ix_(flat, flat)] = own @ circle.covariance[np.ix_(flat, flat)] @ own.T
    # The height of the plane at the centre, and its tilts, by the plane's own height and tilts.
    by: Floats = np.array([[1.0, -x, -y], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    high = [names.index(parameter) for parameter in ("z", "tilt_x", "tilt_y")]
    covariance[np.ix_(high, high)] = by @ plane.covariance @ by.T
    radius = circle.radius_m + (rim.beam_m**2 - rim.pointing_m**2) / (2.0 * circle.radius_m)
    return replace(circle, T_world_shape=T, covariance=covariance, radius_m=radius)
