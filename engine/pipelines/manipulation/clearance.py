"""Tells whether a part has room at its goal, and plans its insertion where it is tight."""

from collections.abc import Callable

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply
from cellwright.engine.pipelines.manipulation.place_answers import NotPlaced
from cellwright.engine.pipelines.manipulation.workspace import PlaceTask
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.world.collision_scene import free_scene_of
from cellwright.engine.stages.grasping.hole_insertion import Insertion, plan_insertion

PRESSED_M = 0.002  # errors of what was found; what is deeper is no touch


def no_room(task: PlaceTask, T_world_part: Floats) -> NotPlaced | None:
    """What is said where a part would be inside another body at a pose; None if it would not."""
    checker = geometry_backend().checker(free_scene_of(task.world, task.part))
    deepest = next(iter(checker.contacts(T_world_part, 0.0)), None)
    if deepest is None or deepest.distance_m > -PRESSED_M:
        return None
    touched = deepest.second if deepest.first == task.part else deepest.first
    depth = -1000 * deepest.distance_m
    reason = f"at its goal {task.part} would be {depth:.1f} mm inside {touched}"
    return NotPlaced("room", reason, f"move {touched} away, or relate {task.part} otherwise")


LOOSE_M = 0.003  # a part with more room than this is not inserted, but laid down
MAX_TOUCH_DEPTH_M = 2e-5  # what overlaps by less does not count: relations are met to this
ROOM_STEP_M = 5e-6  # how exactly the room is found
STEP_M, HIGHEST_M = 0.002, 0.15  # how far up a part is lifted until it is free
# how high the corners of the lower end are, and how many a round one has at least
LEVEL_M, ROUND = 1e-4, 12
SIDE_DIRECTIONS = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.arange(8) * np.pi / 4])
Free = Callable[[Floats], bool]


def insertion_of(task: PlaceTask, covariance: Floats, T_part_hand: Floats) -> Insertion | None:
    """The insertion at the goal of a part whose pose there is doubted by `covariance` (6, 6); None
    if it is not enclosed there.

    The hole is believed where it is modelled, and the arm is as exact as the scene says; the part
    goes in along the vertical, held by a hand at T_part_hand (4, 4). It searches where three
    standard deviations across exceed the room.
    """
    free = _free_at(task)
    room = _least_room(task.T_goal, free)
    if room is None:
        return None
    depth = _enclosed_depth(task.T_goal, free)
    doubted = covariance[:2, :2] + task.scene.hand.accuracy_m**2 * np.eye(2)
    lowest = apply(task.T_goal, task.holds.solid.vertices)
    length = float((task.T_goal @ T_part_hand)[2, 3] - lowest[:, 2].min())
    return (
        plan_insertion(depth, room, doubted, round_m(lowest, room), length) if depth > 0 else None
    )


def round_m(points: Floats, room_m: float) -> float:
    """The radius of the lower end of a part with some corners (n, 3) if that is round to within
    the room, else 0.
    """
    low = np.unique(np.round(points[points[:, 2] < points[:, 2].min() + LEVEL_M, :2], 6), axis=0)
    if len(low) < ROUND:
        return 0.0
    radii = np.linalg.norm(low - (low.min(axis=0) + low.max(axis=0)) / 2, axis=1)
    return float(radii.max()) if np.ptp(radii) < room_m else 0.0


def _free_at(task: PlaceTask) -> Free:
    checker = geometry_backend().checker(free_scene_of(task.world, task.part))

    def free(T: Floats) -> bool:
        deepest = next(iter(checker.contacts(T, 0.0)), None)
        return deepest is None or deepest.distance_m > -MAX_TOUCH_DEPTH_M

    return free


def _shift_pose(T: Floats, by: Floats) -> Floats:
    shifted = T.copy()
    shifted[:3, 3] += by
    return shifted


def _least_room(T: Floats, free: Free) -> float | None:
    """The least room (m) on each side of a part that is enclosed on all sides; None if it is
    not, or does not fit at all.
    """
    if not free(T):
        return None
    least = np.inf
    for direction in SIDE_DIRECTIONS[:4]:
        both = [_least_stop(T, sense * direction, free) for sense in (1.0, -1.0)]
        if None in both:
            return None
        least = min(least, sum(stop for stop in both if stop is not None) / 2)
    return float(least) if least > ROOM_STEP_M else None


def _least_stop(T: Floats, direction: Floats, free: Free) -> float | None:
    """How far (m) the part can go some way; None if farther than what is tight."""
    if free(_shift_pose(T, LOOSE_M * direction)):
        return None
    low, high = 0.0, LOOSE_M
    while high - low > ROOM_STEP_M:
        middle = (low + high) / 2
        low, high = (middle, high) if free(_shift_pose(T, middle * direction)) else (low, middle)
    return low


def _enclosed_depth(T: Floats, free: Free) -> float:
    """How far (m) up the part is enclosed on some side; 0 if it is nowhere free above."""
    for height in np.arange(STEP_M, HIGHEST_M, STEP_M):
        up = np.array([0.0, 0.0, height])
        if all(free(_shift_pose(T, LOOSE_M * direction + up)) for direction in SIDE_DIRECTIONS):
            return float(height)
    return 0.0
