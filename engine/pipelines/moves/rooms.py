"""The cell in one state, ready for motions: where the bodies are, what may touch, and what an arm reaches."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Contact, Floats, Truths
from cellwright.engine.model.motion import FINEST_M
from cellwright.engine.ports import CollisionChecker, GeometryBackend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.ground import Ground
from cellwright.engine.stages.geometry.kinematics.arms import ArmModel
from cellwright.engine.stages.geometry.kinematics.inverse import InverseKinematics
from cellwright.engine.stages.geometry.kinematics.turning import nearest_turns, turned_near
from cellwright.engine.stages.geometry.reach.reach import Reachability
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.motion.touching import touches
from cellwright.kb.model.cell import Place, Placement

STRAIGHT_STEP_M = 0.01  # how often a straight way of the tool is looked at
STRAIGHT_TOLERANCE_M = 0.001  # how far the tool may be off the straight way between two corners
JUMP = 0.5  # rad or m: two configurations so far apart are of two branches


@dataclass(eq=False)
class Room:
    """A world, with what is computed from it kept."""

    world: World
    backend: GeometryBackend
    kinematics: Mapping[str, InverseKinematics]
    _grounds: dict[tuple[str, str, tuple[str, ...]], Ground] = field(default_factory=dict)
    _meetings: dict[tuple[str, str, tuple[str, ...]], Ground] = field(default_factory=dict)
    _free: dict[tuple[str, str, tuple[str, ...], float, bytes], bool] = field(default_factory=dict)

    @cached_property
    def reach(self) -> Reachability:
        """What is reached in this world."""
        return Reachability(self.world, self.backend)

    def checker(self, place: Place) -> CollisionChecker:
        """What must not touch at a place; how deep what may touch is entered is not asked."""
        return self.ground(place).checker

    def ground(self, place: Place) -> Ground:
        """What motions at a place are planned on."""
        key = (place.arm, place.tool, place.touches)
        if key not in self._grounds:
            self._grounds[key] = Ground(self.reach.checker(place))
        return self._grounds[key]

    def free(self, arm: str) -> Ground:
        """What motions between places are planned on: nothing may touch."""
        return self.ground(Place("", Placement(), arm))

    def whole(self, arm: str, q: Floats) -> Floats:
        """Configurations (n, k) of all joints of the world, of which those of one arm are given."""
        return self.reach.whole(Place("", Placement(), arm), q)

    def poses(self, place: Place, now: Floats, back_m: float = 0.0) -> Floats:
        """Configurations (n, k) that put the tool at a place, in any turn and branch, within the limits; the nearest first.

        What they touch is not looked at. With `back_m` the tool is so far back along its z.
        """
        return self.poses_at([place], now, back_m)[0]

    def poses_at(self, places: Sequence[Place], now: Floats, back_m: float = 0.0) -> list[Floats]:
        """The same for places of one arm."""
        targets = [self.reach.target(place, back_m) for place in places]
        arm, ends = places[0].arm, np.cumsum([len(each) for each in targets])[:-1]
        found = self.kinematics[arm].solve(np.concatenate(targets))
        ordered = []
        for place, q, valid in zip(places, np.split(found.q, ends), np.split(found.valid, ends), strict=True):
            seen = valid & self.reach.seen_at(place, np.asarray(valid.any(axis=1)))[:, None]
            inside = nearest_turns(self._model(arm), q[seen], now)
            ordered.append(inside[np.argsort(np.abs(inside - now).max(axis=1), kind="stable")])
        return ordered

    def _model(self, arm: str) -> ArmModel:
        return self.world.models[arm]

    def straight(self, place: Place, at: Floats, back_m: float) -> Floats | None:
        """The straight way of the tool (m, k) from `back_m` before configuration `at` up to it; None if the arm cannot follow."""
        return self.straights(place, at[None], back_m)[0]

    def straights(self, place: Place, at: Floats, back_m: float) -> list[Floats | None]:
        """The same for configurations (n, k) with the tool of one place in hand."""
        count = max(1, int(np.ceil(back_m / STRAIGHT_STEP_M)))
        T_flange_tool = self.reach.flange_to_end(place)
        away = np.zeros((count + 1, 3))
        away[:, 2] = -np.linspace(0.0, back_m, count + 1)
        back = matmul(T_flange_tool, transforms.transform(np.eye(3)[None].repeat(count + 1, 0), away))
        start = self._model(place.arm).flange_pose(at)
        lines = matmul(start[:, None], matmul(back, transforms.inverse(T_flange_tool))[None])
        paths = self.followed(place.arm, lines, at)
        return [None if path is None else np.ascontiguousarray(path[::-1]) for path in paths]

    def followed(self, arm: str, T_base_flange: Floats, at: Floats) -> list[Floats | None]:
        """Configurations (m, k) on which the flange goes through poses (n, m, 4, 4), from configurations `at` (n, k) on.

        Corners that the straight line between their neighbours passes near enough are left out. None where the arm cannot follow.
        """
        paths, follows = self.tracked(arm, T_base_flange, at)
        kept = corners_within(self._model(arm), paths, T_base_flange)
        return [
            path[corners] if follow else None
            for path, corners, follow in zip(paths, kept, follows, strict=True)
        ]

    def tracked(self, arm: str, T_base_flange: Floats, at: Floats) -> tuple[Floats, Truths]:
        """A configuration for each of the poses (n, m, 4, 4) of the flange, from configurations `at` (n, k) on, without a jump.

        Returns (n, m, k), and which of the rows (n,) the arm can follow.
        """
        model, (count, length) = self._model(arm), T_base_flange.shape[:2]
        found = self.kinematics[arm].solve(T_base_flange.reshape(-1, 4, 4))
        q = found.q.reshape(count, length, *found.q.shape[1:])
        valid = found.valid.reshape(count, length, -1)
        paths, follows = np.repeat(at[:, None], length, axis=1), np.ones(count, dtype=bool)
        for n in range(1, length):
            near, inside = turned_near(model, q[:, n], paths[:, n - 1, None])
            away = np.where(inside & valid[:, n], np.abs(near - paths[:, n - 1, None]).max(axis=2), np.inf)
            best = np.argmin(away, axis=1)
            follows &= away[np.arange(count), best] <= JUMP
            paths[:, n] = near[np.arange(count), best]
        return paths, follows

    def is_free(self, place: Place, path: Floats) -> bool:
        """Whether nothing touches that must not, or deeper than it may, anywhere on a path (m, k) of the place's arm.

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
        met = touches(self._meeting(place), whole, place.depth_m) if place.touches else ()
        return all(each.proved for each in met)

    def _meeting(self, place: Place) -> Ground:
        key = (place.arm, place.tool, place.touches)
        if key not in self._meetings:
            self._meetings[key] = Ground(self.reach.meeting(place))
        return self._meetings[key]

    def collides(self, place: Place, q: Floats) -> Truths:
        """Whether something touches that must not, or deeper than it may, for configurations (n, k)."""
        return self.reach.collides(place, self.whole(place.arm, q))

    def touching(self, place: Place, q: Floats) -> tuple[Contact, ...]:
        """What touches at one configuration (k,) and must not, or deeper than it may."""
        return self.reach.contacts(place, self.whole(place.arm, q[None])[0])


def corners_within(
    model: ArmModel, paths: Floats, poses: Floats, within_m: float = STRAIGHT_TOLERANCE_M
) -> Truths:
    """Which corners of paths (n, m, k) are kept (n, m): the straight line of the joints from each to the next keeps the flange
    within a distance of its poses (n, m, 4, 4).
    """
    kept = np.zeros(paths.shape[:2], dtype=bool)
    kept[:, [0, -1]] = True
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
        kept[far, middle] = True
        waiting += [(far, first, middle), (far, middle, last)]
    return kept
