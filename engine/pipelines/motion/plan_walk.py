"""Walks an arm through the steps of a plan: each motion starts where the one before has ended."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import LegKind, MovedStep, StepLeg, Unmoved
from cellwright.engine.model.plan_times import earliest_starts
from cellwright.engine.pipelines.inspection.measurement_places import measured_cell
from cellwright.engine.pipelines.motion.arm_progress import ArmsProgress, Front, Where, bodies_held
from cellwright.engine.pipelines.motion.cell_state import BodyRide, CellState, arms_of_step
from cellwright.engine.pipelines.motion.places_in_a_row import PlacesInARow
from cellwright.engine.pipelines.motion.seen_bodies import placing_facts
from cellwright.engine.pipelines.motion.step_motion import StepMotion, guide_value
from cellwright.engine.pipelines.motion.two_arm_steps import TwoArmStep
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry.kinematics.inverse_kinematics import InverseKinematics
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.step_changes import State
from cellwright.kb.model.cell_model import Cell, Ends, Location, Operation, Place
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.syntax import SECONDS_PER_UNIT
from cellwright.kb.terms import (
    Atom,
    Function,
    Term,
    Variable,
    match_term,
    substitute_term,
    term_variables,
)


def states_of(semantics: Semantics, plan: Plan) -> Iterator[tuple[Step, State, State]]:
    """Each step in the order of the earliest starts, with the facts before and after it."""
    state = semantics.initial()
    for step in steps_by_start(plan):
        after = after_step(semantics, step, state)
        yield step, state, after
        state = after


def steps_by_start(plan: Plan) -> list[Step]:
    """The steps in the order of the earliest starts; of those that start together, in the order
    of the plan.
    """
    starts = earliest_starts(plan)
    place = {step.id: number for number, step in enumerate(plan.steps)}
    return sorted(plan.steps, key=lambda step_entry: (starts[step_entry.id], place[step_entry.id]))


def after_step(semantics: Semantics, step: Step, state: State) -> State:
    """The facts after a step; those before it, if it is none of the domain."""
    bound = semantics.binding(step.operator)
    if isinstance(bound, str):
        return state
    change = semantics.change(*bound, semantics.facts(state), state)
    return (state - change.ends) | change.adds


_Situation = tuple[
    Function, frozenset[Atom], frozenset[Atom], bytes, tuple[tuple[bytes, str, bool], ...]
]
_Stand = tuple[str, Floats, Front | None]  # an arm, its configuration, and what it stands before
_Outcome = tuple[MovedStep | Unmoved, tuple[_Stand, ...]]


# straight ways (m, k) into a place, from a station
Ways = Mapping[tuple[str, str], Sequence[Floats]]


@dataclass(eq=False)
class PlanWalk:
    """What an arm does through plans for one problem.

    What was found for a step in a situation is kept for the next plan.
    """

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
    _rooms: dict[tuple[frozenset[Atom], bytes, tuple[str, ...]], CellState] = field(
        default_factory=dict
    )
    _known: dict[_Situation, _Outcome] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.cell = measured_cell(self.semantics, self.cell)
        world = GeometricWorld.of(self.cell)
        self._kinematics = {name: InverseKinematics(model) for name, model in world.models.items()}
        self.hands = ArmsProgress(self.cell, self.seed, self.bridges)
        self._moving = {location.fact.name for location in self.cell.locations}

    def steps(
        self, plan: Plan, home: Collection[StepId] = (), start: Where | None = None
    ) -> Iterator[MovedStep | Unmoved]:
        """The motion of each step that has one, in the order of the earliest starts; the first
        without one is the last.

        After the steps in `home` the arm goes to where it rests. Arms begin where they rest, or
        where `start` has them.
        """
        self.hands.go_home()
        self.hands.put(start or {})
        for step, before, after in states_of(self.semantics, plan):
            operation = operation_of(self.cell, step.operator)
            if operation is None:
                continue
            motion = self.step(step, operation, before, after)
            if isinstance(motion, MovedStep) and step.id in home:
                motion = self.then_home(motion, after)
            yield motion
            if isinstance(motion, Unmoved):
                return

    def step(
        self, step: Step, operation: Operation, before: State, after: State
    ) -> MovedStep | Unmoved:
        """The motion of one step from where the arm is now; the arm is at its end then."""
        if operation.drives:
            return self._driven(step, operation, before, after)
        beside = () if operation.with_place is None else (operation.with_place,)
        ends = (*operation.stops, *beside)
        lacking = next(
            (place_term for place_term in ends if str(place_term) not in self.cell.places), None
        )
        if lacking is not None or operation.at is None:
            message = f"{lacking} has no place in the cell"
            return Unmoved(step.id, step.operator, str(lacking), "reach", message, sure=True)
        arms = arms_of_step(self.cell, step.operator, operation)
        key = self._situation(step, arms, before, after)
        if key not in self._known:
            motion = self._refined(step, operation, arms, before, after)
            stand = tuple((arm, self.hands.now(arm), self.hands.standing(arm)) for arm in arms)
            self._known[key] = motion, stand
        motion, stand = self._known[key]
        for standing_arm in stand:
            self.hands.arrive(*standing_arm)
        return replace(motion, step=step.id)

    def then_home(self, moved: MovedStep, after: State) -> MovedStep:
        """The step, after which its arms go home one by one; one stays where it is if no way
        leads there.
        """
        legs = list(moved.legs)
        for arm in dict.fromkeys(leg.arm for leg in moved.legs):
            home_leg = self.homeward(arm, after)
            legs += [] if home_leg is None else [home_leg]
        return replace(moved, legs=tuple(legs))

    def homeward(self, arm: str, state: State) -> StepLeg | None:
        """The proved way of an arm to where it rests, where it then is; None if it stays
        because no way leads there.
        """
        home = GeometricWorld.of(self.cell).configurations[arm]
        home_leg = self.hands.way(self.room(state, (arm,)), arm, home[None])
        if not isinstance(home_leg, StepLeg) or not home_leg.proved:
            return None
        self.hands.arrive(arm, home, None)
        return home_leg

    def _situation(
        self, step: Step, arms: tuple[str, ...], before: State, after: State
    ) -> _Situation:
        stand = []
        for arm in arms:
            front = self.hands.standing(arm)
            front_place, inside = (front.place, front.inside) if front else ("", False)
            stand.append((self.hands.now(arm).tobytes(), front_place, inside))
        return (
            step.operator,
            self.located(before),
            self.located(after),
            self._lying,
            tuple(stand),
        )

    def _refined(
        self, step: Step, operation: Operation, arms: tuple[str, ...], before: State, after: State
    ) -> MovedStep | Unmoved:
        places = [self.cell.places[str(stop)] for stop in operation.stops]
        place, rooms = places[0], (self.room(before, arms), self.room(after, arms))
        known_ways = self._known_ways(place, before)
        motion: MovedStep | Unmoved
        if operation.then:
            ways = {stop.name: self._known_ways(stop, before) for stop in places}
            motion = PlacesInARow(self.hands, step, operation, places, *rooms, ways).moved()
            place = self.cell.places[motion.place]
        elif len(arms) > 1:
            motion = TwoArmStep(self.hands, step, operation, *rooms, known_ways).moved()
        else:
            motion = StepMotion(self.hands, step, operation, place, *rooms, known_ways).moved()
        if isinstance(motion, MovedStep):
            return motion
        standing = _carrying_bodies(
            rooms[0].world, place, {*motion.culprits, *bodies_held(rooms[0].world, place.arm)}
        )
        while_true = placing_facts(self.cell, before, standing)
        return replace(
            motion, while_true=while_true, regardless=self._regardless(motion, operation)
        )

    def _regardless(self, unmoved: Unmoved, operation: Operation) -> frozenset[int]:
        """The arguments of a refused step that do not matter: those that its place does not name,
        where only the place refuses.

        A way depends on where the arm comes from, a step back out of the place on what the step
        does there.
        """
        own = [
            alternative
            for alternative in self.cell.operations
            if alternative.operator.name == operation.operator.name
        ]
        if unmoved.level == "way" or len(own) != 1 or own[0].at is None or own[0].then:
            return frozenset()
        if unmoved.level == "approach" and operation.ends is Ends.OUTSIDE:
            return frozenset()
        named = set(term_variables(own[0].at))
        return frozenset(
            n
            for n, argument in enumerate(own[0].operator.arguments)
            if isinstance(argument, Variable) and argument not in named
        )

    def room(self, state: State, arms: tuple[str, ...] = ()) -> CellState:
        """The cell in a state as some arms meet it, alone or with each other; with all arms at
        rest if none are named.
        """
        facts = self.located(state)
        key = facts, self._lying, arms
        if key not in self._rooms:
            world = GeometricWorld.of(self.cell)
            for name, T in self.lying.items():
                world = world.put(name, "world", T)
            world = world_after_facts(world, facts)
            world = world.of_arms(arms) if arms else world
            self._rooms[key] = CellState(world, self.backend, self._kinematics)
        return self._rooms[key]

    @property
    def _lying(self) -> bytes:
        return b"".join(name.encode() + T.tobytes() for name, T in sorted(self.lying.items()))

    def located(self, state: State) -> frozenset[Atom]:
        """The facts of a state that put a body somewhere.

        What the last state had in common with it is not looked at again.
        """
        last, last_facts = self._last
        if state is not last:
            new, gone = state - last, last - state
            near = (fact for fact in new if fact.name in self._moving)
            more = {
                fact
                for fact in near
                if any(_fits_location(location, fact) for location in self.cell.locations)
            }
            if more or not last_facts.isdisjoint(gone):
                last_facts = (last_facts - gone) | more
            self._last = state, last_facts
        return last_facts

    def _driven(
        self, step: Step, operation: Operation, before: State, after: State
    ) -> MovedStep | Unmoved:
        """The arm rests while the body that carries it goes along its joint; it goes home first
        if it would touch something.
        """
        body = operation.drives
        arms = arms_of_step(self.cell, step.operator, operation)
        arm = next(
            name for name in arms if body in GeometricWorld.of(self.cell).supports(f"{name}.base")
        )
        rooms = self.room(before, (arm,)), self.room(after, (arm,))
        ride = BodyRide.of(
            rooms[0], body, guide_value(rooms[0].world, body), guide_value(rooms[1].world, body)
        )
        legs: list[StepLeg] = []
        touched = ride.touched(self._whole(rooms[0], arm))
        if touched:
            home = rooms[0].world.configurations[arm]
            path_found = self.hands.way(rooms[0], arm, home[None])
            if isinstance(path_found, StepLeg):
                legs.append(path_found)
                self.hands.arrive(arm, home, None)
                touched = ride.touched(self._whole(rooms[0], arm))
        if touched:
            message = f"{arm} touches {', '.join(touched)} on the way of {body}"
            return Unmoved(step.id, step.operator, body, "way", message, touched)
        self.hands.arrive(arm, self.hands.now(arm), None)
        q = self.hands.now(arm)[None]
        proved = ride.proved(self._whole(rooms[0], arm))
        legs.append(
            StepLeg(LegKind.DRIVE, arm, q, np.zeros(1), proved, bodies_held(rooms[0].world, arm))
        )
        takes = max(operation.takes_s, step.duration * self._unit_s)
        return MovedStep(step.id, step.operator, body, tuple(legs), takes)

    def _whole(self, room: CellState, arm: str) -> Floats:
        whole: Floats = room.whole(arm, self.hands.now(arm)[None])[0]
        return whole

    def _known_ways(self, place: Place, state: State) -> Sequence[Floats]:
        """The straight ways into a place that are known for where the arm stands."""
        if not self.ways:
            return ()
        stations = [str(fact.arguments[-1]) for fact in self.located(state) if fact.arguments]
        ways_found = (self.ways.get((place.name, station)) for station in (*sorted(stations), ""))
        return next(
            (ways_of_place for ways_of_place in ways_found if ways_of_place is not None), ()
        )

    @property
    def _unit_s(self) -> float:
        return float(SECONDS_PER_UNIT[self.semantics.problem.domain.time_unit])


def operation_of(cell: Cell, step: Function) -> Operation | None:
    """What an arm does in a step, its place without variables; None if the cell declares
    nothing for it.
    """
    for operation in cell.operations:
        bindings = match_term(operation.operator, step, {})
        if bindings is not None:
            at, beside, load, *then = (
                None if term is None else substitute_term(term, bindings)
                for term in (
                    operation.at,
                    operation.with_place,
                    operation.carries,
                    *operation.then,
                )
            )
            at, beside, *then = (_arm_own_place(cell, stop, step) for stop in (at, beside, *then))
            stops = tuple(stop for stop in then if stop is not None)
            return replace(
                operation, operator=step, at=at, with_place=beside, carries=load, then=stops
            )
    return None


def _arm_own_place(cell: Cell, place: Term | None, step: Function) -> Term | None:
    """A place, or that of the arm that the step names, where each arm has its own."""
    if place is None or str(place) in cell.places or not isinstance(place, Function):
        return place
    own = (
        Function(place.name, (*place.arguments, argument))
        for argument in step.arguments
        if str(argument) in cell.arms
    )
    return next((own_place for own_place in own if str(own_place) in cell.places), place)


def _carrying_bodies(world: GeometricWorld, place: Place, bodies: set[str]) -> set[str]:
    """Some bodies, and all that carries them, the arm or the place: what stands where decides
    whether the arm gets there.
    """
    ends = (*bodies, f"{place.arm}.base", place.placement.parent)
    return {on for end_name in ends for on in world.supports(end_name)}


def _fits_location(location: Location, fact: Atom) -> bool:
    return match_term(location.fact, fact, {}) is not None
