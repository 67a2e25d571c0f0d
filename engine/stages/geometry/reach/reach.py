"""Which places of a cell an arm reaches, and why it does not reach the others.

A place asks for a pose of the tool point (or of the tip of a tool in hand), and for a second pose backed off
along the tool's z. Every branch of the inverse kinematics is tried. For tools that may turn about their own z
a ring of poses is tried. A configuration counts if it is within the joint limits and touches only what the
place allows, no deeper than it allows.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import Contact, Floats, Truths
from cellwright.engine.ports import CollisionChecker, GeometryBackend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.inverse import Branches, InverseKinematics
from cellwright.engine.stages.geometry.kinematics.turning import nearest_turns
from cellwright.engine.stages.geometry.reach.seeing import Seeing, Unseen, View, best
from cellwright.engine.stages.geometry.reach.shallow import Shallow
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.geometry.world.scenes import scene_of, scene_of_pairs
from cellwright.kb.model.cell import Place

TURNS = 24  # poses tried for a tool that may turn about its own z
ORIENTATIONS = 256  # orientations tried, to find out whether the position alone can be reached
NEAR_MISSES = 3


@dataclass(frozen=True, slots=True, eq=False)
class Reached:
    """Configurations (m, k) of the place's arm that reach the pose, within the limits and without collision.

    Among those that differ only by whole turns, the one nearest to the arm's present configuration is kept.
    """

    q: Floats


@dataclass(frozen=True, slots=True)
class Unreached:
    """The answer for a place that is not reached.

    `reason` is a sentence for people, without the place's name; `hint` says what to try.
    """

    reason: str
    hint: str


class Reachability:
    """Finds out which places are reached in one world.

    Inverse kinematics and scenes are kept from place to place.
    """

    def __init__(self, world: World, backend: GeometryBackend) -> None:
        self._world, self._backend = world, backend
        self._kinematics = {name: InverseKinematics(model) for name, model in world.models.items()}
        self._checkers: dict[tuple[str, str, tuple[str, ...]], CollisionChecker] = {}
        self._meetings: dict[tuple[str, str, tuple[str, ...]], CollisionChecker] = {}
        self._seeing: dict[tuple[str, str], Seeing | None] = {}
        self._views: dict[Place, list[View]] = {}

    def at(self, place: Place) -> Reached | Unreached:
        """The configurations in which the arm reaches a place, or why it does not reach it."""
        goal = self._answer(place, 0.0)
        if isinstance(goal, Unreached) or place.approach_m == 0.0:
            return goal
        before = self._answer(place, place.approach_m)
        if isinstance(before, Unreached):
            return replace(before, reason=f"approaching it from {place.approach_m:g} m, {before.reason}")
        return goal

    def target(self, place: Place, back_m: float = 0.0) -> Floats:
        """T_base_flange for a place, backed off along the tool's z: (n, 4, 4), one for each angle of the tool."""
        ends = matmul(self._turned(place), transforms.translation(0.0, 0.0, -back_m))
        poses: Floats = matmul(ends, transforms.inverse(self.flange_to_end(place)))
        return poses

    def seen_at(self, place: Place, asked: Truths) -> Truths:
        """At which angles of the tool (n,), of those that are asked about, the patch at a place is seen; all if nothing is declared."""
        if self.seeing(place) is None:
            return asked
        found = asked.copy()
        found[asked] = [each is None for each in self._unseen_from(place, self._turned(place)[asked])]
        return found

    def _turned(self, place: Place) -> Floats:
        """T_base_end (n, 4, 4) at a place, one for each angle of the tool."""
        base = self._world.pose(f"{place.arm}.base", place.placement.parent)
        angles = np.arange(TURNS if place.turns else 1) * 2 * math.pi / TURNS
        around = transforms.transform(transforms.rotation((0, 0, 1), angles), np.zeros(3))
        ends: Floats = matmul(base, transforms.of_pose(place.placement.pose), around)
        return ends

    def seeing(self, place: Place) -> Seeing | None:
        """What the tool of a place sees; None if the cell does not declare it as a scanner."""
        key = (place.arm, place.tool)
        if key not in self._seeing:
            how = self._world.cell.measuring.get(place.tool)
            sight = how.sight if how else None
            self._seeing[key] = Seeing(self._world, *key, how, sight) if how and sight else None
        return self._seeing[key]

    def _unseen_from(self, place: Place, T_base_end: Floats) -> list[Unseen | None]:
        seeing = self.seeing(place)
        assert seeing is not None
        ends = matmul(self._world.pose("world", f"{place.arm}.base"), T_base_end)
        self._views.setdefault(place, []).extend(seeing.view(place, T) for T in ends)
        return [seeing.unseen(place, T) for T in ends]

    def sees(self, place: Place, q: Floats) -> bool:
        """Whether the patch at a place is seen at a configuration (k,) of its arm; where nothing is declared, it is."""
        if self.seeing(place) is None:
            return True
        T_base_end = matmul(self._world.models[place.arm].flange_pose(q), self.flange_to_end(place))
        return self._unseen_from(place, T_base_end[None])[0] is None

    def unseen(self, place: Place) -> Unseen | None:
        """Why the patch at a place is not seen at any angle of the tool; None if it is seen."""
        if self.seeing(place) is None:
            return None
        found = self._unseen_from(place, self._turned(place))
        return best(found) if all(each is not None for each in found) else None

    def looked_through(self, place: Place) -> list[View]:
        """What a scanner has looked through at a place so far; empty for another tool."""
        return self._views.get(place, [])

    def flange_to_end(self, place: Place) -> Floats:
        """T_flange_end (4, 4): the tool point, or the tip of the tool held there."""
        T = transforms.of_pose(self._world.cell.arms[place.arm].tool)
        if place.tool:
            tip = transforms.of_pose(self._world.cell.bodies[place.tool].features["tip"])
            T = matmul(T, transforms.inverse(self._world.grip(place.tool)), tip)
        return T

    def _answer(self, place: Place, back_m: float) -> Reached | Unreached:
        poses = self.target(place, back_m)
        found = self._kinematics[place.arm].solve(poses)
        if not found.valid.any():
            return self._why_too_far(place, poses)
        solved: Truths = np.asarray(found.valid.any(axis=1))
        seen = self.seen_at(place, solved)
        if not seen.any():
            return self._why_unseen(place, solved)
        found = replace(found, valid=found.valid & seen[:, None])
        within = self._within_limits(place.arm, found)
        if not len(within):
            return self._why_limited(place, found)
        whole = self.whole(place, within)
        hits = self.collides(place, whole)
        if hits.all():
            return self._why_blocked(place, whole)
        return Reached(within[~hits])

    def _within_limits(self, arm: str, found: Branches) -> Floats:
        """Every branch of every pose that can be within the limits, with the whole turns that bring it
        nearest to the arm's present configuration.
        """
        return nearest_turns(self._world.models[arm], found.q[found.valid], self._world.configurations[arm])

    def whole(self, place: Place, q: Floats) -> Floats:
        """Configurations of all arms: those given for one arm, with the other arms as they stand."""
        first = self._world.first_carriers[place.arm]
        whole = np.repeat(self._world.configuration[None], len(q), axis=0)
        whole[:, first : first + q.shape[1]] = q
        return whole

    def checker(self, place: Place) -> CollisionChecker:
        """A checker of the scene with the place's tool in hand.

        What the place lists in `touches` may touch the tool and its parts; how deep is not asked here.
        """
        key = (place.arm, place.tool, place.touches)
        if key not in self._checkers:
            scene = scene_of(self._holding(place), allowed=self.intended(place))
            self._checkers[key] = self._backend.checker(scene)
        return self._checkers[key]

    def meeting(self, place: Place) -> CollisionChecker:
        """A checker of what touches by intention at a place, and of nothing else: of few pairs, whose depths are exact."""
        key = (place.arm, place.tool, place.touches)
        if key not in self._meetings:
            scene = scene_of_pairs(self._holding(place), self.intended(place))
            self._meetings[key] = self._backend.checker_of_few(scene)
        return self._meetings[key]

    def shallow(self, place: Place) -> CollisionChecker:
        """A checker that knows both: what may touch at a place must not do so deeper than the place says."""
        checker = self.checker(place)
        return Shallow(checker, self.meeting(place), place.depth_m) if place.touches else checker

    def collides(self, place: Place, whole: Floats) -> Truths:
        """Whether something touches that must not at a place, or is touched deeper than it may be, for configurations (n, k)."""
        return self.shallow(place).collides(whole)

    def contacts(self, place: Place, whole: Floats) -> tuple[Contact, ...]:
        """What touches at a place and must not, or deeper than it may, in one configuration (k,): the deepest first."""
        return self.shallow(place).contacts(whole)

    def _holding(self, place: Place) -> World:
        return self._world.held(place.tool, place.arm) if place.tool else self._world

    def intended(self, place: Place) -> frozenset[frozenset[str]]:
        """The pairs that touch by intention at a place: its `touches`, with the last two links and what the arm carries."""
        world = self._holding(place)
        carried = [body for body in world.cell.bodies if f"{place.arm}.base" in world.supports(body)[1:]]
        links = [f"{place.arm}.{link.name}" for link in world.cell.arms[place.arm].arm.links[-2:]]
        ends = [*carried, *links]
        return frozenset(frozenset((end, other)) for end in ends for other in place.touches)

    def _why_unseen(self, place: Place, asked: Truths) -> Unreached:
        told = best(self._unseen_from(place, self._turned(place)[asked]))
        return Unreached(told.reason, "move what is in the way, or allow other `tilts` or a smaller `patch`")

    def _why_too_far(self, place: Place, poses: Floats) -> Unreached:
        """Whether the position alone can be reached, in some orientation."""
        T_flange_end = self.flange_to_end(place)
        position = matmul(poses[0], T_flange_end)[:3, 3]
        any_way = matmul(transforms.transform(_orientations(), position), transforms.inverse(T_flange_end))
        if self._kinematics[place.arm].solve(any_way).valid.any():
            reason = f"{place.arm} reaches the position, but not in this orientation"
            return Unreached(reason, "give it another `rpy`, or let the tool turn with `turns: true`")
        away = f"{norm(position):.2f} m from its base"
        return Unreached(
            f"it is out of the reach of {place.arm}: {away}", "move the place, or the arm's base"
        )

    def _why_blocked(self, place: Place, whole: Floats) -> Unreached:
        """What collides in the configurations (n, k) that are nearest to being free."""
        clearance = self.shallow(place).clearance(whole, 0.0)
        told: dict[str, Contact] = {}
        for n in np.argsort(-clearance, kind="stable")[:NEAR_MISSES]:
            for contact in self.contacts(place, whole[n]):
                ends = contact.first, contact.second
                one, other = ends[::-1] if contact.first in place.touches else ends
                told.setdefault(f"{one} touches {other}", contact)
        shown = [
            f"{said} by {contact.depth_m * 1000:.0f} mm" for said, contact in list(told.items())[:NEAR_MISSES]
        ]
        every = "every configuration" if len(whole) > 1 else "the only configuration"
        reason = f"{every} is in collision: {', '.join(shown)}"
        return Unreached(reason, _hint(place, told.values()))

    def _why_limited(self, place: Place, found: Branches) -> Unreached:
        """The joint that leaves its limits in the best branch, and by how much."""
        model = self._world.models[place.arm]
        q = found.q[found.valid][:, :, None] + np.where(model.joints.prismatic, 0.0, 2 * math.pi)[:, None] * [
            -1,
            0,
            1,
        ]
        below, above = model.joints.lower[:, None] - q, q - model.joints.upper[:, None]
        beyond = np.maximum(below, above).clip(min=0.0).min(axis=2)
        best = int(np.argmin(beyond.max(axis=1)))
        joint = int(np.argmax(beyond[best]))
        amount, unit = float(beyond[best, joint]), "m"
        if not model.joints.prismatic[joint]:
            amount, unit = math.degrees(amount), "degrees"
        name = f"{model.arm.joints[joint].name} of {place.arm}"
        reason = f"{name} would have to go {amount:.3g} {unit} beyond its limit"
        return Unreached(reason, "move the place or the arm's base, or give another `rpy`")


@lru_cache(maxsize=1)
def _orientations() -> Floats:
    """Rotations (n, 3, 3), the same in every run."""
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(ORIENTATIONS, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return np.stack([transforms.rotation(axis, rng.uniform(0, math.pi)) for axis in axes])


def _hint(place: Place, contacts: Iterable[Contact]) -> str:
    """What to try where contacts refuse a place."""
    if any(place.touches and {each.first, each.second} & {*place.touches} for each in contacts):
        return "move the place, or allow more `depth` to what it `touches`"
    return "move what is in the way, or name in `touches` what may be in contact there"


def unreached(world: World, backend: GeometryBackend) -> dict[str, Unreached]:
    """The places that no configuration reaches, each with the reason."""
    ask = Reachability(world, backend)
    answers = {name: ask.at(place) for name, place in world.cell.places.items()}
    return {name: answer for name, answer in answers.items() if isinstance(answer, Unreached)}
