"""The poses of measurements from one station: free rotation about the tool axis, every branch, the allowed tilts.

Many measurements with one tool are looked at together, so that arrays are long.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from engine.model.geometry import Floats
from engine.model.poses import MeasurementPoses
from engine.pipelines.moves.rooms import Room
from engine.pipelines.poses.digests import Footing, Standing, boxes_of
from engine.pipelines.poses.ways import KEPT, ways_into
from engine.stages.geometry import transforms
from engine.stages.geometry.reach.reach import Unreached
from kb.model.cell import Measuring, Patch, Place, Placement

AROUND = 4  # directions in which a tool is tilted


@dataclass(frozen=True, slots=True, eq=False)
class Sought:
    """A measurement whose poses are sought at a place. `width_m` is how wide it is (0: as large as a patch may be)."""

    measurement: str
    place: Place
    how: Measuring
    width_m: float = 0.0


def found_poses(
    room: Room, others: Standing, footing: Footing, sought: Sequence[Sought], station: str
) -> list[MeasurementPoses]:
    """For each measurement the poses of the first allowed tilt that has any, the nearest to the arm's rest first.

    All are taken with one arm and one tool, in one way.
    """
    how, ways = sought[0].how, [list[Floats]() for _ in sought]
    looked, tilts = [list[Floats]() for _ in sought], [0.0] * len(sought)
    for tilt in how.tilts_rad:
        waiting = [n for n, found in enumerate(ways) if not found]
        leaning = [(n, place) for n in waiting for place in _tilted(sought[n].place, tilt)]
        for (n, _), found in zip(leaning, ways_into(room, [each for _, each in leaning]), strict=True):
            ways[n] += found.ways
            looked[n] += found.looked
            tilts[n] = tilt
    made = []
    for each, own, tilt, seen in zip(sought, ways, tilts, looked, strict=True):
        if own:
            patch = _patch(how, each.width_m, tilt) if how.field_m else None
            poses = MeasurementPoses(
                each.measurement, each.place.tool, station, tuple(own[:KEPT]), tilt, patch
            )
        else:
            poses = MeasurementPoses(
                each.measurement, each.place.tool, station, reason=_why(room, each.place)
            )
        boxes = boxes_of(room, each.place, seen)
        made.append(
            replace(poses, boxes=boxes, own=footing.digest(each.place, how), near=others.digest(boxes))
        )
    return made


def _why(room: Room, place: Place) -> str:
    answer = room.reach.at(place)
    return answer.reason if isinstance(answer, Unreached) else "there is no straight way to it"


def _tilted(place: Place, tilt: float) -> Iterator[Place]:
    """The place with its tool tilted, in some directions; the place itself without a tilt."""
    if abs(tilt) < 1e-12:
        yield place
        return
    T = transforms.of_pose(place.placement.pose)
    for angle in np.arange(AROUND) * math.pi / AROUND:
        axis = (math.cos(angle), math.sin(angle), 0.0)
        turned = T @ transforms.transform(transforms.rotation(axis, tilt), np.zeros(3))
        yield replace(place, placement=Placement(place.placement.parent, transforms.to_pose(turned)))


def _patch(how: Measuring, width_m: float, tilt: float) -> Patch:
    """A patch in the middle of the picture, as large as what is looked at, foreshortened by the tilt."""
    least, most = how.patch_m
    side = min(max(width_m or most, least), most, how.field_m)
    return Patch((0.0, 0.0), (side, side * math.cos(tilt)))
