"""Which places of a cell an arm reaches, and why it does not reach the others."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import CollisionScene, Contact
from cellwright.engine.ports import CollisionChecker, GeometryBackend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arm_model import reachable_nearest_turns
from cellwright.engine.stages.geometry.kinematics.inverse_kinematics import (
    Branches,
    InverseKinematics,
)
from cellwright.engine.stages.geometry.reach.scanner_view import (
    PatchView,
    ScannerSight,
    UnseenPatch,
    best_reason,
)
from cellwright.engine.stages.geometry.world.collision_scene import (
    collision_scene_of,
    scene_of_pairs,
)
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.cell_model import Place


class ShallowChecker:
    """A scene in which the pairs of `meeting` may overlap by `depth_m` (m), and those of
    `apart` not at all.
    """

    def __init__(self, apart: CollisionChecker, meeting: CollisionChecker, depth_m: float) -> None:
        self._apart, self._meeting, self._depth_m = apart, meeting, depth_m

    @property
    def scene(self) -> CollisionScene:
        """The scene of the pairs that may not touch."""
        return self._apart.scene

    def collides(self, where: Floats) -> Truths:
        """Whether something touches that must not, or goes deeper than it may (n,)."""
        hits = self._apart.collides(where)
        if not hits.all():
            undecided = np.nonzero(~hits)[0]
            hits[undecided] = -self._meeting.clearance(where[undecided], 0.0) > self._depth_m
        return hits

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """How far everything is from what it must not do (n,), m: from a touch, or from being
        too deep.
        """
        met = self._meeting.clearance(where, max(0.0, beyond_m - self._depth_m)) + self._depth_m
        clearances: Floats = np.minimum(self._apart.clearance(where, beyond_m), met)
        return clearances

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """What is nearer than `within_m` and must not be, or deeper than it may be, in one
        configuration: the deepest first.
        """
        deep = [
            contact for contact in self._meeting.contacts(where) if contact.depth_m > self._depth_m
        ]
        contacts = (*self._apart.contacts(where, within_m), *deep)
        return tuple(sorted(contacts, key=lambda contact: contact.distance_m)) if deep else contacts


TOOL_TURNS = 24  # poses tried for a tool that may turn about its own z
# orientations tried, to find out whether the position alone can be reached
ORIENTATIONS_TRIED = 256
NEAR_MISSES = 3


@dataclass(frozen=True, slots=True, eq=False)
class ReachedPlace:
    """Configurations (m, k) of the place's arm that reach the pose, within the limits and without
    collision.

    Among those that differ only by whole turns, the one nearest to the arm's present configuration
    is kept.
    """

    q: Floats


@dataclass(frozen=True, slots=True)
class UnreachedPlace:
    """The answer for a place that is not reached.

    `reason` is a sentence for people, without the place's name; `hint` says what to try.
    """

    reason: str
    hint: str


class PlaceReachability:
    """Finds out which places are reached in one world.

    Inverse kinematics and scenes are kept from place to place.
    """

    def __init__(self, world: GeometricWorld, backend: GeometryBackend) -> None:
        self._world, self._backend = world, backend
        self._kinematics = {name: InverseKinematics(model) for name, model in world.models.items()}
        self._checkers: dict[tuple[str, str, tuple[str, ...]], CollisionChecker] = {}
        self._meetings: dict[tuple[str, str, tuple[str, ...]], CollisionChecker] = {}
        self._seeing: dict[tuple[str, str], ScannerSight | None] = {}
        self._views: dict[Place, list[PatchView]] = {}

    def at(self, place: Place) -> ReachedPlace | UnreachedPlace:
        """The configurations in which the arm reaches a place, or why it does not reach it."""
        goal = self._answer(place, 0.0)
        if isinstance(goal, UnreachedPlace) or place.approach_m == 0.0:
            return goal
        before = self._answer(place, place.approach_m)
        if isinstance(before, UnreachedPlace):
            return replace(
                before, reason=f"approaching it from {place.approach_m:g} m, {before.reason}"
            )
        return goal

    def target(self, place: Place, back_m: float = 0.0) -> Floats:
        """T_base_flange for a place, backed off along the tool's z: (n, 4, 4), one for each
        angle of the tool.
        """
        ends = matmul(self._turned(place), transforms.translation(0.0, 0.0, -back_m))
        poses: Floats = matmul(ends, transforms.inverse(self.flange_to_end(place)))
        return poses

    def seen_at(self, place: Place, asked: Truths) -> Truths:
        """At which angles of the tool (n,), of those that are asked about, the patch at a place
        is seen; all if nothing is declared.
        """
        if self.seeing(place) is None:
            return asked
        is_seen = asked.copy()
        is_seen[asked] = [
            reason is None for reason in self._unseen_from(place, self._turned(place)[asked])
        ]
        return is_seen

    def _turned(self, place: Place) -> Floats:
        """T_base_end (n, 4, 4) at a place, one for each angle of the tool."""
        base = self._world.pose(f"{place.arm}.base", place.placement.parent)
        angles = np.arange(TOOL_TURNS if place.turns else 1) * 2 * math.pi / TOOL_TURNS
        around = transforms.transform(transforms.rotation((0, 0, 1), angles), np.zeros(3))
        ends: Floats = matmul(base, transforms.of_pose(place.placement.pose), around)
        return ends

    def seeing(self, place: Place) -> ScannerSight | None:
        """What the tool of a place sees; None if the cell does not declare it as a scanner."""
        key = (place.arm, place.tool)
        if key not in self._seeing:
            how = self._world.cell.measuring.get(place.tool)
            sight = how.sight if how else None
            self._seeing[key] = (
                ScannerSight(self._world, *key, how, sight) if how and sight else None
            )
        return self._seeing[key]

    def _unseen_from(self, place: Place, T_base_end: Floats) -> list[UnseenPatch | None]:
        seeing = self.seeing(place)
        assert seeing is not None
        ends = matmul(self._world.pose("world", f"{place.arm}.base"), T_base_end)
        self._views.setdefault(place, []).extend(seeing.view(place, T) for T in ends)
        return [seeing.unseen(place, T) for T in ends]

    def sees(self, place: Place, q: Floats) -> bool:
        """Whether the patch at a place is seen at a configuration (k,) of its arm; where
        nothing is declared, it is.
        """
        if self.seeing(place) is None:
            return True
        T_base_end = matmul(self._world.models[place.arm].flange_pose(q), self.flange_to_end(place))
        return self._unseen_from(place, T_base_end[None])[0] is None

    def unseen(self, place: Place) -> UnseenPatch | None:
        """Why the patch at a place is not seen at any angle of the tool; None if it is seen."""
        if self.seeing(place) is None:
            return None
        reasons = self._unseen_from(place, self._turned(place))
        return best_reason(reasons) if all(reason is not None for reason in reasons) else None

    def looked_through(self, place: Place) -> list[PatchView]:
        """What a scanner has looked through at a place so far; empty for another tool."""
        return self._views.get(place, [])

    def flange_to_end(self, place: Place) -> Floats:
        """T_flange_end (4, 4): the tool point, or the tip of the tool held there."""
        T = transforms.of_pose(self._world.cell.arms[place.arm].tool)
        if place.tool:
            tip = transforms.of_pose(self._world.cell.bodies[place.tool].features["tip"])
            T = matmul(T, transforms.inverse(self._world.grip(place.tool)), tip)
        return T

    def _answer(self, place: Place, back_m: float) -> ReachedPlace | UnreachedPlace:
        poses = self.target(place, back_m)
        branches = self._kinematics[place.arm].solve(poses)
        if not branches.valid.any():
            return self._why_too_far(place, poses)
        solved: Truths = np.asarray(branches.valid.any(axis=1))
        seen = self.seen_at(place, solved)
        if not seen.any():
            return self._why_unseen(place, solved)
        branches = replace(branches, valid=branches.valid & seen[:, None])
        within = self._within_limits(place.arm, branches)
        if not len(within):
            return self._why_limited(place, branches)
        whole = self.whole(place, within)
        hits = self.collides(place, whole)
        if hits.all():
            return self._why_blocked(place, whole)
        return ReachedPlace(within[~hits])

    def _within_limits(self, arm: str, branches: Branches) -> Floats:
        """Every branch of every pose that can be within the limits, with the whole turns that bring
        it nearest to the arm's present configuration.
        """
        return reachable_nearest_turns(
            self._world.models[arm], branches.q[branches.valid], self._world.configurations[arm]
        )

    def whole(self, place: Place, q: Floats) -> Floats:
        """Configurations of all arms: those given for one arm, with the other arms as they
        stand.
        """
        first = self._world.first_carriers[place.arm]
        whole = np.repeat(self._world.configuration[None], len(q), axis=0)
        whole[:, first : first + q.shape[1]] = q
        return whole

    def checker(self, place: Place) -> CollisionChecker:
        """A checker of the scene with the place's tool in hand.

        What the place lists in `touches` may touch the tool and its parts; how deep is not asked
        here.
        """
        key = (place.arm, place.tool, place.touches)
        if key not in self._checkers:
            scene = collision_scene_of(self._holding(place), allowed=self.intended(place))
            self._checkers[key] = self._backend.checker(scene)
        return self._checkers[key]

    def meeting(self, place: Place) -> CollisionChecker:
        """A checker of what touches by intention at a place, and of nothing else: of few pairs,
        whose depths are exact.
        """
        key = (place.arm, place.tool, place.touches)
        if key not in self._meetings:
            scene = scene_of_pairs(self._holding(place), self.intended(place))
            self._meetings[key] = self._backend.checker_of_few(scene)
        return self._meetings[key]

    def shallow(self, place: Place) -> CollisionChecker:
        """A checker that knows both: what may touch at a place must not do so deeper than the
        place says.
        """
        checker = self.checker(place)
        return (
            ShallowChecker(checker, self.meeting(place), place.depth_m)
            if place.touches
            else checker
        )

    def collides(self, place: Place, whole: Floats) -> Truths:
        """Whether something touches that must not at a place, or is touched deeper than it may
        be, for configurations (n, k).
        """
        return self.shallow(place).collides(whole)

    def contacts(self, place: Place, whole: Floats) -> tuple[Contact, ...]:
        """What touches at a place and must not, or deeper than it may, in one configuration
        (k,): the deepest first.
        """
        return self.shallow(place).contacts(whole)

    def _holding(self, place: Place) -> GeometricWorld:
        return self._world.held(place.tool, place.arm) if place.tool else self._world

    def intended(self, place: Place) -> frozenset[frozenset[str]]:
        """The pairs that touch by intention at a place: its `touches`, with the last two links
        and what the arm carries.
        """
        world = self._holding(place)
        carried = [
            body for body in world.cell.bodies if f"{place.arm}.base" in world.supports(body)[1:]
        ]
        links = [f"{place.arm}.{link.name}" for link in world.cell.arms[place.arm].arm.links[-2:]]
        ends = [*carried, *links]
        return frozenset(frozenset((end, touch)) for end in ends for touch in place.touches)

    def _why_unseen(self, place: Place, asked: Truths) -> UnreachedPlace:
        reason = best_reason(self._unseen_from(place, self._turned(place)[asked]))
        return UnreachedPlace(
            reason.reason, "move what is in the way, or allow other `tilts` or a smaller `patch`"
        )

    def _why_too_far(self, place: Place, poses: Floats) -> UnreachedPlace:
        """Whether the position alone can be reached, in some orientation."""
        T_flange_end = self.flange_to_end(place)
        position = matmul(poses[0], T_flange_end)[:3, 3]
        any_way = matmul(
            transforms.transform(_tried_orientations(), position), transforms.inverse(T_flange_end)
        )
        if self._kinematics[place.arm].solve(any_way).valid.any():
            reason = f"{place.arm} reaches the position, but not in this orientation"
            return UnreachedPlace(
                reason, "give it another `rpy`, or let the tool turn with `turns: true`"
            )
        away = f"{norm(position):.2f} m from its base"
        return UnreachedPlace(
            f"it is out of the reach of {place.arm}: {away}", "move the place, or the arm's base"
        )

    def _why_blocked(self, place: Place, whole: Floats) -> UnreachedPlace:
        """What collides in the configurations (n, k) that are nearest to being free."""
        clearance = self.shallow(place).clearance(whole, 0.0)
        worst_contacts: dict[str, Contact] = {}
        for n in np.argsort(-clearance, kind="stable")[:NEAR_MISSES]:
            for contact in self.contacts(place, whole[n]):
                ends = contact.first, contact.second
                own_end, met_end = ends[::-1] if contact.first in place.touches else ends
                worst_contacts.setdefault(f"{own_end} touches {met_end}", contact)
        shown = [
            f"{words} by {contact.depth_m * 1000:.0f} mm"
            for words, contact in list(worst_contacts.items())[:NEAR_MISSES]
        ]
        every = "every configuration" if len(whole) > 1 else "the only configuration"
        reason = f"{every} is in collision: {', '.join(shown)}"
        return UnreachedPlace(reason, _contact_hint(place, worst_contacts.values()))

    def _why_limited(self, place: Place, branches: Branches) -> UnreachedPlace:
        """The joint that leaves its limits in the best branch, and by how much."""
        model = self._world.models[place.arm]
        q = branches.q[branches.valid][:, :, None] + np.where(
            model.joints.prismatic, 0.0, 2 * math.pi
        )[:, None] * [
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
        return UnreachedPlace(reason, "move the place or the arm's base, or give another `rpy`")


@lru_cache(maxsize=1)
def _tried_orientations() -> Floats:
    """Rotations (n, 3, 3), the same in every run."""
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(ORIENTATIONS_TRIED, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return np.stack([transforms.rotation(axis, rng.uniform(0, math.pi)) for axis in axes])


def _contact_hint(place: Place, contacts: Iterable[Contact]) -> str:
    """What to try where contacts refuse a place."""
    if any(
        place.touches and {contact.first, contact.second} & {*place.touches} for contact in contacts
    ):
        return "move the place, or allow more `depth` to what it `touches`"
    return "move what is in the way, or name in `touches` what may be in contact there"


def unreached_places(world: GeometricWorld, backend: GeometryBackend) -> dict[str, UnreachedPlace]:
    """The places that no configuration reaches, each with the reason."""
    ask = PlaceReachability(world, backend)
    answers = {name: ask.at(place) for name, place in world.cell.places.items()}
    return {name: answer for name, answer in answers.items() if isinstance(answer, UnreachedPlace)}
