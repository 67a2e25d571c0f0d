"""Edges that a round shape shows only because it turns away from the eye.

Which pixels lie on such an edge is found from ranges, so it depends on their noise. If these edges decided which points count, points would be left out
because of their errors, and the shape would be biased. How a shape faces each beam is known from the shape, and the fit leaves out beams that
meet it too flat. So these edges need not be guarded.
"""

from dataclasses import replace

import numpy as np
from scipy import ndimage

from cellwright.engine.kernels.rigid import apply, inverse
from cellwright.engine.model.fits import Cloud, Fit, Shape
from cellwright.engine.model.ranging import Edges, RangeImage
from cellwright.engine.stages.fitting.rays import met
from cellwright.engine.stages.vision.edges import REACH

ROUND = (Shape.SPHERE, Shape.CYLINDER, Shape.CONE)
FLAT = 0.3  # cosine: a surface that is met flatter ends soon after
BESIDE_PX = REACH + 1  # from there: so far inside an edge may be found


def without_own_limb(image: RangeImage, edges: Edges, fit: Fit, cloud: Cloud) -> Edges | None:
    """The edges without those beside the limb of a shape that was fitted to a cloud; None if these are all.

    A shape that is seen from inside has no limb.
    """
    if fit.shape not in ROUND or cloud.directions is None:
        return None
    back, radius, angle = inverse(fit.T_world_shape), fit.radius_m, fit.angle_rad
    beams = image.beams.reshape(-1, 3) @ fit.T_world_shape[:3, :3]
    seen = met(
        fit.shape, apply(back, cloud.points), cloud.directions @ fit.T_world_shape[:3, :3], radius, angle
    )
    if np.median(seen.facing[fit.used]) > 0.0:
        return None
    # The nearer one of two places is the one that is seen.
    away = np.maximum(image.beams.reshape(-1, 3) @ fit.origin - radius, 0.0)
    there = met(fit.shape, apply(back, away[:, None] * image.beams.reshape(-1, 3)), beams, radius, angle)
    flat = (~there.hit | (np.abs(there.facing) < FLAT)).reshape(edges.kind.shape)
    beside = ndimage.binary_dilation(flat, np.ones((2 * BESIDE_PX + 1,) * 2))
    if not (beside & (edges.kind > 0)).any():
        return None
    return replace(edges, kind=np.where(beside, 0, edges.kind))
