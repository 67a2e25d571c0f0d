"""The cell in one state, ready for motions: where the bodies are, what may touch, and what an arm reaches."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from engine.kernels.geometry.proof import proved
from engine.kernels.linear import matmul
from engine.model.geometry import Contact, Floats
from engine.model.motion import FINEST_M
from engine.ports import CollisionChecker, GeometryBackend
from engine.stages.geometry import transforms
from engine.stages.geometry.collision.ground import Ground
from engine.stages.geometry.kinematics.arms import ArmModel
from engine.stages.geometry.kinematics.inverse import InverseKinematics
from engine.stages.geometry.reach.reach import Reachability
from engine.stages.geometry.world.model import World
from kb.model.cell import Place, Placement

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

    @cached_property
    def reach(self) -> Reachability:
        """What is reached in this world."""
        return Reachability(self.world, self.backend)

    def checker(self, place: Place) -> CollisionChecker:
        """What must not touch at a place."""
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

    def poses(self, place: Place, now: Floats) -> Floats:
        """Configurations (n, k) that put the tool at a place, in any turn and branch, within the limits; the nearest first.

        What they touch is not looked at.
        """
        found = self.kinematics[place.arm].solve(self.reach.target(place))
        inside = nearest_turns(self._model(place.arm), found.q[found.valid], now)
        ordered: Floats = inside[np.argsort(np.abs(inside - now).max(axis=1), kind="stable")]
        return ordered

    def _model(self, arm: str) -> ArmModel:
        return self.world.models[arm]

    def straight(self, place: Place, at: Floats, back_m: float) -> Floats | None:
        """The straight way of the tool (m, k) from `back_m` before configuration `at` up to it; None if the arm cannot follow."""
        count = max(1, int(np.ceil(back_m / STRAIGHT_STEP_M)))
        T_flange_tool = self.reach.flange_to_end(place)
        start = self._model(place.arm).flange_pose(at)
        backs = [
            matmul(
                start,
                T_flange_tool,
                transforms.translation(0.0, 0.0, -away),
                transforms.inverse(T_flange_tool),
            )
            for away in np.linspace(0.0, back_m, count + 1)
        ]
        path = self.followed(place.arm, np.array(backs), at)
        return None if path is None else np.ascontiguousarray(path[::-1])

    def followed(self, arm: str, T_base_flange: Floats, at: Floats) -> Floats | None:
        """Configurations (m, k) on which the flange goes through poses (n, 4, 4), from configuration `at` on.

        Corners that the straight line between their neighbours passes near enough are left out. None if the arm cannot follow.
        """
        model, found = self._model(arm), self.kinematics[arm].solve(T_base_flange)
        path = [at]
        for n in range(1, len(T_base_flange)):
            near = nearest_turns(model, found.q[n][found.valid[n]], path[-1])
            away = np.abs(near - path[-1]).max(axis=1)
            if not len(near) or away.min() > JUMP:
                return None
            path.append(near[int(np.argmin(away))])
        return _thinned(model, np.array(path), T_base_flange)

    def is_free(self, place: Place, path: Floats) -> bool:
        """Whether nothing touches that must not, anywhere on a path (m, k) of the place's arm."""
        ground, whole = self.ground(place), self.whole(place.arm, path)
        if ground.collides(whole).any():
            return False
        return len(path) < 2 or proved(ground.proof(0.0, FINEST_M), whole) == len(whole) - 1

    def touching(self, place: Place, q: Floats) -> tuple[Contact, ...]:
        """What touches at one configuration (k,)."""
        return self.ground(place).contacts(self.whole(place.arm, q[None])[0])


def nearest_turns(model: ArmModel, q: Floats, now: Floats) -> Floats:
    """Configurations (m, k) within the limits: those of `q` (n, k), turned by whole turns to be nearest to `now` (k,).

    Those that no turn brings within the limits are left out.
    """
    joints, turn = model.joints, 2 * math.pi
    whole = np.round((now - q) / turn)
    choices = np.stack([whole + more for more in (0.0, -1.0, 1.0, -2.0, 2.0)])
    values = q + np.where(joints.prismatic, 0.0, choices * turn)
    within = (values >= joints.lower - 1e-9) & (values <= joints.upper + 1e-9)
    far = np.where(within, np.abs(values - now), np.inf)
    best = np.argmin(far, axis=0)
    found: Floats = np.take_along_axis(values, best[None], axis=0)[0]
    inside: Floats = found[np.isfinite(far.min(axis=0)).all(axis=1)]
    return inside


def _thinned(model: ArmModel, path: Floats, poses: Floats) -> Floats:
    """The corners of a path (n, k) between which the straight line of the joints keeps the flange near its poses (n, 4, 4)."""
    kept, first = [0], 0
    while first < len(path) - 1:
        last = next(
            (n for n in range(len(path) - 1, first + 1, -1) if _passes(model, path, poses, first, n)),
            first + 1,
        )
        kept.append(last)
        first = last
    found: Floats = path[kept]
    return found


def _passes(model: ArmModel, path: Floats, poses: Floats, first: int, last: int) -> bool:
    share = np.linspace(0.0, 1.0, last - first + 1)[1:-1, None]
    between = model.flange_pose(path[first] + share * (path[last] - path[first]))
    off = np.linalg.norm(between[:, :3, 3] - poses[first + 1 : last, :3, 3], axis=1)
    return bool((off < STRAIGHT_TOLERANCE_M).all())
