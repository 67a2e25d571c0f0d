"""An arm goes through the steps of a plan: each step's motion starts where the one before it has ended."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.moves import Leg, LegKind, MovedStep, Unmoved
from cellwright.engine.pipelines.moves.arms import arms_of
from cellwright.engine.pipelines.moves.hands import Front, Hands, Where, held
from cellwright.engine.pipelines.moves.recognising import putting
from cellwright.engine.pipelines.moves.rides import Ride
from cellwright.engine.pipelines.moves.rooms import Room
from cellwright.engine.pipelines.moves.states import states_of
from cellwright.engine.pipelines.moves.steps import StepMotion, guide_value
from cellwright.engine.pipelines.moves.together import JointStep
from cellwright.engine.pipelines.places import measured_cell
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry.kinematics.inverse import InverseKinematics
from cellwright.engine.stages.geometry.world.following import following
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.validation.changes import State
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.cell import Cell, Ends, Location, Operation, Place
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.syntax import SECONDS
from cellwright.kb.terms import Atom, Function, Term, Variable, match, substitute, variables

_Situation = tuple[Function, frozenset[Atom], frozenset[Atom], bytes, tuple[tuple[bytes, str, bool], ...]]
_Stand = tuple[str, Floats, Front | None]  # an arm, its configuration, and what it stands before
_Outcome = tuple[MovedStep | Unmoved, tuple[_Stand, ...]]


Ways = Mapping[tuple[str, str], Sequence[Floats]]  # straight ways (m, k) into a place, from a station


@dataclass(eq=False)
class Walk:
    """What an arm does through plans for one problem. What was found for a step in a situation is kept for the next plan."""

    semantics: Semantics
    cell: Cell
    backend: GeometryBackend
    seed: int = 0
    bridges: int = 30
    ways: Ways = field(default_factory=dict)
    lying: Mapping[str, Floats] = field(
        default_factory=dict
    )  # poses (4, 4) of bodies that no fact puts anywhere
    _last: tuple[State, frozenset[Atom]] = (frozenset(), frozenset())
    _rooms: dict[tuple[frozenset[Atom], bytes, tuple[str, ...]], Room] = field(default_factory=dict)
    _known: dict[_Situation, _Outcome] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.cell = measured_cell(self.semantics, self.cell)
        world = World.of(self.cell)
        self._kinematics = {name: InverseKinematics(model) for name, model in world.models.items()}
        self.hands = Hands(self.cell, self.seed, self.bridges)
        self._moving = {each.fact.name for each in self.cell.locations}

    def steps(
        self, plan: Plan, home: Collection[StepId] = (), start: Where | None = None
    ) -> Iterator[MovedStep | Unmoved]:
        """The motion of each step that has one, in the order of the earliest starts; the first without one is the last.

        After the steps in `home` the arm goes to where it rests. Arms begin where they rest, or where `start` has them.
        """
        self.hands.go_home()
        self.hands.put(start or {})
        for step, before, after in states_of(self.semantics, plan):
            operation = operation_of(self.cell, step.operator)
            if operation is None:
                continue
            found = self.step(step, operation, before, after)
            if isinstance(found, MovedStep) and step.id in home:
                found = self.then_home(found, after)
            yield found
            if isinstance(found, Unmoved):
                return

    def step(self, step: Step, operation: Operation, before: State, after: State) -> MovedStep | Unmoved:
        """The motion of one step from where the arm is now; the arm is at its end then."""
        if operation.drives:
            return self._driven(step, operation, before, after)
        ends = [each for each in (operation.at, operation.with_place) if each is not None]
        lacking = next((each for each in ends if str(each) not in self.cell.places), None)
        if lacking is not None or operation.at is None:
            said = f"{lacking} has no place in the cell"
            return Unmoved(step.id, step.operator, str(lacking), "reach", said, sure=True)
        arms = arms_of(self.cell, step.operator, operation)
        key = self._situation(step, arms, before, after)
        if key not in self._known:
            found = self._refined(step, operation, arms, before, after)
            stand = tuple((arm, self.hands.now(arm), self.hands.standing(arm)) for arm in arms)
            self._known[key] = found, stand
        found, stand = self._known[key]
        for each in stand:
            self.hands.arrive(*each)
        return replace(found, step=step.id)

    def then_home(self, moved: MovedStep, after: State) -> MovedStep:
        """The step, after which its arms go home one by one; one stays where it is if no way leads there."""
        legs = list(moved.legs)
        for arm in dict.fromkeys(leg.arm for leg in moved.legs):
            way = self.homeward(arm, after)
            legs += [] if way is None else [way]
        return replace(moved, legs=tuple(legs))

    def homeward(self, arm: str, state: State) -> Leg | None:
        """The proved way of an arm to where it rests, where it then is; None if it stays because no way leads there."""
        home = World.of(self.cell).configurations[arm]
        way = self.hands.way(self.room(state, (arm,)), arm, home[None])
        if not isinstance(way, Leg) or not way.proved:
            return None
        self.hands.arrive(arm, home, None)
        return way

    def _situation(self, step: Step, arms: tuple[str, ...], before: State, after: State) -> _Situation:
        stand = []
        for arm in arms:
            front = self.hands.standing(arm)
            there, inside = (front.place, front.inside) if front else ("", False)
            stand.append((self.hands.now(arm).tobytes(), there, inside))
        return (step.operator, self._located(before), self._located(after), self._lying, tuple(stand))

    def _refined(
        self, step: Step, operation: Operation, arms: tuple[str, ...], before: State, after: State
    ) -> MovedStep | Unmoved:
        place, rooms = self.cell.places[str(operation.at)], (self.room(before, arms), self.room(after, arms))
        known = self._known_ways(place, before)
        if len(arms) > 1:
            found = JointStep(self.hands, step, operation, *rooms, known).moved()
        else:
            found = StepMotion(self.hands, step, operation, place, *rooms, known).moved()
        if isinstance(found, MovedStep):
            return found
        standing = _carrying(rooms[0].world, place, {*found.culprits, *held(rooms[0].world, place.arm)})
        while_true = putting(self.cell, before, standing)
        return replace(found, while_true=while_true, regardless=self._regardless(found, operation))

    def _regardless(self, found: Unmoved, operation: Operation) -> frozenset[int]:
        """The arguments of a refused step that do not matter: those that its place does not name, where only the place refuses.

        A way depends on where the arm comes from, a step back out of the place on what the step does there.
        """
        own = [each for each in self.cell.operations if each.operator.name == operation.operator.name]
        if found.level == "way" or len(own) != 1 or own[0].at is None:
            return frozenset()
        if found.level == "approach" and operation.ends is Ends.OUTSIDE:
            return frozenset()
        named = set(variables(own[0].at))
        return frozenset(
            n
            for n, each in enumerate(own[0].operator.arguments)
            if isinstance(each, Variable) and each not in named
        )

    def room(self, state: State, arms: tuple[str, ...] = ()) -> Room:
        """The cell in a state as some arms meet it, alone or with each other; with all arms at rest if none are named."""
        facts = self._located(state)
        key = facts, self._lying, arms
        if key not in self._rooms:
            world = World.of(self.cell)
            for name, T in self.lying.items():
                world = world.put(name, "world", T)
            world = following(world, facts)
            world = world.of_arms(arms) if arms else world
            self._rooms[key] = Room(world, self.backend, self._kinematics)
        return self._rooms[key]

    @property
    def _lying(self) -> bytes:
        return b"".join(name.encode() + T.tobytes() for name, T in sorted(self.lying.items()))

    def _located(self, state: State) -> frozenset[Atom]:
        """The facts of a state that put a body somewhere. What the last state had in common with it is not looked at again."""
        last, known = self._last
        if state is not last:
            new, gone = state - last, last - state
            near = (fact for fact in new if fact.name in self._moving)
            more = {fact for fact in near if any(_fits(each, fact) for each in self.cell.locations)}
            if more or not known.isdisjoint(gone):
                known = (known - gone) | more
            self._last = state, known
        return known

    def _driven(self, step: Step, operation: Operation, before: State, after: State) -> MovedStep | Unmoved:
        """The arm rests while the body that carries it goes along its joint; it goes home first if it would touch something."""
        body = operation.drives
        arms = arms_of(self.cell, step.operator, operation)
        arm = next(name for name in arms if body in World.of(self.cell).supports(f"{name}.base"))
        rooms = self.room(before, (arm,)), self.room(after, (arm,))
        ride = Ride.of(rooms[0], body, guide_value(rooms[0].world, body), guide_value(rooms[1].world, body))
        legs: list[Leg] = []
        touched = ride.touched(self._whole(rooms[0], arm))
        if touched:
            home = rooms[0].world.configurations[arm]
            found = self.hands.way(rooms[0], arm, home[None])
            if isinstance(found, Leg):
                legs.append(found)
                self.hands.arrive(arm, home, None)
                touched = ride.touched(self._whole(rooms[0], arm))
        if touched:
            said = f"{arm} touches {', '.join(touched)} on the way of {body}"
            return Unmoved(step.id, step.operator, body, "way", said, touched)
        self.hands.arrive(arm, self.hands.now(arm), None)
        q = self.hands.now(arm)[None]
        proved = ride.proved(self._whole(rooms[0], arm))
        legs.append(Leg(LegKind.DRIVE, arm, q, np.zeros(1), proved, held(rooms[0].world, arm)))
        takes = max(operation.takes_s, step.duration * self._unit_s)
        return MovedStep(step.id, step.operator, body, tuple(legs), takes)

    def _whole(self, room: Room, arm: str) -> Floats:
        whole: Floats = room.whole(arm, self.hands.now(arm)[None])[0]
        return whole

    def _known_ways(self, place: Place, state: State) -> Sequence[Floats]:
        """The straight ways into a place that are known for where the arm stands."""
        if not self.ways:
            return ()
        stations = [str(fact.arguments[-1]) for fact in self._located(state) if fact.arguments]
        found = (self.ways.get((place.name, each)) for each in (*sorted(stations), ""))
        return next((each for each in found if each is not None), ())

    @property
    def _unit_s(self) -> float:
        return float(SECONDS[self.semantics.problem.domain.time_unit])


def operation_of(cell: Cell, step: Function) -> Operation | None:
    """What an arm does in a step, its place without variables; None if the cell declares nothing for it."""
    for operation in cell.operations:
        bindings = match(operation.operator, step, {})
        if bindings is not None:
            at, beside, load = (
                None if each is None else substitute(each, bindings)
                for each in (operation.at, operation.with_place, operation.carries)
            )
            at, beside = _own(cell, at, step), _own(cell, beside, step)
            return replace(operation, operator=step, at=at, with_place=beside, carries=load)
    return None


def _own(cell: Cell, place: Term | None, step: Function) -> Term | None:
    """A place, or that of the arm that the step names, where each arm has its own."""
    if place is None or str(place) in cell.places or not isinstance(place, Function):
        return place
    own = (
        Function(place.name, (*place.arguments, each)) for each in step.arguments if str(each) in cell.arms
    )
    return next((each for each in own if str(each) in cell.places), place)


def _carrying(world: World, place: Place, bodies: set[str]) -> set[str]:
    """Some bodies, and all that carries them, the arm or the place: what stands where decides whether the arm gets there."""
    ends = (*bodies, f"{place.arm}.base", place.placement.parent)
    return {on for each in ends for on in world.supports(each)}


def _fits(location: Location, fact: Atom) -> bool:
    return match(location.fact, fact, {}) is not None
