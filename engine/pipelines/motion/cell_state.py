"""The cell in one state, ready for motions: its bodies, contacts, reach, and arms on rails."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Contact
from cellwright.engine.model.motion_values import FINEST_M
from cellwright.engine.ports import CollisionChecker, GeometryBackend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.kinematics.arm_model import (
    ArmModel,
    nearest_by_whole_turns,
    reachable_nearest_turns,
)
from cellwright.engine.stages.geometry.kinematics.inverse_kinematics import InverseKinematics
from cellwright.engine.stages.geometry.reach.place_reachability import PlaceReachability
from cellwright.engine.stages.geometry.world.collision_scene import riding_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.motion.path_proofs import touches_on_path
from cellwright.kb.model.cell_model import Cell, Operation, Place, Placement
from cellwright.kb.terms import Function

STRAIGHT_STEP_M = 0.01  # how often a straight way of the tool is looked at
STRAIGHT_TOLERANCE_M = 0.001  # how far the tool may be off the straight way between two corners
BRANCH_JUMP = 0.5  # rad or m: two configurations so far apart are of two branches


@dataclass(eq=False)
class CellState:
    """A world, with what is computed from it kept."""

    world: GeometricWorld
    backend: GeometryBackend
    kinematics: Mapping[str, InverseKinematics]
    _grounds: dict[tuple[str, str, tuple[str, ...]], PlanningScene] = field(default_factory=dict)
    _meetings: dict[tuple[str, str, tuple[str, ...]], PlanningScene] = field(default_factory=dict)
    _free: dict[tuple[str, str, tuple[str, ...], float, bytes], bool] = field(default_factory=dict)

    @cached_property
    def reach(self) -> PlaceReachability:
        """What is reached in this world."""
        return PlaceReachability(self.world, self.backend)

    def checker(self, place: Place) -> CollisionChecker:
        """What must not touch at a place; how deep what may touch is entered is not asked."""
        return self.ground(place).checker

    def ground(self, place: Place) -> PlanningScene:
        """What motions at a place are planned on."""
        key = (place.arm, place.tool, place.touches)
        if key not in self._grounds:
            self._grounds[key] = PlanningScene(self.reach.checker(place))
        return self._grounds[key]

    def free(self, arm: str) -> PlanningScene:
        """What motions between places are planned on: nothing may touch."""
        return self.ground(Place("", Placement(), arm))

    def whole(self, arm: str, q: Floats) -> Floats:
        """Configurations (n, k) of all joints of the world, of which those of one arm are given."""
        return self.reach.whole(Place("", Placement(), arm), q)

    def poses(self, place: Place, now: Floats, back_m: float = 0.0) -> Floats:
        """Configurations (n, k) that put the tool at a place, in any turn and branch, within the
        limits; the nearest first.

        What they touch is not looked at. With `back_m` the tool is so far back along its z.
        """
        return self.poses_at([place], now, back_m)[0]

    def poses_at(self, places: Sequence[Place], now: Floats, back_m: float = 0.0) -> list[Floats]:
        """The same for places of one arm."""
        targets = [self.reach.target(place, back_m) for place in places]
        arm, ends = places[0].arm, np.cumsum([len(target) for target in targets])[:-1]
        solutions = self.kinematics[arm].solve(np.concatenate(targets))
        ordered = []
        for place, q, valid in zip(
            places, np.split(solutions.q, ends), np.split(solutions.valid, ends), strict=True
        ):
            seen = valid & self.reach.seen_at(place, np.asarray(valid.any(axis=1)))[:, None]
            inside = reachable_nearest_turns(self._model(arm), q[seen], now)
            ordered.append(inside[np.argsort(np.abs(inside - now).max(axis=1), kind="stable")])
        return ordered

    def _model(self, arm: str) -> ArmModel:
        return self.world.models[arm]

    def straight(self, place: Place, at: Floats, back_m: float) -> Floats | None:
        """The straight way of the tool (m, k) from `back_m` before configuration `at` up to it;
        None if the arm cannot follow.
        """
        return self.straights(place, at[None], back_m)[0]

    def straights(self, place: Place, at: Floats, back_m: float) -> list[Floats | None]:
        """The same for configurations (n, k) with the tool of one place in hand."""
        count = max(1, int(np.ceil(back_m / STRAIGHT_STEP_M)))
        T_flange_tool = self.reach.flange_to_end(place)
        away = np.zeros((count + 1, 3))
        away[:, 2] = -np.linspace(0.0, back_m, count + 1)
        back = matmul(
            T_flange_tool, transforms.transform(np.eye(3)[None].repeat(count + 1, 0), away)
        )
        start = self._model(place.arm).flange_pose(at)
        lines = matmul(start[:, None], matmul(back, transforms.inverse(T_flange_tool))[None])
        paths = self.followed(place.arm, lines, at)
        return [None if path is None else np.ascontiguousarray(path[::-1]) for path in paths]

    def followed(self, arm: str, T_base_flange: Floats, at: Floats) -> list[Floats | None]:
        """Configurations (m, k) on which the flange goes through poses (n, m, 4, 4), from
        configurations `at` (n, k) on.

        Corners that the straight line between their neighbours passes near enough are left out.
        None where the arm cannot follow.
        """
        paths, follows = self.tracked(arm, T_base_flange, at)
        is_kept = corners_within(self._model(arm), paths, T_base_flange)
        return [
            path[corners] if follow else None
            for path, corners, follow in zip(paths, is_kept, follows, strict=True)
        ]

    def tracked(self, arm: str, T_base_flange: Floats, at: Floats) -> tuple[Floats, Truths]:
        """A configuration for each of the poses (n, m, 4, 4) of the flange, from configurations
        `at` (n, k) on, without a jump.

        Returns (n, m, k), and which of the rows (n,) the arm can follow.
        """
        model, (count, length) = self._model(arm), T_base_flange.shape[:2]
        solutions = self.kinematics[arm].solve(T_base_flange.reshape(-1, 4, 4))
        q = solutions.q.reshape(count, length, *solutions.q.shape[1:])
        valid = solutions.valid.reshape(count, length, -1)
        paths, follows = np.repeat(at[:, None], length, axis=1), np.ones(count, dtype=bool)
        for n in range(1, length):
            near, inside = nearest_by_whole_turns(model, q[:, n], paths[:, n - 1, None])
            away = np.where(
                inside & valid[:, n], np.abs(near - paths[:, n - 1, None]).max(axis=2), np.inf
            )
            best = np.argmin(away, axis=1)
            follows &= away[np.arange(count), best] <= BRANCH_JUMP
            paths[:, n] = near[np.arange(count), best]
        return paths, follows

    def is_free(self, place: Place, path: Floats) -> bool:
        """Whether nothing touches that must not, or deeper than it may, anywhere on a path (m, k)
        of the place's arm.

        The way back is as free as the way there.
        """
        same = min(path.tobytes(), path[::-1].tobytes())
        key = (place.arm, place.tool, place.touches, place.depth_m, same)
        if key not in self._free:
            self._free[key] = self._found_free(place, path)
        return self._free[key]

    def _found_free(self, place: Place, path: Floats) -> bool:
        ground, whole = self.ground(place), self.whole(place.arm, path)
        if ground.collides(whole).any():
            return False
        if len(path) > 1 and proved(ground.proof(0.0, FINEST_M), whole) < len(whole) - 1:
            return False
        met = touches_on_path(self._meeting(place), whole, place.depth_m) if place.touches else ()
        return all(touch.proved for touch in met)

    def _meeting(self, place: Place) -> PlanningScene:
        key = (place.arm, place.tool, place.touches)
        if key not in self._meetings:
            self._meetings[key] = PlanningScene(self.reach.meeting(place))
        return self._meetings[key]

    def collides(self, place: Place, q: Floats) -> Truths:
        """Whether something touches that must not, or deeper than it may, for configurations
        (n, k).
        """
        return self.reach.collides(place, self.whole(place.arm, q))

    def touching(self, place: Place, q: Floats) -> tuple[Contact, ...]:
        """What touches at one configuration (k,) and must not, or deeper than it may."""
        return self.reach.contacts(place, self.whole(place.arm, q[None])[0])


def corners_within(
    model: ArmModel, paths: Floats, poses: Floats, within_m: float = STRAIGHT_TOLERANCE_M
) -> Truths:
    """Which corners of paths (n, m, k) are kept (n, m): the straight line of the joints from each
    to the next keeps the flange within a distance of its poses (n, m, 4, 4).
    """
    is_kept = np.zeros(paths.shape[:2], dtype=bool)
    is_kept[:, [0, -1]] = True
    waiting = [(np.arange(len(paths)), 0, paths.shape[1] - 1)]
    while waiting:
        rows, first, last = waiting.pop()
        if last - first < 2 or not len(rows):
            continue
        share = np.linspace(0.0, 1.0, last - first + 1)[1:-1, None]
        ends = paths[rows, first, None], paths[rows, last, None]
        between = model.flange_pose(ends[0] + share * (ends[1] - ends[0]))
        off = np.linalg.norm(between[..., :3, 3] - poses[rows, first + 1 : last, :3, 3], axis=2)
        far, middle = rows[(off >= within_m).any(axis=1)], (first + last) // 2
        is_kept[far, middle] = True
        waiting += [(far, first, middle), (far, middle, last)]
    return is_kept


# places of a ride at which contacts are looked for, before the whole ride is proved
RIDE_LOOKS = 65


@dataclass(frozen=True, slots=True, eq=False)
class BodyRide:
    """A body on its way from one value of its joint to another, in a scene whose first joint is
    that one.
    """

    ground: PlanningScene
    first: float
    last: float

    @classmethod
    def of(cls, room: CellState, body: str, first: float, last: float) -> "BodyRide":
        """The ride of a body in a room."""
        return cls(
            PlanningScene(room.backend.checker(riding_scene_of(room.world, body))), first, last
        )

    def touched(self, q: Floats) -> tuple[str, ...]:
        """The bodies that touch somewhere on the ride while all arms rest at a configuration
        (k,); those of the first place.
        """
        along = self._along(q, RIDE_LOOKS)
        hits = self.ground.collides(along)
        if not hits.any():
            return ()
        contacts = self.ground.contacts(along[int(np.argmax(hits))])
        return tuple(
            sorted({name for contact in contacts for name in (contact.first, contact.second)})
        )

    def proved(self, q: Floats) -> bool:
        """Whether nothing touches anywhere on the ride."""
        return bool(proved(self.ground.proof(0.0, FINEST_M), self._along(q, 2)) == 1)

    def _along(self, q: Floats, count: int) -> Floats:
        values = np.linspace(self.first, self.last, count)[:, None]
        return np.ascontiguousarray(np.hstack([values, np.repeat(q[None], count, axis=0)]))


def arms_of_step(cell: Cell, step: Function, operation: Operation | None) -> tuple[str, ...]:
    """The arms that a step names, that its places belong to, or that its body carries; in the
    order of the cell.
    """
    if len(cell.arms) == 1:
        return tuple(cell.arms)
    named = {str(argument) for argument in step.arguments}
    if operation is not None:
        beside = () if operation.with_place is None else (operation.with_place,)
        ends = map(str, (*operation.stops, *beside))
        named |= {cell.places[place_name].arm for place_name in ends if place_name in cell.places}
        named |= set(_carried_arms(cell, operation.drives)) if operation.drives else set()
    return tuple(arm for arm in cell.arms if arm in named)


def _carried_arms(cell: Cell, body: str) -> list[str]:
    """The arms that a body carries."""
    world = GeometricWorld.of(cell)
    return [arm for arm in cell.arms if body in world.supports(f"{arm}.base")]
