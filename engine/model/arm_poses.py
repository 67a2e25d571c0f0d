"""Poses of an arm for a measurement: the configurations in which it takes it, or why there is
none.
"""

from dataclasses import dataclass

from cellwright.engine.kernels.arrays import Floats
from cellwright.kb.model.cell_model import Patch

Box = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True, slots=True, eq=False)
class MeasurementPoses:
    """The configurations in which an arm takes a measurement from a station, with a tool; or why
    there is none.

    `straight` are the ways (m, k) from free space into the pose, the preferred ones first: the last
    row of each is the pose, the first the approach point. `tilt_rad` is the angle to the normal.
    `patch` is where a scanner looks in its picture, from where it sees the point. `sigma_m` is the
    standard deviation that is to be expected of the surface's distance there, from the first pose;
    0: not known. `boxes` hold everything that the arm and its tool can touch in the configurations
    that the answer rests on, one box for each of the arm's links that move. `own` and `near` are
    digests: of the arm, the tool and the place, and of the bodies in the boxes.
    """

    measurement: str
    tool: str
    station: str
    straight: tuple[Floats, ...] = ()
    tilt_rad: float = 0.0
    patch: Patch | None = None
    reason: str = ""
    boxes: tuple[Box, ...] = ()
    own: str = ""
    near: str = ""
    sigma_m: float = 0.0

    @property
    def reached(self) -> bool:
        """Whether the arm can take it from there."""
        return bool(self.straight)
