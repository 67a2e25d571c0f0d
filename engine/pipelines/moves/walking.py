"""An arm goes through the steps of a plan: each step's motion starts where the one before it has ended."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from engine.model.geometry import Floats
from engine.model.moves import Leg, LegKind, MovedStep, Unmoved
from engine.pipelines.moves.hands import Front, Hands, held
from engine.pipelines.moves.places import measured_cell
from engine.pipelines.moves.rides import Ride
from engine.pipelines.moves.rooms import Room
from engine.pipelines.moves.states import states_of
from engine.pipelines.moves.steps import StepMotion, guide_value
from engine.ports import GeometryBackend
from engine.stages.geometry.kinematics.inverse import InverseKinematics
from engine.stages.geometry.world.following import following
from engine.stages.geometry.world.model import World
from engine.stages.validation.changes import State
from engine.stages.validation.semantics import Semantics
from kb.model.cell import Cell, Ends, Location, Operation, Place
from kb.model.plan import Plan, Step
from kb.syntax import SECONDS
from kb.terms import Atom, Function, Term, Variable, match, substitute, variables

_Situation = tuple[Function, frozenset[Atom], frozenset[Atom], bytes, bytes, str, bool]
_Outcome = tuple[MovedStep | Unmoved, Floats, Front | None]


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
    _rooms: dict[tuple[frozenset[Atom], bytes], Room] = field(default_factory=dict)
    _known: dict[_Situation, _Outcome] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.cell = measured_cell(self.semantics, self.cell)
        world = World.of(self.cell)
        self._kinematics = {name: InverseKinematics(model) for name, model in world.models.items()}
        self.hands = Hands(self.cell, self.seed, self.bridges)
        self._moving = {each.fact.name for each in self.cell.locations}

    def steps(self, plan: Plan) -> Iterator[MovedStep | Unmoved]:
        """The motion of each step that has one, in the order of the earliest starts; the first without one is the last."""
        self.hands.go_home()
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
            return Unmoved(step.id, step.operator, str(operation.at), "reach", said, sure=True)
        key = self._situation(step, place.arm, before, after)
        if key not in self._known:
            found = self._refined(step, operation, place, before, after)
            self._known[key] = found, self.hands.now(place.arm), self.hands.standing(place.arm)
        found, q, front = self._known[key]
        self.hands.arrive(place.arm, q, front)
        return replace(found, step=step.id)

    def _situation(self, step: Step, arm: str, before: State, after: State) -> _Situation:
        front = self.hands.standing(arm)
        there, inside = (front.place, front.inside) if front else ("", False)
        facts = self._located(before), self._located(after)
        return (step.operator, *facts, self._lying, self.hands.now(arm).tobytes(), there, inside)

    def _refined(
        self, step: Step, operation: Operation, place: Place, before: State, after: State
    ) -> MovedStep | Unmoved:
        rooms = self.room(before), self.room(after)
        found = StepMotion(
            self.hands, step, operation, place, *rooms, self._known_ways(place, before)
        ).moved()
        if isinstance(found, MovedStep):
            return found
        standing = _carrying(rooms[0].world, place, {*found.culprits, *held(rooms[0].world, place.arm)})
        while_true = _placing(self.cell, before, standing)
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

    def room(self, state: State) -> Room:
        """The cell in a state, with the arms where they are."""
        facts = self._located(state)
        key = facts, self._lying
        if key not in self._rooms:
            world = World.of(self.cell)
            for name, T in self.lying.items():
                world = world.put(name, "world", T)
            self._rooms[key] = Room(following(world, facts), self.backend, self._kinematics)
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
        arm = next(name for name in self.cell.arms if body in World.of(self.cell).supports(f"{name}.base"))
        rooms = self.room(before), self.room(after)
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
            at: Term | None = None if operation.at is None else substitute(operation.at, bindings)
            return replace(operation, operator=step, at=at)
    return None


def _carrying(world: World, place: Place, bodies: set[str]) -> set[str]:
    """Some bodies, and all that carries them, the arm or the place: what stands where decides whether the arm gets there."""
    ends = (*bodies, f"{place.arm}.base", place.placement.parent)
    return {on for each in ends for on in world.supports(each)}


def _placing(cell: Cell, state: State, bodies: Collection[str]) -> tuple[Atom, ...]:
    """The facts of a state that put some bodies where they are."""
    found = []
    for fact in sorted(state, key=str):
        for location in cell.locations:
            bindings = match(location.fact, fact, {})
            if bindings is not None and str(substitute(location.body, bindings)) in bodies:
                found.append(fact)
                break
    return tuple(found)


def _fits(location: Location, fact: Atom) -> bool:
    return match(location.fact, fact, {}) is not None
