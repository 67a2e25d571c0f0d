"""The poses of one measurement from one station: free rotation about the tool axis, every branch, the allowed tilts."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from engine.model.geometry import Floats
from engine.model.poses import MeasurementPoses
from engine.pipelines.moves.rooms import Room
from engine.pipelines.poses.digests import Standing, box_of, own_digest
from engine.stages.geometry import transforms
from engine.stages.geometry.reach.reach import Unreached
from kb.model.cell import Measuring, Patch, Place, Placement

KEPT = 6  # poses that are kept of a measurement
TRIED = 48  # free configurations whose way in is looked at
AROUND = 4  # directions in which a tool is tilted


def found_poses(
    room: Room,
    others: Standing,
    place: Place,
    how: Measuring,
    measurement: str,
    station: str,
    width_m: float,
) -> MeasurementPoses:
    """The poses of the first allowed tilt that has any, the nearest to the arm's rest first.

    `width_m` is the width of what is looked at (0: as large as a patch may be).
    """
    looked: list[Floats] = []
    home, reasons = room.world.configurations[place.arm], list[str]()
    for tilt in how.tilts_rad:
        ways: list[Floats] = []
        for leaning in _tilted(place, tilt):
            ways += _ways(room, leaning, home, looked)
        if ways:
            patch = _patch(how, width_m, tilt) if how.field_m else None
            made = MeasurementPoses(measurement, place.tool, station, tuple(ways[:KEPT]), tilt, patch)
            return _with_digests(made, room, others, place, how, looked)
    answer = room.reach.at(place)
    reasons = [answer.reason] if isinstance(answer, Unreached) else ["there is no straight way to it"]
    return _with_digests(
        MeasurementPoses(measurement, place.tool, station, reason=reasons[0]),
        room,
        others,
        place,
        how,
        looked,
    )


def _with_digests(
    made: MeasurementPoses,
    room: Room,
    others: Standing,
    place: Place,
    how: Measuring,
    looked: list[Floats],
) -> MeasurementPoses:
    box = box_of(room, place, looked)
    own, near = own_digest(room.world, place, how), others.digest(box)
    return replace(made, box=box, own=own, near=near)


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


def _ways(room: Room, place: Place, home: Floats, looked: list[Floats]) -> list[Floats]:
    """The straight ways in that are free; every configuration that was looked at is added to `looked`."""
    poses = room.poses(place, home)
    looked += list(poses)
    if not len(poses):
        return []
    free = poses[~room.checker(place).collides(room.whole(place.arm, poses))]
    found: list[Floats] = []
    for q in free[:TRIED]:
        path = room.straight(place, q, place.approach_m)
        if path is None:
            continue
        looked += list(path)
        before_free = not room.free(place.arm).collides(room.whole(place.arm, path[:1]))[0]
        if before_free and room.is_free(place, path):
            found.append(path)
        if len(found) == KEPT:
            break
    return found


def _patch(how: Measuring, width_m: float, tilt: float) -> Patch:
    """A patch in the middle of the picture, as large as what is looked at, foreshortened by the tilt."""
    least, most = how.patch_m
    side = min(max(width_m or most, least), most, how.field_m)
    return Patch((0.0, 0.0), (side, side * math.cos(tilt)))
