"""An arm goes through the steps of a plan: each step's motion starts where the one before it has ended."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from engine.model.geometry import Floats
from engine.model.motion import Blocked, Moved, Query
from engine.model.moves import Leg, LegKind, MovedStep, Unmoved
from engine.pipelines.moves.places import with_measured_places
from engine.pipelines.moves.rooms import Room
from engine.pipelines.moves.states import states_of
from engine.ports import GeometryBackend
from engine.stages.geometry import transforms
from engine.stages.geometry.kinematics.inverse import InverseKinematics
from engine.stages.geometry.reach.reach import Unreached
from engine.stages.geometry.world.following import following
from engine.stages.geometry.world.model import World
from engine.stages.motion.planner import plan as plan_way
from engine.stages.motion.trajectory import Limits, fastest
from engine.stages.validation.changes import State
from engine.stages.validation.semantics import Semantics
from kb.model.cell import Cell, Ends, Location, Operation, Place, Placement
from kb.model.plan import Plan, Step
from kb.syntax import SECONDS
from kb.terms import Atom, Function, Term, match, substitute

TRIED = (
    24,
    192,
)  # configurations at a place that are tried, the nearest first: at once, and if no way leads to those
GOALS = (4, 32)  # of them, those that a way is planned to
BUDGET = (40_000, 400_000)  # configurations that the search for a way looks at
DRAG_STEPS = 24
DRIVE_LOOKS = 17
CAREFUL = 0.4  # of the full speed: on straight ways, and while something is dragged
UNKNOWN_SPEED = 1.0  # rad/s or m/s
SWIFT, ABRUPT = 4.0, 10.0  # 1/s: acceleration of the full speed, jerk of the full acceleration


@dataclass(frozen=True, slots=True, eq=False)
class _Front:
    """The arm stands before a place, or in it; `straight` (m, k) is the way from the front into the place."""

    place: str
    straight: Floats
    inside: bool = False


@dataclass(eq=False)
class Walk:
    """What an arm does through a plan. `measured` are the tools of measurements, by name."""

    semantics: Semantics
    cell: Cell
    backend: GeometryBackend
    seed: int = 0
    bridges: int = 30
    _rooms: dict[frozenset[Atom], Room] = field(default_factory=dict)
    _now: dict[str, Floats] = field(default_factory=dict)
    _front: dict[str, _Front] = field(default_factory=dict)

    def __post_init__(self) -> None:
        problem = self.semantics.problem
        chosen = self.semantics.statics.named(problem.domain.conventions.chosen)
        tools = {
            str(each.arguments[1]): str(each.arguments[0]) for each in chosen if len(each.arguments) == 2
        }
        self.cell = with_measured_places(self.cell, problem, tools)
        world = World.of(self.cell)
        self._kinematics = {name: InverseKinematics(model) for name, model in world.models.items()}
        self._now = {name: world.configurations[name] for name in self.cell.arms}
        self._moving = {each.fact.name for each in self.cell.locations}

    def steps(self, plan: Plan) -> Iterator[MovedStep | Unmoved]:
        """The motion of each step that has one, in the order of the earliest starts; the first without one is the last."""
        for step, before, after in states_of(self.semantics, plan):
            operation = operation_of(self.cell, step.operator)
            if operation is None:
                continue
            found = self.step(step, operation, before, after)
            yield found
            if isinstance(found, Unmoved):
                return

    def step(self, step: Step, operation: Operation, before: State, after: State) -> MovedStep | Unmoved:
        """The motion of one step from where the arm is now; the arm is at its end then."""
        if operation.drives:
            return self._driven(step, operation, before, after)
        place = self.cell.places.get(str(operation.at))
        if place is None:
            said = f"{operation.at} has no place in the cell"
            return Unmoved(step.id, step.operator, str(operation.at), "reach", said)
        rooms = self.room(before, place.arm), self.room(after, place.arm)
        return _Step(self, step, operation, place, *rooms).moved()

    def room(self, state: State, arm: str) -> Room:
        """The cell in a state, with the arms where they are."""
        facts = frozenset(fact for fact in state if fact.name in self._moving)
        facts = frozenset(fact for fact in facts if any(_fits(each, fact) for each in self.cell.locations))
        if facts not in self._rooms:
            world = following(World.of(self.cell), facts)
            self._rooms[facts] = Room(world, self.backend, self._kinematics)
        return self._rooms[facts]

    def now(self, arm: str) -> Floats:
        """Where an arm is: its configuration (k,)."""
        return self._now[arm]

    def arrive(self, arm: str, q: Floats, front: _Front | None) -> None:
        """The arm is at a configuration now, before or in a place."""
        self._now[arm] = q
        self._front.pop(arm, None)
        if front is not None:
            self._front[arm] = front

    def front(self, place: Place) -> _Front | None:
        """How the arm stands before this place, or in it; None if it is elsewhere."""
        found = self._front.get(place.arm)
        return found if found is not None and found.place == place.name else None

    def leg(
        self, kind: LegKind, arm: str, path: Floats, room: Room, proved: bool = True, factor: float = 1.0
    ) -> Leg:
        """A leg in the least time, within what the joints can do."""
        joints = self.cell.arms[arm].arm.joints
        speed = np.array([joint.speed or UNKNOWN_SPEED for joint in joints]) * factor
        rated = np.array([joint.acceleration or SWIFT * (joint.speed or UNKNOWN_SPEED) for joint in joints])
        rated = rated * factor
        corners = fastest(path, Limits(speed, rated, rated * ABRUPT)).corners_s
        return Leg(kind, arm, path, corners, proved, _held(room.world, arm))

    def way(self, room: Room, arm: str, goals: Floats, budget: int = BUDGET[1]) -> Leg | Blocked | None:
        """The way from where the arm is to one of some configurations (n, k); None if start or goals are not free."""
        world = room.world
        first, count = world.first_carriers[arm], world.models[arm].joints.count
        query = Query(
            room.whole(arm, self.now(arm)[None])[0],
            room.whole(arm, goals),
            seed=self.seed,
            budget=budget,
            bridges=self.bridges,
            moving=tuple(range(first, first + count)),
        )
        answer = plan_way(room.free(arm), query)
        if isinstance(answer, Moved):
            path = answer.path[:, first : first + count]
            return self.leg(LegKind.WAY, arm, path, room, answer.proved)
        return answer if isinstance(answer, Blocked) else None

    def _driven(self, step: Step, operation: Operation, before: State, after: State) -> MovedStep | Unmoved:
        """The arm rests while the body that carries it goes along its joint; it goes home first if it would touch something."""
        arm = next(
            name
            for name in self.cell.arms
            if operation.drives in World.of(self.cell).supports(f"{name}.base")
        )
        rooms = self.room(before, arm), self.room(after, arm)
        legs: list[Leg] = []
        touched = self._touched(rooms, operation.drives, arm)
        if touched:
            home = rooms[0].world.configurations[arm]
            found = self.way(rooms[0], arm, home[None])
            if isinstance(found, Leg):
                legs.append(found)
                self.arrive(arm, home, None)
                touched = self._touched(rooms, operation.drives, arm)
        if touched:
            said = f"{arm} touches {', '.join(touched)} on the way of {operation.drives}"
            return Unmoved(step.id, step.operator, operation.drives, "way", said, touched)
        self._front.pop(arm, None)
        q = self.now(arm)[None]
        legs.append(Leg(LegKind.DRIVE, arm, q, np.zeros(1), True, _held(rooms[0].world, arm)))
        takes = max(operation.takes_s, step.duration * self._unit_s)
        return MovedStep(step.id, step.operator, operation.drives, tuple(legs), takes)

    @property
    def _unit_s(self) -> float:
        return float(SECONDS[self.semantics.problem.domain.time_unit])

    def _touched(self, rooms: tuple[Room, Room], body: str, arm: str) -> tuple[str, ...]:
        """What something touches while a body goes from where it is in one room to where it is in the other."""
        ends = [room.world.placed[body].T_parent_frame for room in rooms]
        for share in np.linspace(0.0, 1.0, DRIVE_LOOKS):
            T = ends[0].copy()
            T[:3, 3] += share * (ends[1][:3, 3] - ends[0][:3, 3])
            world = rooms[0].world.put(body, rooms[0].world.placed[body].parent, T)
            room = Room(world, self.backend, self._kinematics)
            contacts = room.free(arm).contacts(room.whole(arm, self.now(arm)[None])[0])
            if contacts:
                return tuple(sorted({name for each in contacts for name in (each.first, each.second)}))
        return ()


@dataclass(eq=False)
class _Step:
    """One step at a place: what is tried, and what has refused it so far."""

    walk: Walk
    step: Step
    operation: Operation
    place: Place
    before: Room
    after: Room

    @property
    def arm(self) -> str:
        return self.place.arm

    def moved(self) -> MovedStep | Unmoved:
        """The motion of the step, or why there is none."""
        standing = self.walk.front(self.place)
        if self.operation.ends is Ends.BEFORE and standing is not None:
            return self._back(standing)
        if standing is not None and (found := self._from_front(standing)):
            return found
        return self._anew()

    def _back(self, standing: _Front) -> MovedStep:
        """Out of the place, if the arm is in it."""
        legs = []
        if standing.inside:
            path = standing.straight[::-1]
            legs = [self._slow(LegKind.OUT, path, self.before)]
            self.walk.arrive(self.arm, path[-1], _Front(self.place.name, standing.straight))
        return self._made(legs)

    def _from_front(self, standing: _Front) -> MovedStep | None:
        """The step with the straight way that the arm stands before; None if that does not serve it."""
        if not self.before.is_free(self.place, standing.straight):
            return None
        legs = self._at_place(standing.straight)
        return None if isinstance(legs, str) else self._made(legs)

    def _anew(self) -> MovedStep | Unmoved:
        poses = self.before.poses(self.place, self.walk.now(self.arm))
        free = (
            poses[~self.before.checker(self.place).collides(self.before.whole(self.arm, poses))]
            if len(poses)
            else poses
        )
        optional = self.operation.ends is Ends.BEFORE
        if not len(free) and not optional:
            return self._unreached(poses)
        found: Leg | Blocked | None = None
        for tried, goals, budget in zip(TRIED, GOALS, BUDGET, strict=True):
            ready = self._ready(free[:tried], goals)
            fronts = [path[0] for path in ready] or (self._fronts_alone(tried)[:goals] if optional else [])
            if not fronts:
                continue
            found = self.walk.way(self.before, self.arm, np.array(fronts), budget)
            if isinstance(found, Leg):
                break
        if not fronts:
            return self._unmoved("approach", "there is no straight way into it, and out of it again")
        if not isinstance(found, Leg):
            return self._no_way(found)
        reached = found.path[-1]
        straight = next((path for path in ready if np.abs(path[0] - reached).max() < 1e-9), reached[None])
        self.walk.arrive(self.arm, reached, _Front(self.place.name, straight))
        if optional:
            return self._made([found])
        legs = self._at_place(straight)
        assert not isinstance(legs, str), "a straight way that is ready was tried already"
        return self._made([found, *legs])

    def _ready(self, poses: Floats, most: int) -> list[Floats]:
        """The straight ways into the place that serve the whole step; of many the first."""
        found: list[Floats] = []
        for q in poses:
            path = self.before.straight(self.place, q, self.place.approach_m)
            if path is None or not self.before.is_free(self.place, path):
                continue
            if not self._front_is_free(path[0]) or isinstance(self._at_place(path, dry=True), str):
                continue
            found.append(path)
            if len(found) == most:
                break
        return found

    def _front_is_free(self, q: Floats) -> bool:
        return not bool(self.before.free(self.arm).collides(self.before.whole(self.arm, q[None]))[0])

    def _fronts_alone(self, tried: int) -> list[Floats]:
        """Configurations before the place; whether the arm gets in from there is not asked."""
        away = transforms.of_pose(self.place.placement.pose) @ transforms.translation(
            0, 0, -self.place.approach_m
        )
        before = replace(
            self.place, placement=Placement(self.place.placement.parent, transforms.to_pose(away))
        )
        poses = self.before.poses(before, self.walk.now(self.arm))[:tried]
        return [q for q in poses if self._front_is_free(q)]

    def _at_place(self, straight: Floats, dry: bool = False) -> list[Leg] | str:
        """The legs from the front into the place, and, if the step says so, back out; a text if something touches.

        A dry run leaves the arm where it is.
        """
        legs = [self._slow(LegKind.IN, straight, self.before)]
        if self.operation.ends is not Ends.OUTSIDE:
            if not dry:
                self.walk.arrive(self.arm, straight[-1], _Front(self.place.name, straight, inside=True))
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
            self.walk.arrive(self.arm, out[-1], _Front(self.place.name, np.ascontiguousarray(out[::-1])))
        return [*legs, self._slow(LegKind.OUT, out, self.after)]

    def _dragged(self, at: Floats) -> Floats | str:
        """The way of the arm (m, k) while it moves a body along its joint; a text if it cannot, or something touches."""
        body, world = self.operation.drags, self.before.world
        values = [_value(self.walk.cell, room.world, body) for room in (self.before, self.after)]
        model = world.models[self.arm]
        start = world.pose(f"{self.arm}.base", body)
        T_body_flange = transforms.inverse(start) @ model.flange_pose(at)
        poses = [
            world.guided(body, float(value)).pose(f"{self.arm}.base", body) @ T_body_flange
            for value in np.linspace(*values, DRAG_STEPS + 1)
        ]
        path = self.before.followed(self.arm, np.array(poses), at)
        if path is None:
            return f"the arm cannot move {body} all the way"
        held = world.moved(self.arm, at).affix(body, f"{self.arm}.tool")
        room = Room(held, self.walk.backend, self.before.kinematics)
        if not room.is_free(self.place, path):
            return f"something is in the way of {body}"
        return path

    def _slow(self, kind: LegKind, path: Floats, room: Room) -> Leg:
        return self.walk.leg(kind, self.arm, path, room, factor=CAREFUL)

    def _made(self, legs: list[Leg]) -> MovedStep:
        return MovedStep(
            self.step.id, self.step.operator, self.place.name, tuple(legs), self.operation.takes_s
        )

    def _unreached(self, poses: Floats) -> Unmoved:
        """No configuration at the place is free, or there is none."""
        answer = self.before.reach.at(self.place)
        reason = answer.reason if isinstance(answer, Unreached) else "no configuration is free"
        if not len(poses):
            return self._unmoved("reach", reason)
        culprits = {name for q in poses for name in self._others(q)}
        return self._unmoved("contact", reason, tuple(sorted(culprits)))

    def _others(self, q: Floats) -> Iterator[str]:
        """The bodies that the arm, or what it holds, touches at a configuration."""
        own = {*_held(self.before.world, self.arm)}
        for contact in self.before.touching(self.place, q):
            for name in (contact.first, contact.second):
                if name not in own and not name.startswith(f"{self.arm}."):
                    yield name

    def _no_way(self, found: Blocked | None) -> Unmoved:
        if found is None:
            return self._unmoved("way", f"{self.arm} stands where something touches it")
        names = {name for each in found.contacts for name in (each.first, each.second)}
        reason = "no way leads there" + (f" past {', '.join(sorted(names))}" if names else "")
        return self._unmoved("way", reason, tuple(sorted(names)))

    def _unmoved(self, level: str, reason: str, culprits: tuple[str, ...] = ()) -> Unmoved:
        bodies = tuple(each for each in culprits if each in self.walk.cell.bodies)
        return Unmoved(self.step.id, self.step.operator, self.place.name, level, reason, bodies)


def walked(
    semantics: Semantics, cell: Cell, backend: GeometryBackend, plan: Plan, seed: int = 0
) -> list[MovedStep | Unmoved]:
    """The motion of each step of a plan that has one; the last is the first that has none, if there is such a step."""
    return list(Walk(semantics, cell, backend, seed).steps(plan))


def operation_of(cell: Cell, step: Function) -> Operation | None:
    """What an arm does in a step, its place without variables; None if the cell declares nothing for it."""
    for operation in cell.operations:
        bindings = match(operation.operator, step, {})
        if bindings is not None:
            at: Term | None = None if operation.at is None else substitute(operation.at, bindings)
            return replace(operation, operator=step, at=at)
    return None


def _fits(location: Location, fact: Atom) -> bool:
    return match(location.fact, fact, {}) is not None


def _held(world: World, arm: str) -> tuple[str, ...]:
    """The bodies that an arm carries."""
    return tuple(body for body in world.cell.bodies if _rides(world, body, arm))


def _rides(world: World, body: str, arm: str) -> bool:
    return any(each.startswith(f"{arm}.") and each != f"{arm}.base" for each in world.supports(body)[1:])


def _value(cell: Cell, world: World, body: str) -> float:
    """How far a body is along its guide in a world."""
    guide = cell.bodies[body].guide
    assert guide is not None
    home = transforms.of_pose(cell.bodies[body].placement.pose)
    moved = transforms.inverse(home) @ world.placed[body].T_parent_frame
    along = moved[:3, 3] if guide.kind.value == "prismatic" else transforms.rotation_vector(moved[:3, :3])
    return float(along @ np.array(guide.axis))
