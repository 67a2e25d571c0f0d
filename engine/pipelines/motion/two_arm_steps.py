"""Steps that two arms take together: holding, handing over, or carrying one body.

The body goes up, across and down on straight lines; of several heights the least is taken on which
both arms follow and nothing touches. One arm's joints follow from the pose of the body, and so do
the other's, so only the path of the body is looked for (Han & Amato 2001: active and passive parts
of a closed chain).
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.motion_values import FINEST_M, LegKind, MovedStep, StepLeg, Unmoved
from cellwright.engine.pipelines.motion.arm_progress import (
    CARRYING_FACTOR,
    ArmsProgress,
    bodies_held,
    limits_at,
)
from cellwright.engine.pipelines.motion.cell_state import CellState, corners_within
from cellwright.engine.pipelines.motion.step_motion import CAREFUL_FACTOR, StepMotion
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.motion.timed_paths import JointLimits, fastest_trajectory
from cellwright.kb.model.cell_model import Ends, Operation, Place
from cellwright.kb.model.plan_model import Step

LIFTS_M = (0.05, 0.1, 0.2, 0.3, 0.0)  # how far the body is lifted before it goes across
CARRY_STEP_M = 0.005  # how often a pose of the body is looked at
CARRY_STEP_RAD = 0.02
OPEN_M = 2e-4  # how far a hand may be from its pose on the body


def carry_together(
    hands: ArmsProgress, before: CellState, after: CellState, first: Place, second: Place, body: str
) -> StepLeg | str:
    """The leg on which both arms bring a body from where it is before to where it is after; a text
    if there is none.

    The arms stand at their places, one with its hand at each. The leg is that of the first arm,
    with the other's beside it.
    """
    why = f"{first.arm} and {second.arm} cannot carry {body} all the way"
    start, end = before.world.pose("world", body), after.world.pose("world", body)
    for lift in LIFTS_M:
        T = body_path(start, end, lift)
        paths = _follow_body(before, (first.arm, second.arm), body, T)
        if paths is None:
            continue
        if (obstacle := _touches_on_way(before, (first, second), body, paths)) is None:
            return _carrying_leg(hands, before, (first.arm, second.arm), body, paths)
        why = obstacle
    return why


def body_path(start: Floats, end: Floats, lift_m: float) -> Floats:
    """Poses (m, 4, 4) of a body that goes up, across and down on straight lines, turning evenly
    on the way across.
    """
    up = transforms.translation(0.0, 0.0, lift_m)
    stops = [start, matmul(up, start), matmul(up, end), end]
    poses = [start[None]]
    for a, b in itertools.pairwise(stops):
        turn = transforms.rotation_vector(matmul(a[:3, :3].T, b[:3, :3]))
        angle, shift_m = float(np.linalg.norm(turn)), b[:3, 3] - a[:3, 3]
        count = int(
            np.ceil(max(float(np.linalg.norm(shift_m)) / CARRY_STEP_M, angle / CARRY_STEP_RAD))
        )
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            R = (
                transforms.rotation(tuple(turn / angle), share * angle)
                if angle > 1e-9
                else np.eye(3)
            )
            poses.append(
                transforms.transform(matmul(a[:3, :3], R), a[:3, 3] + share * shift_m)[None]
            )
    return np.concatenate(poses)


def _follow_body(
    room: CellState, arms: tuple[str, str], body: str, T_world_body: Floats
) -> list[Floats] | None:
    """The configurations (m, k) of each arm at common corners of a path of the body; None if an
    arm cannot follow.
    """
    world, paths = room.world, []
    is_kept: Truths = np.zeros(len(T_world_body), dtype=bool)
    for arm in arms:
        T_base_world, T_body_flange = (
            world.pose(f"{arm}.base", "world"),
            world.pose(body, f"{arm}.flange"),
        )
        poses = matmul(matmul(T_base_world, T_world_body), T_body_flange)[None]
        at = world.configurations[arm]
        configurations, follows = room.tracked(arm, poses, at[None])
        if not follows[0]:
            return None
        is_kept = is_kept | corners_within(world.models[arm], configurations, poses, OPEN_M / 2)[0]
        paths.append(configurations[0])
    return [np.ascontiguousarray(path[is_kept]) for path in paths]


def _touches_on_way(
    room: CellState, places: tuple[Place, Place], body: str, paths: list[Floats]
) -> str | None:
    """What is in the way of arms and body on their paths (m, k); None if they are proved to be
    free.
    """
    world = room.world.affix(body, f"{places[0].arm}.tool")
    allowed = frozenset[frozenset[str]]().union(*(room.reach.intended(place) for place in places))
    ground = PlanningScene(room.backend.checker(collision_scene_of(world, allowed=allowed)))
    whole = np.repeat(world.configuration[None], len(paths[0]), axis=0)
    for place, path in zip(places, paths, strict=True):
        first = world.first_carriers[place.arm]
        whole[:, first : first + path.shape[1]] = path
    hits = np.nonzero(ground.collides(whole))[0]
    if len(hits):
        contact = ground.contacts(whole[hits[0]])[0]
        return f"{contact.first} touches {contact.second} while {body} is carried"
    if proved(ground.proof(0.0, FINEST_M), np.ascontiguousarray(whole)) < len(whole) - 1:
        return f"it is not proved that {body} touches nothing while it is carried"
    return None


def _carrying_leg(
    hands: ArmsProgress, room: CellState, arms: tuple[str, str], body: str, paths: list[Floats]
) -> StepLeg:
    """Both arms at the same time, as fast as the slower one can."""
    limits = [limits_at(hands.cell.arms[arm].arm, CARRYING_FACTOR) for arm in arms]
    both = JointLimits(
        np.concatenate([limits_of_arm.speed for limits_of_arm in limits]),
        np.concatenate([limits_of_arm.acceleration for limits_of_arm in limits]),
        np.concatenate([limits_of_arm.jerk for limits_of_arm in limits]),
    )
    corners = fastest_trajectory(np.concatenate(paths, axis=1), both).corners_s
    load = (*bodies_held(room.world, arms[0]), body)
    second_leg = StepLeg(
        LegKind.CARRY, arms[1], paths[1], corners, True, (*bodies_held(room.world, arms[1]), body)
    )
    return StepLeg(LegKind.CARRY, arms[0], paths[0], corners, True, load, (second_leg,))


@dataclass(eq=False)
class TwoArmStep:
    """A step of several arms. `before` and `after` are the cell with these arms alone."""

    hands: ArmsProgress
    step: Step
    operation: Operation
    before: CellState
    after: CellState
    known: Sequence[Floats] = ()

    def moved(self) -> MovedStep | Unmoved:
        """The motion of the step, or why there is none; then the arms are where they were."""
        arms = tuple(self.before.world.cell.arms)
        stand = [(arm, self.hands.now(arm), self.hands.standing(arm)) for arm in arms]
        motion = self._moved()
        if isinstance(motion, Unmoved):
            for standing_arm in stand:
                self.hands.arrive(*standing_arm)
        return motion

    def _moved(self) -> MovedStep | Unmoved:
        place = self._place(str(self.operation.at))
        if self.operation.with_place is None:
            return self._alone(place, self.operation, self.after)
        second_place = self._place(str(self.operation.with_place))
        first = self._alone(second_place, replace(self.operation, ends=Ends.INSIDE), self.before)
        if isinstance(first, Unmoved):
            return first
        if self.operation.carries is not None:
            second = self._alone(place, replace(self.operation, ends=Ends.INSIDE), self.before)
        else:
            second = self._alone(place, self.operation, self.after)
        if isinstance(second, Unmoved):
            return second
        more = (
            self._carried(place, second_place)
            if self.operation.carries is not None
            else self._left(second_place)
        )
        if isinstance(more, str):
            return Unmoved(self.step.id, self.step.operator, place.name, "way", more)
        legs = (*first.legs, *second.legs, *more)
        return MovedStep(self.step.id, self.step.operator, place.name, legs, self.operation.takes_s)

    def _carried(self, place: Place, second_place: Place) -> list[StepLeg] | str:
        """Both arms bring the body to where it belongs, and leave it."""
        body, rooms = str(self.operation.carries), (self._now(self.before), self._now(self.after))
        load = carry_together(self.hands, *rooms, place, second_place, body)
        if isinstance(load, str):
            return load
        for leg in (load, *load.beside):
            self.hands.arrive(leg.arm, leg.path[-1], None)
        legs = [load]
        for carrying_place in (place, second_place):
            out = self._out(carrying_place)
            if isinstance(out, str):
                return out
            legs.append(out)
        return legs

    def _left(self, second_place: Place) -> list[StepLeg] | str:
        """The arm of `with` leaves its place, unless it holds on to what it held."""
        before, after = (
            bodies_held(room.world, second_place.arm) for room in (self.before, self.after)
        )
        if before == after:
            return []
        last = self._out(second_place)
        return last if isinstance(last, str) else [last]

    def _place(self, name: str) -> Place:
        return self.before.world.cell.places[name]

    def _now(self, room: CellState) -> CellState:
        """A room with the arms where they are."""
        world = room.world
        for arm in world.cell.arms:
            world = world.moved(arm, self.hands.now(arm))
        return CellState(world, room.backend, room.kinematics)

    def _alone(self, place: Place, operation: Operation, after: CellState) -> MovedStep | Unmoved:
        """What one of the arms does at its place, while the other one rests."""
        alone = replace(operation, with_place=None, carries=None)
        rooms = self._now(self.before), self._now(after)
        return StepMotion(self.hands, self.step, alone, place, *rooms, self.known).moved()

    def _out(self, place: Place) -> StepLeg | str:
        """Straight out of the place; a text if the arm cannot leave it."""
        room, q = self._now(self.after), self.hands.now(place.arm)
        path = room.straight(place, q, place.approach_m)
        if path is None or not room.is_free(place, path):
            return f"{place.arm} cannot leave {place.name} again"
        out = np.ascontiguousarray(path[::-1])
        self.hands.arrive(place.arm, out[-1], None)
        return self.hands.leg(LegKind.OUT, place.arm, out, room, factor=CAREFUL_FACTOR)
