"""The poses of measurements from one station: free rotation about the tool axis, every branch, the allowed tilts.

Many measurements with one tool are looked at together, so that arrays are long.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.poses import MeasurementPoses
from cellwright.engine.model.solid import Solid
from cellwright.engine.pipelines.moves.rooms import Room
from cellwright.engine.pipelines.poses.digests import Footing, Standing, box_of, boxes_of
from cellwright.engine.pipelines.poses.views import eye_of, looked_at, patch_of, solids_before
from cellwright.engine.pipelines.poses.ways import KEPT, ways_into
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.reach.reach import Unreached
from cellwright.engine.stages.geometry.reach.seeing import View
from cellwright.engine.stages.vision.placement import placed
from cellwright.kb.model.cell import Measuring, Patch, Place, Placement
from cellwright.kb.model.ranging import Ranging

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
    solids = solids_before(room.world, sought[0].place.arm) if how.ranging else {}
    made = []
    for each, own, tilt, seen, view in zip(sought, ways, tilts, looked, views, strict=True):
        poses = _poses(room, each, station, own[:KEPT], tilt, solids)
        boxes = (*boxes_of(room, each.place, seen), *box_of(view), *poses.boxes)
        made.append(
            replace(poses, boxes=boxes, own=footing.digest(each.place, how), near=others.digest(boxes))
        )
    return made


def _poses(
    room: Room,
    each: Sought,
    station: str,
    ways: Sequence[Floats],
    tilt: float,
    solids: Mapping[str, Solid],
) -> MeasurementPoses:
    """The poses of one measurement, or why it has none."""
    found = MeasurementPoses(each.measurement, each.place.tool, station)
    if not ways:
        return replace(found, reason=_why(room, each.place))
    if not each.how.field_m:
        return replace(found, straight=tuple(ways), tilt_rad=tilt)
    patch = _patch(room, each, ways, tilt)
    found = replace(found, straight=tuple(ways), tilt_rad=tilt, patch=patch)
    if each.how.ranging is None:
        return found
    return _with_best_patch(room, each, found, each.how.ranging, solids)


def _with_best_patch(
    room: Room, each: Sought, poses: MeasurementPoses, ranging: Ranging, solids: Mapping[str, Solid]
) -> MeasurementPoses:
    """The poses with the patch that leaves the least uncertainty from the first of them, no wider than the one that all see.

    The box of all that the choice looked at is kept, too. Where no patch fits on the surface, the one before stays.
    """
    eye = eye_of(room.world, each.place, each.how, ranging, poses.straight[0][-1], solids)
    at = each.place.surface or each.place.placement
    surface = room.world.pose("world", at.parent) @ transforms.of_pose(at.pose)
    point, back = surface[:3, 3], transforms.inverse(eye.T_world_eye)
    most = max(each.how.patch_m[0], *(poses.patch.size_m if poses.patch else (0.0,)))
    own = transforms.apply(back, point[None])[0]
    sides = (min(each.how.patch_m[0], most), most)
    found = placed(list(eye.bodies.values()), ranging, own, back[:3, :3] @ -surface[:3, 2], sides)
    searched = (looked_at(eye, point, 2.0 * most),)
    if found is None:
        return replace(poses, boxes=searched)
    return replace(poses, patch=patch_of(eye, found, point), sigma_m=found.sigma_m, boxes=searched)


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
