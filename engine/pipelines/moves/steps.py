"""The motion of one step at a place: a way to its front, straight in, what is done there, and straight out again."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.motion import Blocked
from cellwright.engine.model.moves import Leg, LegKind, MovedStep, Unmoved
from cellwright.engine.pipelines.moves.hands import Front, Hands
from cellwright.engine.pipelines.moves.refusing import Refusal
from cellwright.engine.pipelines.moves.rooms import Room
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import Ends, JointKind, Operation, Place
from cellwright.kb.model.plan import Step

TRIED = (
    24,
    192,
)  # configurations at a place that are tried, the nearest first: at once, and if no way leads to those
GOALS = (4, 32)  # of them, those that a way is planned to
KNOWN = 3  # straight ways, of those that are known, that are tried: the nearest
BUDGET = (40_000, 400_000)  # configurations that the search for a way looks at
DRAG_STEPS = 24
CAREFUL = 0.4  # of the full speed: on straight ways, and while something is dragged


@dataclass(eq=False)
class StepMotion:
    """One step at a place: what is tried, and what has refused it so far."""

    hands: Hands
    step: Step
    operation: Operation
    place: Place
    before: Room
    after: Room
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
        if standing is not None and (found := self._from_front(standing)):
            return found
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
        """The step with the straight way that the arm stands before; None if that does not serve it."""
        if not self._leads_in(standing.straight):
            return None
        legs = self._at_place(standing.straight)
        return None if isinstance(legs, str) else self._made(legs)

    def _anew(self) -> MovedStep | Unmoved:
        """A way from where the arm is, to a straight way that is known or found now."""
        if (known := self._as_known()) is not None:
            return known
        if (unseen := self.before.reach.unseen(self.place)) is not None:
            return self._refusal.unseen(unseen, sure=not self.known)
        free = self._free_poses()
        if isinstance(free, Unmoved):
            return free
        blocked: Blocked | None = None
        for tried, goals, budget in zip(TRIED, GOALS, BUDGET, strict=True):
            ready = self._ready(free[:tried], goals)
            fronts = [path[0] for path in ready] or self._fronts_alone(tried)[:goals]
            if not fronts:
                continue
            found = self.hands.way(self.before, self.arm, np.array(fronts), budget)
            if isinstance(found, Leg):
                return self._arrived(found, _ending_there(found, ready))
            blocked = found
        if fronts:
            return self._refusal.no_way(blocked)
        sure = not self.operation.drags and not self.known  # those that are known may be tilted
        return self._refusal.no_straight([self._straight_to(q) for q in free], sure)

    @property
    def _refusal(self) -> Refusal:
        return Refusal(self.step, self.place, self.hands.cell, self.before, self.after)

    def _as_known(self) -> MovedStep | None:
        """The step by one of the straight ways that are known, the nearest first; None if none serves it now."""
        now = self.hands.now(self.arm)
        near = sorted(self.known, key=lambda path: float(np.abs(path[0] - now).max()))
        for ways, budget in zip((near[:KNOWN], near), BUDGET, strict=True):
            if (found := self._by_one_of(ways, budget)) is not None:
                return found
        return None

    def _by_one_of(self, ways: Sequence[Floats], budget: int) -> MovedStep | None:
        """The step by one of some straight ways; the one that the arm gets to is looked at, others only where it does not serve."""
        first = next((n for n, path in enumerate(ways) if self._serves(path)), len(ways))
        ready = [path for path in ways[first:] if self._front_is_free(path[0])]
        while ready:
            found = self.hands.way(self.before, self.arm, np.array([path[0] for path in ready]), budget)
            if not isinstance(found, Leg):
                return None
            straight = _ending_there(found, ready)
            if self._serves(straight):
                return self._arrived(found, straight)
            ready = [path for path in ready if path is not straight]
        return None

    def _free_poses(self) -> Floats | Unmoved:
        """The configurations (n, k) at the place that touch nothing; none are needed if the arm only goes before it."""
        poses = self.before.poses(self.place, self.hands.now(self.arm))
        if len(poses):
            free: Floats = poses[~self.before.collides(self.place, poses)]
            if len(free):
                return free
        return poses[:0] if self.operation.ends is Ends.BEFORE else self._refusal.unreached(poses)

    def _arrived(self, way: Leg, straight: Floats) -> MovedStep:
        """The step after the way to the front of the place, where a straight way (m, k) begins."""
        self.hands.arrive(self.arm, way.path[-1], Front(self.place.name, straight))
        if self.operation.ends is Ends.BEFORE:
            return self._made([way])
        legs = self._at_place(straight)
        assert not isinstance(legs, str), "a straight way that is ready was tried already"
        return self._made([way, *legs])

    def _ready(self, poses: Floats, most: int) -> list[Floats]:
        """The straight ways into the place that serve the whole step; of many the first."""
        found: list[Floats] = []
        for q in poses:
            path = self._straight_to(q)
            if path is not None and self._serves(path):
                found.append(path)
            if len(found) == most:
                break
        return found

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
        """Whether a straight way leads to where the tool sees what it must, and touches nothing that it may not."""
        return self.before.reach.sees(self.place, path[-1]) and self.before.is_free(self.place, path)

    def _front_is_free(self, q: Floats) -> bool:
        return not bool(self.before.free(self.arm).collides(self.before.whole(self.arm, q[None]))[0])

    def _fronts_alone(self, tried: int) -> list[Floats]:
        """Configurations before the place, if that is where the step ends; whether the arm gets in from there is not asked."""
        if self.operation.ends is not Ends.BEFORE:
            return []
        poses = self.before.poses(self.place, self.hands.now(self.arm), self.place.approach_m)[:tried]
        return [q for q in poses if self._front_is_free(q)]

    def _at_place(self, straight: Floats, dry: bool = False) -> list[Leg] | str:
        """The legs from the front into the place, and, if the step says so, back out; a text if something touches.

        A dry run leaves the arm where it is.
        """
        legs = [self._slow(LegKind.IN, straight, self.before)]
        if self.operation.ends is not Ends.OUTSIDE:
            if not dry:
                self.hands.arrive(self.arm, straight[-1], Front(self.place.name, straight, inside=True))
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
            self.hands.arrive(self.arm, out[-1], Front(self.place.name, np.ascontiguousarray(out[::-1])))
        return [*legs, self._slow(LegKind.OUT, out, self.after)]

    def _dragged(self, at: Floats) -> Floats | str:
        """The way of the arm (m, k) while it moves a body along its joint; a text if it cannot, or something touches."""
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
        held = world.moved(self.arm, at).affix(body, f"{self.arm}.tool")
        room = Room(held, self.before.backend, self.before.kinematics)
        if not room.is_free(self.place, path):
            return f"something is in the way of {body}"
        return path

    def _slow(self, kind: LegKind, path: Floats, room: Room) -> Leg:
        return self.hands.leg(kind, self.arm, path, room, factor=CAREFUL)

    def _made(self, legs: list[Leg]) -> MovedStep:
        return MovedStep(
            self.step.id, self.step.operator, self.place.name, tuple(legs), self.operation.takes_s
        )


def _ending_there(way: Leg, ready: Sequence[Floats]) -> Floats:
    """The straight way (m, k) that begins where another way ends; of none, that end alone."""
    end = way.path[-1]
    return next((path for path in ready if np.abs(path[0] - end).max() < 1e-9), end[None])


def guide_value(world: World, body: str) -> float:
    """How far a body is along its guide in a world."""
    cell = world.cell
    guide = cell.bodies[body].guide
    assert guide is not None
    home = transforms.of_pose(cell.bodies[body].placement.pose)
    moved = matmul(transforms.inverse(home), world.placed[body].T_parent_frame)
    along = moved[:3, 3] if guide.kind is JointKind.PRISMATIC else transforms.rotation_vector(moved[:3, :3])
    return float(matmul(along, np.array(guide.axis)))
