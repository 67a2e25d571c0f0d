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
from engine.pipelines.poses.digests import Footing, Standing, box_of, boxes_of
from engine.pipelines.poses.ways import KEPT, ways_into
from engine.stages.geometry import transforms
from engine.stages.geometry.reach.reach import Unreached
from engine.stages.geometry.reach.seeing import View
from kb.model.cell import Measuring, Patch, Place, Placement

AROUND = 4  # directions in which a tool is tilted
SIDES = 5  # sizes of a patch that are tried


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
    views = [list[View]() for _ in sought]
    for tilt in how.tilts_rad:
        waiting = [n for n, found in enumerate(ways) if not found]
        leaning = [(n, place) for n in waiting for place in _tilted(sought[n].place, tilt)]
        for (n, _), found in zip(leaning, ways_into(room, [each for _, each in leaning]), strict=True):
            ways[n] += found.ways
            looked[n] += found.looked
            tilts[n] = tilt
        for n, place in leaning:
            views[n] += room.reach.looked_through(place)
    made = []
    for each, own, tilt, seen, view in zip(sought, ways, tilts, looked, views, strict=True):
        poses = _poses(room, each, station, own[:KEPT], tilt)
        boxes = (*boxes_of(room, each.place, seen), *box_of(view))
        made.append(
            replace(poses, boxes=boxes, own=footing.digest(each.place, how), near=others.digest(boxes))
        )
    return made


def _poses(room: Room, each: Sought, station: str, ways: Sequence[Floats], tilt: float) -> MeasurementPoses:
    """The poses of one measurement, or why it has none."""
    found = MeasurementPoses(each.measurement, each.place.tool, station)
    if not ways:
        return replace(found, reason=_why(room, each.place))
    patch = _patch(room, each, ways, tilt) if each.how.field_m else None
    return replace(found, straight=tuple(ways), tilt_rad=tilt, patch=patch)


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
        leaning = Placement(place.placement.parent, transforms.to_pose(turned))
        yield replace(place, placement=leaning, surface=place.placement)


def _patch(room: Room, each: Sought, ways: Sequence[Floats], tilt: float) -> Patch:
    """A patch in the middle of the picture, foreshortened by the tilt: as large as what is looked at, or as all ways let see."""
    least, most = each.how.patch_m
    wanted = min(max(each.width_m or most, least), most, each.how.field_m)
    for side in np.linspace(wanted, least, SIDES):
        seen = replace(each.place, patch_m=float(side))
        if all(room.reach.sees(seen, way[-1]) for way in ways):
            break
    return Patch((0.0, 0.0), (float(side), float(side) * math.cos(tilt)))
