"""Other libraries' fits to the points of the same patches, where they fit the same: planes by
Open3D, circles by scikit-image.

Both look for consensus and then fit those that agree, and both are told by how much a point may be
off: 3.5 of its standard deviations. Neither says how sure its answer is, so errors are compared in
micrometres. They get the points that our fits get: those of a patch off its edges, and those of a
rim in its plane. A library that is not installed is left out.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply, inverse
from cellwright.engine.model.shape_fits import Fit, FitShape
from cellwright.engine.model.vision import RangeImage
from cellwright.engine.pipelines.motion.image_dimensions import DimensionRequest, Dimensions
from cellwright.engine.stages.vision.range_patches import cloud_of
from cellwright.engine.stages.vision.surface_rims import find_rim

AGREES, TRIALS = 3.5, 300
NAMES = {"open3d": "Open3D", "skimage": "scikit-image"}


class Beside(NamedTuple):
    """One size as both found it: its name, the peer, our error and the peer's in metres, the
    peer's milliseconds.
    """

    what: str
    peer: str
    own: float
    other: float
    ms: float


Truth = Mapping[str, Callable[[Floats, Floats], float] | float]


def beside(
    image: RangeImage, asked: list[DimensionRequest], found: Dimensions, truth: Truth
) -> list[Beside]:
    """What peers find in the same patches.

    `truth` has `plane`, the distance of a plane (point, normal) from where it is, or `radius`.
    """
    (only,) = asked[:1]
    fit = found.fits[only.name]
    if not isinstance(fit, Fit):
        return []
    if only.shape is FitShape.PLANE and "plane" in truth and find_spec("open3d"):
        return list(_plane(image, only, found, fit, truth["plane"]))
    if only.shape is FitShape.CIRCLE and "radius" in truth and find_spec("skimage"):
        return list(_circle(image, only, fit, truth["radius"]))
    return []


def _plane(
    image: RangeImage, asked: DimensionRequest, found: Dimensions, fit: Fit, off: Any
) -> Iterator[Beside]:
    import open3d

    cloud = cloud_of(image, found.edges, asked.window)
    began = time.process_time()
    open3d.utility.random.seed(1)
    points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud.points))
    limit = AGREES * float(np.median(cloud.sigma_m))
    (a, b, c, d), _ = points.segment_plane(limit, 3, TRIALS)
    spent = 1e3 * (time.process_time() - began)
    normal = np.array([a, b, c]) / math.sqrt(a * a + b * b + c * c)
    at = fit.origin - normal * (normal @ fit.origin + d / math.sqrt(a * a + b * b + c * c))
    yield Beside(
        "position of a plane", NAMES["open3d"], off(fit.origin, fit.axis), off(at, normal), spent
    )


def _circle(image: RangeImage, asked: DimensionRequest, fit: Fit, radius: Any) -> Iterator[Beside]:
    from skimage.measure import CircleModel, ransac

    rim = find_rim(image, fit.axis, float(fit.axis @ fit.origin), asked.window)
    if rim is None:
        return
    flat = apply(inverse(fit.T_world_shape), rim.cloud.points)[:, :2]
    began = time.process_time()
    limit = AGREES * float(np.median(rim.cloud.sigma_m))
    # In metres the numbers are so small that the model takes them for a line.
    model, _ = ransac(1e3 * flat, CircleModel, 3, 1e3 * limit, max_trials=TRIALS, rng=1)
    spent = 1e3 * (time.process_time() - began)
    yield Beside(
        "diameter of a hole",
        NAMES["skimage"],
        fit.radius_m - radius,
        1e-3 * model.radius - radius,
        spent,
    )


def told(each: list[Beside]) -> dict[str, Any]:
    """The root mean square errors of both in micrometres, by size and peer, and by which share
    ours is smaller.
    """
    rows: dict[str, Any] = {}
    for key in sorted({(one.what, one.peer) for one in each}):
        own, other, ms = (
            np.array([getattr(one, field) for one in each if (one.what, one.peer) == key])
            for field in ("own", "other", "ms")
        )
        rows[f"{key[0]} beside {key[1]}"] = {
            "count": len(own),
            "own um": _rms(own),
            "peer um": _rms(other),
            "peer by own": round(float(np.sqrt((other**2).mean() / (own**2).mean())), 2),
            "own mean um": round(1e6 * float(own.mean()), 2),
            "peer mean um": round(1e6 * float(other.mean()), 2),
            "peer ms": round(float(ms.mean()), 1),
        }
    return rows


def _rms(errors: Floats) -> float:
    return round(1e6 * math.sqrt(float((errors**2).mean())), 2)
