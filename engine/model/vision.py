"""Vision: cameras, depth and range images, edges in them, and where parts were found."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TypeAlias

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.kb.model.cell_model import Ranging


@dataclass(frozen=True, slots=True)
class DepthCamera:
    """A perspective camera: its z axis looks forward, x goes right and y down in the picture.

    Pixel (v, u) looks along ((u - cx) / focal, (v - cy) / focal, 1).
    """

    width: int
    height: int
    focal_px: float
    centre_px: tuple[float, float]

    @classmethod
    def viewing(cls, width: int, height: int, view_m: float, distance_m: float) -> "DepthCamera":
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
    """Depths (height, width) along the camera's axis; 0 where nothing was measured. `noise_m`
    is their standard deviation.
    """

    camera: DepthCamera
    depth: Floats
    noise_m: float


@dataclass(frozen=True, slots=True, eq=False)
class PoseHypothesis:
    """A pose T_camera_part (4, 4) and what the image says of it.

    `agreeing` is the share, of the pixels where the part would be seen and nothing is before it,
    that show its surface. `seen` is the share of its picture that shows it. `edged` is the share of
    its outline, as far as it is seen, where the surface ends, and `off_px` by how many pixels the
    piece of an edge is off that is off most. `pixels` counts the pixels that show it. `evidence` is
    twice the gain in log-likelihood over knowing nothing of the part: what each pixel, and each
    place of the outline, is nearer than the farthest that still agrees. A pixel through which
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
class LocatedPart:
    """The part is there. `covariance` (6, 6) is that of a displacement in metres and a turn in rad,
    about the part's origin.

    Both are along the axes of the camera. `equivalent` are all poses, the found one first, that
    look the same because the part is symmetric. `second` is the best other hypothesis.
    """

    best: PoseHypothesis
    covariance: Floats
    equivalent: tuple[Floats, ...]
    second: PoseHypothesis | None


@dataclass(frozen=True, slots=True, eq=False)
class NotLocated:
    """The part is not there, or it cannot be said where: `reason` tells which."""

    reason: str
    best: PoseHypothesis | None = None
    second: PoseHypothesis | None = None


Sighting: TypeAlias = LocatedPart | NotLocated


def picture_of(tool: Ranging) -> DepthCamera:
    """The pixels of a ranging tool, as a camera's: its beams go through the eye and the pixels."""
    focal = tool.width / (2.0 * math.tan(tool.view_rad / 2.0))
    return DepthCamera(
        tool.width, tool.height, focal, ((tool.width - 1) / 2, (tool.height - 1) / 2)
    )


@dataclass(frozen=True, slots=True, eq=False)
class RangeImage:
    """Ranges (height, width) along the beams, 0 where there is no answer, and the strength of each
    answer.

    The strength is 1 for a surface square to the beam at the distance `tool.at_m`. Where `wrapped`,
    ranges are known modulo half the wavelength of the modulation only. Where `guessed`, strengths
    were not measured: they follow from ranges and slopes. `step_m` is by how much two depths differ
    at least, if they were rounded.
    """

    tool: Ranging
    range_m: Floats
    strength: Floats
    wrapped: bool = False
    guessed: bool = False
    step_m: float = 0.0

    @property
    def camera(self) -> DepthCamera:
        """The beams, as the pixels of a camera."""
        return picture_of(self.tool)

    @property
    def beams(self) -> Floats:
        """The directions (height, width, 3) of the beams in the frame of the eye, unit vectors."""
        return beams_of(self.camera)

    @property
    def noise_m(self) -> Floats:
        """The standard deviation (height, width) of each range that comes from the signal and
        from rounding; infinite without an answer.
        """
        weak = self.strength <= 0
        signal = self.tool.noise_m / np.where(weak, 1.0, self.strength)
        noise: Floats = np.where(weak, np.inf, np.hypot(signal, self.rounding_m))
        return noise

    @property
    def rounding_m(self) -> float:
        """The standard deviation of what was lost of a depth when it was rounded."""
        return self.step_m / math.sqrt(12.0)

    @property
    def points(self) -> Floats:
        """The points (height, width, 3) in the frame of the eye; NaN without an answer."""
        seen_ranges = np.where(self.range_m > 0, self.range_m, np.nan)
        image_points: Floats = seen_ranges[..., None] * self.beams
        return image_points


def beams_of(camera: DepthCamera) -> Floats:
    """The directions (height, width, 3) of a camera's pixels, unit vectors."""
    v, u = np.mgrid[: camera.height, : camera.width].astype(float)
    rays = camera.rays(u, v)
    directions: Floats = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return directions


@dataclass(frozen=True, slots=True)
class Vague:
    """Ranges cannot be resolved, and why."""

    reason: str


Resolving: TypeAlias = RangeImage | Vague


class EdgeKind(IntEnum):
    """What a surface does at an edge: it ends before another one (step), falls away (roof), or
    rises (crease).
    """

    NONE = 0
    STEP = 1
    ROOF = 2
    CREASE = 3


@dataclass(frozen=True, slots=True, eq=False)
class EdgeImage:
    """The kind of edge (height, width) that each pixel lies on, 0 for none, and the normals
    (height, width, 3) elsewhere.

    `jump_m` (height, width) is how far the two sides are apart along the beam, `turn_rad` by which
    angle their normals differ.
    """

    kind: Longs
    jump_m: Floats
    turn_rad: Floats
    normals: Floats

    def on(self, kind: EdgeKind) -> Truths:
        """The pixels (height, width) on edges of a kind."""
        on_edge: Truths = self.kind == kind
        return on_edge


@dataclass(frozen=True, slots=True)
class PixelWindow:
    """A rectangle of whole pixels: the first column and row, and those after the last."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def rows(self) -> slice:
        """Its rows."""
        return slice(self.top, self.bottom)

    @property
    def columns(self) -> slice:
        """Its columns."""
        return slice(self.left, self.right)


@dataclass(frozen=True, slots=True, eq=False)
class PartSight:
    """A part at a pose T_eye_part (4, 4): the pixels that show it, their share of its picture,
    and how many of its faces they show.
    """

    part: str
    T_eye_part: Floats
    pixels: int
    shown: float
    faces: int


@dataclass(frozen=True, slots=True, eq=False)
class NamedPart:
    """A part that is seen. `poses` are those that explain the image equally well, the best first,
    but for symmetry.

    `equivalent` are the poses that look the same as the best one because the part is symmetric, the
    best one first.
    """

    best: PartSight
    poses: tuple[Floats, ...]
    equivalent: tuple[Floats, ...]


@dataclass(frozen=True, slots=True, eq=False)
class UnclearParts:
    """What may be one of several parts, or is a part that is seen elsewhere as well: the best
    sight of each, the best first.
    """

    sights: tuple[PartSight, ...]

    @property
    def parts(self) -> tuple[str, ...]:
        """Their names, in order."""
        return tuple(sorted(sight.part for sight in self.sights))


@dataclass(frozen=True, slots=True)
class Unexplained:
    """What is seen and belongs to no part: its pixels, a frame around them, and its middle (x,
    y, z) in the frame of the eye.
    """

    pixels: int
    window: PixelWindow
    middle_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Recognised:
    """The parts that are seen, what is unclear, what belongs to no part, and why each of the
    other parts is not found.
    """

    named: tuple[NamedPart, ...] = ()
    unclear: tuple[UnclearParts, ...] = ()
    unexplained: tuple[Unexplained, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)
