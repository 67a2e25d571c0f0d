"""The motion of one step at a place, or why it has none, with the bodies in the way."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Contact
from cellwright.engine.model.motion_values import Blocked, LegKind, MovedStep, StepLeg, Unmoved
from cellwright.engine.pipelines.motion.arm_progress import ArmsProgress, Front, bodies_held
from cellwright.engine.pipelines.motion.cell_state import CellState
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.reach.place_reachability import UnreachedPlace
from cellwright.engine.stages.geometry.reach.scanner_view import UnseenPatch
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.cell_model import Cell, Ends, JointKind, Operation, Place
from cellwright.kb.model.plan_model import Step


@dataclass(frozen=True, slots=True, eq=False)
class StepRefusal:
    """One step at a place, from one state to another."""

    step: Step
    place: Place
    cell: Cell
    before: CellState
    after: CellState

    def unreached(self, poses: Floats) -> Unmoved:
        """No configuration at the place is free, or there is none."""
        answer = self.before.reach.at(self.place)
        reason = answer.reason if isinstance(answer, UnreachedPlace) else "no configuration is free"
        if not len(poses):
            return self._unmoved("reach", reason, sure=True)
        culprits = {name for q in poses for name in self._others(q, self.before)}
        return self._unmoved("contact", reason, tuple(sorted(culprits)), sure=True)

    def no_straight(self, paths: Sequence[Floats | None], sure: bool) -> Unmoved:
        """The arm gets to the place in some configurations, but not straight in and out in any of
        them.

        `paths` (m, k) are the ways in, None where the arm cannot follow. It is sure if something
        touches on each of the others.
        """
        culprits = set[str]()
        for path in paths:
            touched = set(self._touched_along(path)) if path is not None else set()
            sure = sure and (path is None or bool(touched))
            culprits |= touched
        past = f" past {', '.join(sorted(culprits))}" if culprits else ""
        reason = f"there is no straight way in and out{past}"
        return self._unmoved("approach", reason, tuple(sorted(culprits)), sure)

    def unseen(self, why: UnseenPatch, sure: bool) -> Unmoved:
        """The tool does not see what it is to measure."""
        return self._unmoved("sight", why.reason, why.culprits, sure)

    def _touched_along(self, path: Floats) -> Iterator[str]:
        """What is touched first on a straight way into the place, or on the way out of it."""
        for room in (self.before, self.after):
            hits = room.collides(self.place, path)
            if hits.any():
                yield from self._others(path[int(np.argmax(hits))], room)
                return
        yield from self._strangers(
            self.before.free(self.place.arm).contacts(
                self.before.whole(self.place.arm, path[:1])[0]
            )
        )

    def _others(self, q: Floats, room: CellState) -> Iterator[str]:
        """The bodies that the arm, or what it holds, touches at a configuration."""
        return self._strangers(room.touching(self.place, q))

    def _strangers(self, contacts: Iterable[Contact]) -> Iterator[str]:
        """What is in contact, except for the arm and what it holds; the arm's own name where it
        touches itself.
        """
        own = {
            *bodies_held(self.before.world, self.place.arm),
            *bodies_held(self.after.world, self.place.arm),
        }
        for contact in contacts:
            names = [
                name
                for name in (contact.first, contact.second)
                if name not in own and not name.startswith(f"{self.place.arm}.")
            ]
            yield from names or [self.place.arm]

    def no_way(self, blocked: Blocked | None) -> Unmoved:
        if blocked is None:
            return self._unmoved("way", f"{self.place.arm} stands where something touches it")
        names = {name for contact in blocked.contacts for name in (contact.first, contact.second)}
        reason = "no way leads there" + (f" past {', '.join(sorted(names))}" if names else "")
        return self._unmoved("way", reason, tuple(sorted(names)))

    def _unmoved(
        self, level: str, reason: str, culprits: tuple[str, ...] = (), sure: bool = False
    ) -> Unmoved:
        bodies = tuple(culprit for culprit in culprits if culprit in self.cell.bodies)
        return Unmoved(
            self.step.id, self.step.operator, self.place.name, level, reason, bodies, sure=sure
        )


MAX_TRIED_CONFIGURATIONS = (
    24,
    192,
    # configurations at a place that are tried, the nearest first: at once, and if no way leads to
    # those
)
PATH_GOALS = (4, 32)  # of them, those that a way is planned to
MAX_KNOWN_LINES = 3  # straight ways, of those that are known, that are tried: the nearest
PATH_BUDGETS = (40_000, 400_000)  # configurations that the search for a way looks at
DRAG_STEPS = 24
CAREFUL_FACTOR = 0.4  # of the full speed: on straight ways, and while something is dragged


@dataclass(eq=False)
class StepMotion:
    """One step at a place: what is tried, and what has refused it so far."""

    hands: ArmsProgress
    step: Step
    operation: Operation
    place: Place
    before: CellState
    after: CellState
    known: Sequence[Floats] = ()
    _straight: dict[bytes, Floats | None] = field(default_factory=dict)

    @property
    def arm(self) -> str:
        """The arm that takes the step."""
        return self.place.arm

    def moved(self) -> MovedStep | Unmoved:
        """The motion of the step, or why there is none."""
        standing = self.hands.front(self.place)
        if self.operation.ends is Ends.BEFORE and standing is not None:
            return self._back(standing)
        if standing is not None and (motion := self._from_front(standing)):
            return motion
        return self._anew()

    def _back(self, standing: Front) -> MovedStep:
        """Out of the place, if the arm is in it."""
        legs = []
        if standing.inside:
            path = standing.straight[::-1]
            legs = [self._slow(LegKind.OUT, path, self.before)]
            self.hands.arrive(self.arm, path[-1], Front(self.place.name, standing.straight))
        return self._made(legs)

    def _from_front(self, standing: Front) -> MovedStep | None:
        """The step with the straight way that the arm stands before; None if that does not
        serve it.
        """
        if not self._leads_in(standing.straight):
            return None
        legs = self._at_place(standing.straight)
        return None if isinstance(legs, str) else self._made(legs)

    def _anew(self) -> MovedStep | Unmoved:
        """A way from where the arm is, to a straight way that is known or found now."""
        if (known_motion := self._as_known()) is not None:
            return known_motion
        if (unseen := self.before.reach.unseen(self.place)) is not None:
            return self._refusal.unseen(unseen, sure=not self.known)
        free = self._free_poses()
        if isinstance(free, Unmoved):
            return free
        blocked: Blocked | None = None
        for tried, goals, budget in zip(
            MAX_TRIED_CONFIGURATIONS, PATH_GOALS, PATH_BUDGETS, strict=True
        ):
            ready = self._ready(free[:tried], goals)
            fronts = [path[0] for path in ready] or self._fronts_alone(tried)[:goals]
            if not fronts:
                continue
            path_found = self.hands.way(self.before, self.arm, np.array(fronts), budget)
            if isinstance(path_found, StepLeg):
                return self._arrived(path_found, _ending_there(path_found, ready))
            blocked = path_found
        if fronts:
            return self._refusal.no_way(blocked)
        sure = not self.operation.drags and not self.known  # those that are known may be tilted
        return self._refusal.no_straight([self._straight_to(q) for q in free], sure)

    @property
    def _refusal(self) -> StepRefusal:
        return StepRefusal(self.step, self.place, self.hands.cell, self.before, self.after)

    def _as_known(self) -> MovedStep | None:
        """The step by one of the straight ways that are known, the nearest first; None if none
        serves it now.
        """
        now = self.hands.now(self.arm)
        near = sorted(self.known, key=lambda path: float(np.abs(path[0] - now).max()))
        for ways, budget in zip((near[:MAX_KNOWN_LINES], near), PATH_BUDGETS, strict=True):
            if (motion := self._by_one_of(ways, budget)) is not None:
                return motion
        return None

    def _by_one_of(self, ways: Sequence[Floats], budget: int) -> MovedStep | None:
        """The step by one of some straight ways; the one that the arm gets to is looked at,
        others only where it does not serve.
        """
        first = next((n for n, path in enumerate(ways) if self._serves(path)), len(ways))
        ready = [path for path in ways[first:] if self._front_is_free(path[0])]
        while ready:
            path_found = self.hands.way(
                self.before, self.arm, np.array([path[0] for path in ready]), budget
            )
            if not isinstance(path_found, StepLeg):
                return None
            straight = _ending_there(path_found, ready)
            if self._serves(straight):
                return self._arrived(path_found, straight)
            ready = [path for path in ready if path is not straight]
        return None

    def _free_poses(self) -> Floats | Unmoved:
        """The configurations (n, k) at the place that touch nothing; none are needed if the arm
        only goes before it.
        """
        poses = self.before.poses(self.place, self.hands.now(self.arm))
        if len(poses):
            free: Floats = poses[~self.before.collides(self.place, poses)]
            if len(free):
                return free
        return poses[:0] if self.operation.ends is Ends.BEFORE else self._refusal.unreached(poses)

    def _arrived(self, way_leg: StepLeg, straight: Floats) -> MovedStep:
        """The step after the way to the front of the place, where a straight way (m, k) begins."""
        self.hands.arrive(self.arm, way_leg.path[-1], Front(self.place.name, straight))
        if self.operation.ends is Ends.BEFORE:
            return self._made([way_leg])
        legs = self._at_place(straight)
        assert not isinstance(legs, str), "a straight way that is ready was tried already"
        return self._made([way_leg, *legs])

    def _ready(self, poses: Floats, most: int) -> list[Floats]:
        """The straight ways into the place that serve the whole step; of many the first."""
        ready_lines: list[Floats] = []
        for q in poses:
            path = self._straight_to(q)
            if path is not None and self._serves(path):
                ready_lines.append(path)
            if len(ready_lines) == most:
                break
        return ready_lines

    def _straight_to(self, q: Floats) -> Floats | None:
        """The straight way to a configuration in the place; None if the arm cannot follow it."""
        key = q.tobytes()
        if key not in self._straight:
            self._straight[key] = self.before.straight(self.place, q, self.place.approach_m)
        return self._straight[key]

    def _serves(self, path: Floats) -> bool:
        """Whether the whole step can be taken by a straight way into the place."""
        if not self._front_is_free(path[0]) or not self._leads_in(path):
            return False
        return not isinstance(self._at_place(path, dry=True), str)

    def _leads_in(self, path: Floats) -> bool:
        """Whether a straight way leads to where the tool sees what it must, and touches nothing
        that it may not.
        """
        return self.before.reach.sees(self.place, path[-1]) and self.before.is_free(
            self.place, path
        )

    def _front_is_free(self, q: Floats) -> bool:
        return not bool(
            self.before.free(self.arm).collides(self.before.whole(self.arm, q[None]))[0]
        )

    def _fronts_alone(self, tried: int) -> list[Floats]:
        """Configurations before the place, if that is where the step ends; whether the arm gets
        in from there is not asked.
        """
        if self.operation.ends is not Ends.BEFORE:
            return []
        poses = self.before.poses(self.place, self.hands.now(self.arm), self.place.approach_m)[
            :tried
        ]
        return [q for q in poses if self._front_is_free(q)]

    def _at_place(self, straight: Floats, dry: bool = False) -> list[StepLeg] | str:
        """The legs from the front into the place, and, if the step says so, back out; a text if
        something touches.

        A dry run leaves the arm where it is.
        """
        legs = [self._slow(LegKind.IN, straight, self.before)]
        if self.operation.ends is not Ends.OUTSIDE:
            if not dry:
                self.hands.arrive(
                    self.arm, straight[-1], Front(self.place.name, straight, inside=True)
                )
            return legs
        q, out = straight[-1], straight[::-1]
        if self.operation.drags:
            dragged = self._dragged(q)
            if isinstance(dragged, str):
                return dragged
            legs.append(self._slow(LegKind.DRAG, dragged, self.before))
            q = dragged[-1]
            away = self.after.straight(self.place, q, self.place.approach_m)
            if away is None:
                return "the arm cannot leave it again"
            out = away[::-1]
        if not self.after.is_free(self.place, out):
            return "something is in the way out of it"
        if not dry:
            self.hands.arrive(
                self.arm, out[-1], Front(self.place.name, np.ascontiguousarray(out[::-1]))
            )
        return [*legs, self._slow(LegKind.OUT, out, self.after)]

    def _dragged(self, at: Floats) -> Floats | str:
        """The way of the arm (m, k) while it moves a body along its joint; a text if it cannot,
        or something touches.
        """
        body, world = self.operation.drags, self.before.world
        first, last = (guide_value(room.world, body) for room in (self.before, self.after))
        model = world.models[self.arm]
        start = world.pose(f"{self.arm}.base", body)
        T_body_flange = matmul(transforms.inverse(start), model.flange_pose(at))
        poses = [
            matmul(world.guided(body, float(value)).pose(f"{self.arm}.base", body), T_body_flange)
            for value in np.linspace(first, last, DRAG_STEPS + 1)
        ]
        path = self.before.followed(self.arm, np.array([poses]), at[None])[0]
        if path is None:
            return f"the arm cannot move {body} all the way"
        world_held = world.moved(self.arm, at).affix(body, f"{self.arm}.tool")
        room = CellState(world_held, self.before.backend, self.before.kinematics)
        if not room.is_free(self.place, path):
            return f"something is in the way of {body}"
        return path

    def _slow(self, kind: LegKind, path: Floats, room: CellState) -> StepLeg:
        return self.hands.leg(kind, self.arm, path, room, factor=CAREFUL_FACTOR)

    def _made(self, legs: list[StepLeg]) -> MovedStep:
        return MovedStep(
            self.step.id, self.step.operator, self.place.name, tuple(legs), self.operation.takes_s
        )


def _ending_there(way_leg: StepLeg, ready: Sequence[Floats]) -> Floats:
    """The straight way (m, k) that begins where another way ends; of none, that end alone."""
    end = way_leg.path[-1]
    return next((path for path in ready if np.abs(path[0] - end).max() < 1e-9), end[None])


def guide_value(world: GeometricWorld, body: str) -> float:
    """How far a body is along its guide in a world."""
    cell = world.cell
    guide = cell.bodies[body].guide
    assert guide is not None
    home = transforms.of_pose(cell.bodies[body].placement.pose)
    moved = matmul(transforms.inverse(home), world.placed[body].T_parent_frame)
    along = (
        moved[:3, 3]
        if guide.kind is JointKind.PRISMATIC
        else transforms.rotation_vector(moved[:3, :3])
    )
    return float(matmul(along, np.array(guide.axis)))
