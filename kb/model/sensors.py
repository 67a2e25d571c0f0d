"""Sensors of a cell: what they read, and what their readings are called."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum


class Sensing(Enum):
    """What a sensor reads."""

    JOINT = "joint"  # how far a body is along its joint (m or rad)
    FORCE = "force"  # how hard something presses against a body (N)
    LOAD = "load"  # how heavy what an arm holds is on its hand (N)
    DISTANCE = "distance"  # how far the nearest thing is along z of a frame (m)
    SLIP = "slip"  # how fast what touches a body slides along it (m/s)


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor reads something `of` a body, arm or frame. A reading is the range (least, greatest) that the value lies in.

    `tells` names the outcome of a test by a reading, where the two have different names.
    """

    sensing: Sensing
    of: str
    readings: Mapping[str, tuple[float, float]]
    tells: Mapping[str, str] = field(default_factory=dict)
