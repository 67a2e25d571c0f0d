"""Searches poses of measurements from one station, with straight free paths into them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.model.arm_poses import MeasurementPoses
from cellwright.engine.model.geometry import Solid
from cellwright.engine.pipelines.motion.cell_state import BRANCH_JUMP, CellState
from cellwright.engine.pipelines.motion.pose_digests import (
    ArmFooting,
    StandingBodies,
    box_of,
    boxes_of,
)
from cellwright.engine.pipelines.motion.ranging_views import (
    box_looked_at,
    eye_of,
    patch_of,
    solids_before,
)
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.reach.place_reachability import UnreachedPlace
from cellwright.engine.stages.geometry.reach.scanner_view import PatchView
from cellwright.engine.stages.vision.range_patches import place_patch
from cellwright.kb.model.cell_model import Measuring, Patch, Place, Placement, Ranging

MAX_KEPT_WAYS = 6  # ways that are kept of a place
MAX_TRIED_WAYS = 48  # free configurations whose way in is looked at
# ways that are kept of one branch: an arm with a large tool may not get from one branch to
# another
OF_A_BRANCH = 2
WAYS_AT_ONCE = 8  # of them, those that are looked at together


@dataclass(eq=False)
class WaysIntoPlace:
    """The ways (m, k) into one place that were found, and the configurations (n, k) that this
    rests on.
    """

    place: Place
    poses: Floats
    free: Truths
    ways: list[Floats] = field(default_factory=list)
    looked: list[Floats] = field(default_factory=list)
    _next: int = 0
    _asked: int = 0
    _seen: int = 0

    def candidates(self) -> Iterator[int]:
        """The next free configurations whose ways are looked at; none if enough are known."""
        numbers, asked = np.nonzero(self.free)[0], 0
        while (
            len(self.ways) < MAX_KEPT_WAYS
            and asked < WAYS_AT_ONCE
            and self._asked < MAX_TRIED_WAYS
            and self._next < len(numbers)
        ):
            number = int(numbers[self._next])
            self._next += 1
            if not self._is_crowded(self.poses[number]):
                asked, self._asked = asked + 1, self._asked + 1
                yield number

    def take(self, number: int, path: Floats | None, room: CellState) -> None:
        """Look at the way of one candidate, and keep it if it is free. Candidates come in order;
        one that is not needed is not looked at.
        """
        if len(self.ways) == MAX_KEPT_WAYS or self._is_crowded(self.poses[number]):
            return
        self._see(number + 1)
        if path is not None:
            self.looked += list(path)
            if _is_free(room, self.place, path):
                self.ways.append(path)

    def close(self) -> None:
        """Unless enough ways were found before the end, the answer rests on every configuration."""
        if len(self.ways) < MAX_KEPT_WAYS:
            self._see(len(self.poses))

    def _is_crowded(self, q: Floats) -> bool:
        """Whether enough ways end in the branch of a configuration (k,): the last joint does
        not make another branch.
        """
        same = [
            np.abs(path[-1][:-1] - q[:-1]).max(initial=0.0) <= BRANCH_JUMP for path in self.ways
        ]
        return same.count(True) >= OF_A_BRANCH

    def _see(self, upto: int) -> None:
        self.looked += list(self.poses[self._seen : upto])
        self._seen = max(self._seen, upto)


def ways_into(room: CellState, places: Sequence[Place]) -> list[WaysIntoPlace]:
    """For each place the straight ways in that are free, the nearest to the arm's rest first.

    The places take one arm, one tool, one approach, and touch the same. The answer for each is what
    it would be alone.
    """
    if not places:
        return []
    arm = places[0].arm
    poses = room.poses_at(places, room.world.configurations[arm])
    hits = room.collides(places[0], np.concatenate(poses))
    ends = np.cumsum([len(poses_of_place) for poses_of_place in poses])[:-1]
    ways_found = [
        WaysIntoPlace(*arguments)
        for arguments in zip(
            places, poses, [~hits_of_place for hits_of_place in np.split(hits, ends)], strict=True
        )
    ]
    while rows := [(own, n) for own in ways_found for n in own.candidates()]:
        starts = np.array([own.poses[n] for own, n in rows])
        paths = room.straights(places[0], starts, places[0].approach_m)
        for (own, n), path in zip(rows, paths, strict=True):
            own.take(n, path, room)
    for own in ways_found:
        own.close()
    return ways_found


def _is_free(room: CellState, place: Place, path: Floats) -> bool:
    """Whether a path touches nothing that it may not: nothing at all where it begins."""
    front = room.whole(place.arm, path[:1])
    return not room.free(place.arm).collides(front)[0] and room.is_free(place, path)


TILT_DIRECTIONS = 4  # directions in which a tool is tilted
PATCH_SIZES = 5  # sizes of a patch that are tried


@dataclass(frozen=True, slots=True, eq=False)
class SoughtMeasurement:
    """A measurement whose poses are sought at a place.

    `width_m` is how wide it is (0: as large as a patch may be).
    """

    measurement: str
    place: Place
    how: Measuring
    width_m: float = 0.0


def found_poses(
    room: CellState,
    standing_bodies: StandingBodies,
    footing: ArmFooting,
    sought: Sequence[SoughtMeasurement],
    station: str,
) -> list[MeasurementPoses]:
    """For each measurement the poses of the first allowed tilt that has any, the nearest to the
    arm's rest first.

    All are taken with one arm and one tool, in one way.
    """
    how, ways = sought[0].how, [list[Floats]() for _ in sought]
    looked, tilts = [list[Floats]() for _ in sought], [0.0] * len(sought)
    views = [list[PatchView]() for _ in sought]
    for tilt in how.tilts_rad:
        waiting = [n for n, ways_found in enumerate(ways) if not ways_found]
        leaning = [(n, place) for n in waiting for place in _tilted_places(sought[n].place, tilt)]
        for (n, _), ways_found in zip(
            leaning, ways_into(room, [leaning_place for _, leaning_place in leaning]), strict=True
        ):
            ways[n] += ways_found.ways
            looked[n] += ways_found.looked
            tilts[n] = tilt
        for n, place in leaning:
            views[n] += room.reach.looked_through(place)
    solids = solids_before(room.world, sought[0].place.arm) if how.ranging else {}
    all_poses = []
    for measurement, own, tilt, seen, view in zip(sought, ways, tilts, looked, views, strict=True):
        poses = _measurement_poses(room, measurement, station, own[:MAX_KEPT_WAYS], tilt, solids)
        boxes = (*boxes_of(room, measurement.place, seen), *box_of(view), *poses.boxes)
        all_poses.append(
            replace(
                poses,
                boxes=boxes,
                own=footing.digest(measurement.place, how),
                near=standing_bodies.digest(boxes),
            )
        )
    return all_poses


def _measurement_poses(
    room: CellState,
    measurement: SoughtMeasurement,
    station: str,
    ways: Sequence[Floats],
    tilt: float,
    solids: Mapping[str, Solid],
) -> MeasurementPoses:
    """The poses of one measurement, or why it has none."""
    poses = MeasurementPoses(measurement.measurement, measurement.place.tool, station)
    if not ways:
        return replace(poses, reason=_no_pose_reason(room, measurement.place))
    if not measurement.how.field_m:
        return replace(poses, straight=tuple(ways), tilt_rad=tilt)
    patch = _middle_patch(room, measurement, ways, tilt)
    poses = replace(poses, straight=tuple(ways), tilt_rad=tilt, patch=patch)
    if measurement.how.ranging is None:
        return poses
    return _with_best_patch(room, measurement, poses, measurement.how.ranging, solids)


def _with_best_patch(
    room: CellState,
    measurement: SoughtMeasurement,
    poses: MeasurementPoses,
    ranging: Ranging,
    solids: Mapping[str, Solid],
) -> MeasurementPoses:
    """The poses with the patch that leaves the least uncertainty from the first of them, no wider
    than the one that all see.

    The box of all that the choice looked at is kept, too. Where no patch fits on the surface, the
    one before stays.
    """
    eye = eye_of(
        room.world, measurement.place, measurement.how, ranging, poses.straight[0][-1], solids
    )
    at = measurement.place.surface or measurement.place.placement
    surface = room.world.pose("world", at.parent) @ transforms.of_pose(at.pose)
    point, back = surface[:3, 3], transforms.inverse(eye.T_world_eye)
    most = max(measurement.how.patch_m[0], *(poses.patch.size_m if poses.patch else (0.0,)))
    own = transforms.apply(back, point[None])[0]
    sides = (min(measurement.how.patch_m[0], most), most)
    placed_patch = place_patch(
        list(eye.bodies.values()), ranging, own, back[:3, :3] @ -surface[:3, 2], sides
    )
    searched = (box_looked_at(eye, point, 2.0 * most),)
    if placed_patch is None:
        return replace(poses, boxes=searched)
    return replace(
        poses,
        patch=patch_of(eye, placed_patch, point),
        sigma_m=placed_patch.sigma_m,
        boxes=searched,
    )


def _no_pose_reason(room: CellState, place: Place) -> str:
    answer = room.reach.at(place)
    return answer.reason if isinstance(answer, UnreachedPlace) else "there is no straight way to it"


def _tilted_places(place: Place, tilt: float) -> Iterator[Place]:
    """The place with its tool tilted, in some directions; the place itself without a tilt."""
    if abs(tilt) < 1e-12:
        yield place
        return
    T = transforms.of_pose(place.placement.pose)
    for angle in np.arange(TILT_DIRECTIONS) * math.pi / TILT_DIRECTIONS:
        axis = (math.cos(angle), math.sin(angle), 0.0)
        turned = T @ transforms.transform(transforms.rotation(axis, tilt), np.zeros(3))
        leaning = Placement(place.placement.parent, transforms.to_pose(turned))
        yield replace(place, placement=leaning, surface=place.placement)


def _middle_patch(
    room: CellState, measurement: SoughtMeasurement, ways: Sequence[Floats], tilt: float
) -> Patch:
    """A patch in the middle of the picture, foreshortened by the tilt: as large as what is
    looked at, or as all ways let see.
    """
    least, most = measurement.how.patch_m
    wanted_side = min(max(measurement.width_m or most, least), most, measurement.how.field_m)
    for side in np.linspace(wanted_side, least, PATCH_SIZES):
        seen = replace(measurement.place, patch_m=float(side))
        if all(room.reach.sees(seen, way_in[-1]) for way_in in ways):
            break
    return Patch((0.0, 0.0), (float(side), float(side) * math.cos(tilt)))
