"""A scene in which parts are placed on each other: relations, camera, hand and table.

Lengths are in metres, angles in radians.
"""

import math
from dataclasses import dataclass, field

from cellwright.kb.diagnostics import NOWHERE, Source
from cellwright.kb.model.cell_model import Cell, Placement

ON_FLOOR = Placement()
INSET_M, DENSITY = 0.015, 1000.0


@dataclass(frozen=True, slots=True)
class SaidRelation:
    """`kind` shall hold between two features, each named by its body and its own name; a
    preferred one only if it can.
    """

    kind: str
    first: tuple[str, str]
    second: tuple[str, str]
    value: float = 0.0
    preferred: bool = False
    where: Source = field(default=NOWHERE, compare=False)

    def __str__(self) -> str:
        return f"{'.'.join(self.first)} {self.kind} {'.'.join(self.second)}"


@dataclass(frozen=True, slots=True)
class CameraEntry:
    """A depth camera: where it is (its z axis looks forward), what it sees, and how it errs."""

    placement: Placement
    width: int = 640
    height: int = 480
    view_m: float = 0.6
    distance_m: float = 1.0
    noise_m: float = 0.001
    dropouts: float = 0.0


Numbers = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class CameraFound:
    """What calibrations have found of the camera of a scene, in metres and radians.

    `T_world_camera` are the rows of a matrix (4, 4). `covariance` (9, 9) is that of a displacement
    of the camera, of its turn about its own origin, both along the axes of the world, of the focal
    length, and of the centre in pixels. A measured depth is `offset_m` + `scale` times the true
    one, with a standard deviation of `noise_m`.
    """

    T_world_camera: tuple[Numbers, ...]
    focal_px: float
    centre_px: tuple[float, float]
    covariance: tuple[Numbers, ...]
    offset_m: float = 0.0
    scale: float = 1.0
    noise_m: float = 0.001


@dataclass(frozen=True, slots=True)
class HandEntry:
    """Parallel jaws at the tool point of an arm, or a hand with three fingers: z of its frame
    points to the part, x is the way in which they close. `accuracy_m` is the standard deviation,
    along each axis, of where the arm brings what the hand holds.
    """

    arm: str
    opening_m: float = 0.1
    pad_m: float = 0.016
    finger_m: float = 0.06
    thick_m: float = 0.012
    cross_m: tuple[float, float, float] = (0.14, 0.04, 0.03)
    sensor_m: tuple[float, float, float] = (0.06, 0.06, 0.03)
    friction: float = 0.4
    force_n: float = 40.0
    fingers: int = 2
    accuracy_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Scene:
    """What `place` works on.

    `clutter` names bodies that the camera sees and nobody has modelled. `table` is a frame on the
    free part of a table, with z upwards: there parts are laid down to be taken anew. Parts have a
    density in kg per cubic metre. A part is not taken before it is sure to come within
    `tolerance_m` of its goal (three standard deviations). `target` is the part that is held before
    the camera when this is calibrated. What was found then is in `calibrated`, and counts instead
    of what `camera` says.
    """

    name: str
    cell: Cell
    camera: CameraEntry
    hand: HandEntry
    relations: tuple[SaidRelation, ...] = ()
    clutter: tuple[str, ...] = ()
    table: Placement = ON_FLOOR
    inset_m: float = INSET_M
    density: float = DENSITY
    tolerance_m: float = math.inf
    target: str = ""
    calibrated: CameraFound | None = None
