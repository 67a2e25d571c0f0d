"""Values of range images: what a laser ranging tool answers, where surfaces end or turn in it, and patches of it. Metres; radians."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TypeAlias

import numpy as np

from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.model.vision import Camera
from cellwright.kb.model.ranging import Ranging


def picture_of(tool: Ranging) -> Camera:
    """The pixels of a ranging tool, as a camera's: its beams go through the eye and the pixels."""
    focal = tool.width / (2.0 * math.tan(tool.view_rad / 2.0))
    return Camera(tool.width, tool.height, focal, ((tool.width - 1) / 2, (tool.height - 1) / 2))


@dataclass(frozen=True, slots=True, eq=False)
class RangeImage:
    """Ranges (height, width) along the beams, 0 where there is no answer, and the strength of each answer.

    The strength is 1 for a surface square to the beam at the distance `tool.at_m`. Where `wrapped`, ranges are known modulo half
    the wavelength of the modulation only. Where `guessed`, strengths were not measured: they follow from ranges and slopes.
    `step_m` is by how much two depths differ at least, if they were rounded.
    """

    tool: Ranging
    range_m: Floats
    strength: Floats
    wrapped: bool = False
    guessed: bool = False
    step_m: float = 0.0

    @property
    def camera(self) -> Camera:
        """The beams, as the pixels of a camera."""
        return picture_of(self.tool)

    @property
    def beams(self) -> Floats:
        """The directions (height, width, 3) of the beams in the frame of the eye, unit vectors."""
        return beams_of(self.camera)

    @property
    def noise_m(self) -> Floats:
        """The standard deviation (height, width) of each range that comes from the signal and from rounding; infinite without an answer."""
        weak = self.strength <= 0
        signal = self.tool.noise_m / np.where(weak, 1.0, self.strength)
        found: Floats = np.where(weak, np.inf, np.hypot(signal, self.rounding_m))
        return found

    @property
    def rounding_m(self) -> float:
        """The standard deviation of what was lost of a depth when it was rounded."""
        return self.step_m / math.sqrt(12.0)

    @property
    def points(self) -> Floats:
        """The points (height, width, 3) in the frame of the eye; NaN without an answer."""
        known = np.where(self.range_m > 0, self.range_m, np.nan)
        found: Floats = known[..., None] * self.beams
        return found


def beams_of(camera: Camera) -> Floats:
    """The directions (height, width, 3) of a camera's pixels, unit vectors."""
    v, u = np.mgrid[: camera.height, : camera.width].astype(float)
    rays = camera.rays(u, v)
    found: Floats = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return found


@dataclass(frozen=True, slots=True)
class Vague:
    """Ranges cannot be resolved, and why."""

    reason: str


Resolving: TypeAlias = RangeImage | Vague


class EdgeKind(IntEnum):
    """What a surface does at an edge: it ends before another one (step), falls away (roof), or rises (crease)."""

    NONE = 0
    STEP = 1
    ROOF = 2
    CREASE = 3


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """The kind of edge (height, width) that each pixel lies on, 0 for none, and the normals (height, width, 3) elsewhere.

    `jump_m` (height, width) is how far the two sides are apart along the beam, `turn_rad` by which angle their normals differ.
    """

    kind: Longs
    jump_m: Floats
    turn_rad: Floats
    normals: Floats

    def on(self, kind: EdgeKind) -> Truths:
        """The pixels (height, width) on edges of a kind."""
        found: Truths = self.kind == kind
        return found


@dataclass(frozen=True, slots=True)
class Window:
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
class Sight:
    """A part at a pose T_eye_part (4, 4): the pixels that show it, their share of its picture, and how many of its faces they show."""

    part: str
    T_eye_part: Floats
    pixels: int
    shown: float
    faces: int


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """A part that is seen. `poses` are those that explain the image equally well, the best first, but for symmetry.

    `equivalent` are the poses that look the same as the best one because the part is symmetric, the best one first.
    """

    best: Sight
    poses: tuple[Floats, ...]
    equivalent: tuple[Floats, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Unclear:
    """What may be one of several parts, or is a part that is seen elsewhere as well: the best sight of each, the best first."""

    sights: tuple[Sight, ...]

    @property
    def parts(self) -> tuple[str, ...]:
        """Their names, in order."""
        return tuple(sorted(each.part for each in self.sights))


@dataclass(frozen=True, slots=True)
class Unexplained:
    """What is seen and belongs to no part: its pixels, a frame around them, and its middle (x, y, z) in the frame of the eye."""

    pixels: int
    window: Window
    middle_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Recognised:
    """The parts that are seen, what is unclear, what belongs to no part, and why each of the other parts is not found."""

    named: tuple[Named, ...] = ()
    unclear: tuple[Unclear, ...] = ()
    unexplained: tuple[Unexplained, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)
