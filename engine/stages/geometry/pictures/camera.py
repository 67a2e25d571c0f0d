"""The view of a picture: a parallel projection that shows everything."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.geometry import Floats, Longs
from cellwright.engine.stages.geometry.pictures.surfaces import Surface

AZIMUTH_RAD, ELEVATION_RAD = math.radians(-60.0), math.radians(28.0)
MARGIN = 0.05  # share of the picture left free on each side
LIGHT = np.array([0.3, 0.5, 0.81])  # to the light: right, up and towards the viewer
AMBIENT = 0.45


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """Axes (3, 3) as rows: right, up and towards the viewer; pixels per metre; the world point at the picture's middle."""

    axes: Floats
    scale: float
    middle: Floats
    width: int
    height: int

    def project(self, points: Floats) -> Floats:
        """For points (..., 3): pixels to the right, pixels down, and metres towards the viewer."""
        seen = (points - self.middle) @ self.axes.T
        x = self.width / 2 + self.scale * seen[..., 0]
        y = self.height / 2 - self.scale * seen[..., 1]
        return np.stack([x, y, seen[..., 2]], axis=-1)

    def shade(self, triangles: Floats) -> Floats:
        """How bright triangles (m, 3, 3) in the world are (m,).

        Triangles that face away are lit as if from behind.
        """
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        seen = (normals / np.where(length > 0, length, 1.0)) @ self.axes.T
        lit: Floats = AMBIENT + (1.0 - AMBIENT) * np.abs(seen @ LIGHT)
        return lit


def looking_at(points: Floats, size: tuple[int, int], azimuth: float, elevation: float) -> Camera:
    """A camera at an azimuth and an elevation (radians), with all points (n, 3) in the picture."""
    ca, sa, ce, se = math.cos(azimuth), math.sin(azimuth), math.cos(elevation), math.sin(elevation)
    axes = np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])
    seen = points @ axes.T if len(points) else np.zeros((1, 3))
    low, high = seen.min(axis=0), seen.max(axis=0)
    extent = np.maximum(high - low, 1e-6)
    scale = float((np.array(size) * (1 - 2 * MARGIN) / extent[:2]).min())
    return Camera(axes, scale, ((low + high) / 2) @ axes, *size)


def triangles_in_world(shown: Sequence[Surface], carriers: Floats) -> Floats:
    """The corners (m, 3, 3) of all triangles in the world, for carriers at poses (k + 1, 4, 4)."""
    placed = []
    for surface in shown:
        T = carriers[surface.carrier]
        placed.append((surface.vertices @ T[:3, :3].T + T[:3, 3])[surface.triangles])
    return np.concatenate([np.zeros((0, 3, 3)), *placed])


def colours_of(shown: Sequence[Surface]) -> Floats:
    """The colour of each triangle (m, 3), from 0 to 1."""
    return np.concatenate(
        [np.zeros((0, 3)), *(np.tile(each.colour, (len(each.triangles), 1)) for each in shown)]
    )


def pieces_of(shown: Sequence[Surface]) -> Longs:
    """The number of the convex piece of each triangle (m,)."""
    found: Longs = np.repeat(np.arange(len(shown)), [len(each.triangles) for each in shown])
    return found
