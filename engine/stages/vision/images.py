"""Depth images of solids, as a perspective camera and an imperfect sensor see them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.model.solid import Solid
from cellwright.engine.model.vision import Camera, DepthImage
from cellwright.engine.stages.vision.kernels.rays import Range, draw


@dataclass(frozen=True, slots=True)
class Sensor:
    """How a sensor errs: a normal error of `noise_m`, and a share of pixels without an answer.

    Beyond `grazing_rad` between the ray and the surface's normal there is no answer either. At a jump in depth, a share
    `mixed` of the pixels answers with a depth between the two sides.
    """

    noise_m: float = 0.001
    dropouts: float = 0.0
    grazing_rad: float = np.pi / 2
    mixed: float = 0.0


def rendered(solids: Sequence[tuple[Solid, Floats]], camera: Camera) -> tuple[DepthImage, Longs]:
    """What a camera sees of solids at poses T_camera_solid (4, 4), without error.

    Returns the image, and for each pixel the number of the solid (height, width), -1 for none.
    """
    seen = Range((camera.height, camera.width), camera.focal_px, camera.centre_px)
    for number, (solid, T) in enumerate(solids):
        corners = np.ascontiguousarray(apply(T, solid.vertices).reshape(-1, 3, 3))
        draw(seen, corners, np.full(len(corners), number, dtype=np.int64))
    return DepthImage(camera, seen.depth, 0.0), seen.owner


def disturbed(image: DepthImage, sensor: Sensor, seed: int) -> DepthImage:
    """The image as a sensor gives it; the same seed gives the same errors."""
    random = np.random.default_rng(seed)
    depth = image.depth.copy()
    depth = np.where(random.random(depth.shape) < sensor.mixed, _mixed(depth, random), depth)
    seen = depth > 0
    depth = np.where(seen, depth + random.normal(0.0, sensor.noise_m, depth.shape), 0.0)
    lost = (random.random(depth.shape) < sensor.dropouts) | _grazed(image, sensor.grazing_rad)
    return replace(image, depth=np.where(lost, 0.0, np.maximum(depth, 0.0)), noise_m=sensor.noise_m)


def _mixed(depth: Floats, random: np.random.Generator) -> Floats:
    """Depths between those of a pixel and of its neighbour to the right."""
    other = np.roll(depth, -1, axis=1)
    share = random.random(depth.shape)
    found: Floats = np.where((depth > 0) & (other > 0), depth + share * (other - depth), depth)
    return found


def _grazed(image: DepthImage, grazing_rad: float) -> Truths:
    """Where the surface is seen at a flatter angle than a sensor can measure (height, width)."""
    if grazing_rad >= np.pi / 2:
        return np.zeros(image.depth.shape, dtype=bool)
    camera = image.camera
    v, u = np.mgrid[: camera.height, : camera.width].astype(float)
    rays = camera.rays(u, v)
    points = rays * image.depth[..., None]
    normals = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    length = np.linalg.norm(normals, axis=-1) * np.linalg.norm(rays, axis=-1)
    cosine = np.abs((normals * rays).sum(axis=-1)) / np.where(length > 0, length, 1.0)
    found: Truths = cosine < np.cos(grazing_rad)
    return found
