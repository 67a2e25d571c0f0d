"""Values of vision: cameras, depth images, and where a part was found. Metres; pixels count from the upper left one's middle."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from cellwright.engine.model.geometry import Floats


@dataclass(frozen=True, slots=True)
class Camera:
    """A perspective camera: its z axis looks forward, x goes right and y down in the picture.

    Pixel (v, u) looks along ((u - cx) / focal, (v - cy) / focal, 1).
    """

    width: int
    height: int
    focal_px: float
    centre_px: tuple[float, float]

    @classmethod
    def viewing(cls, width: int, height: int, view_m: float, distance_m: float) -> "Camera":
        """The camera that sees a width of `view_m` at a distance."""
        return cls(width, height, width * distance_m / view_m, ((width - 1) / 2, (height - 1) / 2))

    def rays(self, u: Floats, v: Floats) -> Floats:
        """The directions (..., 3) of pixels; their depth along the axis is 1."""
        x, y = (u - self.centre_px[0]) / self.focal_px, (v - self.centre_px[1]) / self.focal_px
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def pixels(self, points: Floats) -> tuple[Floats, Floats]:
        """Where points (..., 3) in front of the camera are seen: u and v (...)."""
        u = self.focal_px * points[..., 0] / points[..., 2] + self.centre_px[0]
        return u, self.focal_px * points[..., 1] / points[..., 2] + self.centre_px[1]


@dataclass(frozen=True, slots=True, eq=False)
class DepthImage:
    """Depths (height, width) along the camera's axis; 0 where nothing was measured. `noise_m` is their standard deviation."""

    camera: Camera
    depth: Floats
    noise_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A pose T_camera_part (4, 4) and what the image says of it.

    `agreeing` is the share, of the pixels where the part would be seen and nothing is before it, that show its surface.
    `seen` is the share of its picture that shows it. `edged` is the share of its outline, as far as it is seen, where the
    surface ends, and `off_px` by how many pixels the piece of an edge is off that is off most. `pixels` counts the pixels that show it. `evidence` is twice the gain in log-likelihood over knowing nothing
    of the part: what each pixel, and each place of the outline, is nearer than the farthest that still agrees. A pixel through which
    something is seen that lies behind the part counts against it.
    """

    T_camera_part: Floats
    agreeing: float
    seen: float
    edged: float
    pixels: int
    evidence: float
    off_px: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """The part is there. `covariance` (6, 6) is that of a displacement in metres and a turn in rad, about the part's origin.

    Both are along the axes of the camera. `equivalent` are all poses, the found one first, that look the same because the
    part is symmetric. `second` is the best other hypothesis.
    """

    best: Hypothesis
    covariance: Floats
    equivalent: tuple[Floats, ...]
    second: Hypothesis | None


@dataclass(frozen=True, slots=True, eq=False)
class NotLocated:
    """The part is not there, or it cannot be said where: `reason` tells which."""

    reason: str
    best: Hypothesis | None = None
    second: Hypothesis | None = None


Sighting: TypeAlias = Located | NotLocated
