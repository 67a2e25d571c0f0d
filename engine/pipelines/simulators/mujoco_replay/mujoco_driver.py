"""Driver `mujoco`: physics moves the arms' steps and decides whether they have worked."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import LegKind, MovedStep, StepLeg
from cellwright.engine.pipelines.motion.arm_conflicts import (
    ArmEncounters,
    ArmPassage,
    ArmRider,
    StepMoment,
    occupied_tracks,
)
from cellwright.engine.pipelines.motion.arm_progress import Where
from cellwright.engine.pipelines.motion.cell_state import arms_of_step
from cellwright.engine.pipelines.motion.places_in_a_row import step_parts
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, operation_of
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.simulators import (
    HiddenCell,
    Simulator,
    fault_base,
    option_number,
    settings_of,
)
from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_model import finger_bodies, is_free
from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_stage import (
    REST_TIME_S,
    MujocoStage,
)
from cellwright.engine.pipelines.simulators.mujoco_replay.replay_contacts import ArmStopped
from cellwright.engine.pipelines.simulators.mujoco_replay.sensor_readings import sensor_reading
from cellwright.engine.pipelines.simulators.mujoco_replay.servos import NEAR_M, guide_position
from cellwright.engine.pipelines.simulators.unmodelled import (
    UNKNOWN_OPTIONS,
    UnmodelledThings,
    moving_cell,
    unknown_of,
)
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.ports import DriverSetup
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint
from cellwright.kb.model.cell_model import Cell
from cellwright.kb.model.plan_model import Step, StepId
from cellwright.kb.terms import Atom, Function, match_term, substitute_term

RETREAT_SLOWDOWN = 2.0  # times as long as on the way there


def retreat_from_stop(
    stage: MujocoStage,
    moved: MovedStep,
    stopped: ArmStopped,
    before: GeometricWorld,
    after: GeometricWorld,
) -> None:
    """Go back from where a step was stopped, on one of its legs; what was taken at a place is left
    there, and the other way round.
    """
    guard, stage.guard = stage.guard, frozenset()
    parts = step_parts(moved, before, after)
    last = next(n for n, (part, *_) in enumerate(parts) if _has_leg(part, stopped.leg))
    done = next(n for n, leg in enumerate(parts[last][0].legs) if leg is stopped.leg)
    stage.follow(reverse_leg(stopped.leg, stopped.at_s))
    for number in range(last, -1, -1):
        part, old, new = parts[number]
        _undo_legs(stage, part.legs[:done] if number == last else part.legs, old, new)
    stage.guard = guard


def _has_leg(part: MovedStep, leg: StepLeg) -> bool:
    return any(own_leg is leg for own_leg in part.legs)


def _undo_legs(
    stage: MujocoStage, legs: Sequence[StepLeg], before: GeometricWorld, after: GeometricWorld
) -> None:
    """Go back on legs at one place, and undo what was done there."""
    for leg in reversed(legs):
        if leg.kind is LegKind.IN:
            for tool in stage.tools:
                stage.latches.exchange(tool, after, before)
            stage.fingers(leg.arm, before, closed=False)
            stage.wait(REST_TIME_S)
        stage.follow(reverse_leg(leg, leg.seconds))


def reverse_leg(leg: StepLeg, at_s: float) -> StepLeg:
    """The way back to the beginning of a leg from where it is at a time, slower."""
    passed = leg.corners_s < at_s
    path = np.concatenate([leg.at(at_s)[None], leg.path[passed][::-1]])
    corners = RETREAT_SLOWDOWN * np.concatenate([[0.0], at_s - leg.corners_s[passed][::-1]])
    beside = tuple(reverse_leg(leg_beside, at_s) for leg_beside in leg.beside)
    return replace(leg, path=path, corners_s=corners, beside=beside)


FIRST_STEP = StepId(1)

Facts = Collection[Atom]


@dataclass(frozen=True, slots=True)
class CellHindrance:
    """What makes a physical cell other than its model: a friction of all parts, joints that are
    blocked, parts that are stuck.
    """

    friction: float | None = None
    blocked: tuple[str, ...] = ()
    stuck: tuple[str, ...] = ()


class PhysicalCell:
    """The physical cell of a run."""

    def __init__(
        self,
        walk: PlanWalk,
        start: Facts,
        hindrance: CellHindrance = CellHindrance(),
        unknown: UnmodelledThings | None = None,
    ) -> None:
        self.walk, self.cell, self.hindrance = walk, walk.cell, hindrance
        self.unknown = unknown or UnmodelledThings(walk.cell)
        whole = replace(walk.cell, bodies={**walk.cell.bodies, **self.unknown.bodies})
        self.stage = MujocoStage(
            world_after_facts(GeometricWorld.of(whole), self.unknown.real(start))
        )
        self._encounters = ArmEncounters(walk.backend)
        self._told: Mapping[str, Any] = {}
        self._failed: Facts | None = None
        self._last: list[str] = []  # what the last step was to move
        # of a step that was stopped while the arm dragged something
        self._way_in: StepLeg | None = None
        if hindrance.friction is not None:
            self.stage.make_slippery(hindrance.friction)
        for name in hindrance.blocked:
            self.stage.block(name, True)
        for name in hindrance.stuck:
            self.stage.stick(name, True)

    def carries_out(self, step: Function, before: Facts, after: Facts) -> bool:
        """Take a step; whether all bodies that it moves are then where the facts put them.

        A step without a motion is done.
        """
        self._open_after_failure()
        operation = operation_of(self.cell, step)
        if operation is None:
            return True
        believed, where = self.unknown.believed, self.walk.hands.where()
        self.walk.lying, self._told = self._lying(before), {}
        moved = self.walk.step(Step(FIRST_STEP, step), operation, believed(before), believed(after))
        if not isinstance(moved, MovedStep):
            return self._stopped_again()
        worlds, self._last = (self._world(before), self._world(after)), self._moved(before, after)
        self.stage.guard = frozenset()
        self._make_way(moved, step, believed(before), believed(after))
        self.stage.guard = self.unknown.names
        try:
            self._way_in = self.stage.take(moved, *worlds, stops=True)
        except ArmStopped as stopped:
            retreat_from_stop(self.stage, moved, stopped, *worlds)
            self._meets(stopped.body, where)
            return False
        if self._way_in is not None:
            self.walk.hands.arrive(self._way_in.arm, self._way_in.path[0], None)
        return all(self._is_where(name, after) for name in self._moved(before, after))

    def _make_way(
        self, moved: MovedStep, step: Function, before: frozenset[Atom], after: frozenset[Atom]
    ) -> None:
        """Arms that rest in the way of a step go home first."""
        arms = arms_of_step(self.cell, step, operation_of(self.cell, step))
        other_arms = [arm for arm in self.cell.arms if arm not in arms]
        if not other_arms:
            return
        room_before, room_after = (self.walk.room(facts).world for facts in (before, after))
        now = {arm: self.walk.hands.now(arm) for arm in self.cell.arms}
        starts = {**now, **{leg.arm: leg.path[0] for leg in reversed(moved.legs)}}
        own = occupied_tracks(
            [StepMoment(moved.step, room_before, room_after, moved, arms)], starts
        )
        passages = [
            passage for arm in arms for occupied in own[arm] for passage in occupied.passages
        ]
        for arm in other_arms:
            rest = ArmPassage(ArmRider(room_before, arm), now[arm][None])
            if any(self._encounters.meet(rest, passage) for passage in passages):
                path_home = self.walk.homeward(arm, before)
                if path_home is not None:
                    self.stage.go(path_home, self._world(before))

    def _stopped_again(self) -> bool:
        """A step has no motion: because of what was met, if something was."""
        if met := min(self.unknown.met, default=""):
            self._told = self.unknown.meets(met, self.stage.world)
        return False

    def _meets(self, body: str, where: Where) -> None:
        """The arm has met a body, and is back where it was; from now on motions are found
        around it.
        """
        self._told = self.unknown.meets(body, self.stage.world)
        walk = PlanWalk(self.walk.semantics, self.unknown.known, self.walk.backend, self.walk.seed)
        walk.hands.put(where)
        self.walk = walk

    def met(self) -> Mapping[str, Any]:
        """What has stopped the arm in the last step, as the data of a reply; empty if nothing
        has.
        """
        return self._told

    def misfit(self, facts: Facts, before: Facts, after: Facts) -> int:
        """How many of the bodies that a step was to move are not as some facts say, `before` and
        `after` being those of the step.

        A body that no fact puts anywhere should be at neither place.
        """
        placed, wrong = self._placed(facts), 0
        for name in self._moved(before, after):
            if name in placed:
                wrong += not self._is_where(name, facts)
            else:
                wrong += self._is_where(name, before) or self._is_where(name, after)
        return wrong

    def failed(self, facts: Facts) -> None:
        """A step has failed. The hand will be as the facts say, and the arm away, when something is
        done next.

        Until then sensors read how it is: a hand that dragged something still holds it."""
        self._failed = facts

    def reading(self, sensor: str) -> str:
        """What a sensor of the cell reads now; empty for one that it has not."""
        sensor_model = self.cell.sensors.get(sensor)
        return sensor_reading(self.stage, self.stage.world, sensor_model) if sensor_model else ""

    def tells(self, sensor: str, shown: str) -> str:
        """The outcome of a test that a reading means; the reading itself, if the cell says
        nothing else.
        """
        return self.cell.sensors[sensor].tells.get(shown, shown)

    def _open_after_failure(self) -> None:
        if self._failed is None:
            return
        world = self._world(self._failed)
        for arm in self.cell.arms:
            self.stage.fingers(arm, world, closed=False)
        self.stage.wait(REST_TIME_S)
        if self._way_in is not None:
            self.stage.back_out(self._way_in)
        self._failed = self._way_in = None

    def repaired(self, before: Facts, after: Facts) -> None:
        """A repair has helped: nothing is blocked or stuck any more, and what it has brought
        somewhere is there.
        """
        for name in self.hindrance.blocked:
            self.stage.block(name, False)
        for name in self.hindrance.stuck:
            self.stage.stick(name, False)
        world = self._world(after)
        for name in self._moved(before, after):
            if name in self._placed(after) and not self._is_where(name, after):
                self.stage.put(name, world)
        self.failed(after)
        self._open_after_failure()
        for name in self._halfway(world):
            if name in self._placed(after):
                self.stage.put(name, world)

    def _halfway(self, world: GeometricWorld) -> list[str]:
        """The joints that the last step was to move, which may have stopped halfway, and the
        parts that ride on them, crooked perhaps.
        """
        joints = [name for name in self._last if self.cell.bodies[name].guide is not None]
        parts = (name for name in self.cell.bodies if is_free(self.cell, name))
        return [
            *joints,
            *(name for name in parts if not set(joints).isdisjoint(world.supports(name)[1:])),
        ]

    def _world(self, facts: Facts) -> GeometricWorld:
        return world_after_facts(GeometricWorld.of(self.cell), facts)

    def _lying(self, facts: Facts) -> Mapping[str, Floats]:
        """Where the parts lie that no fact puts anywhere: poses in the world (4, 4)."""
        placed = self._placed(facts)
        free = (name for name in self.cell.bodies if is_free(self.cell, name))
        return {name: self.stage.pose(name) for name in free if name not in placed}

    def _placed(self, facts: Facts) -> set[str]:
        placed = set()
        for fact in facts:
            for location in self.cell.locations:
                bindings = match_term(location.fact, fact, {})
                if bindings is not None:
                    placed.add(str(substitute_term(location.body, bindings)))
        return placed

    def _moved(self, before: Facts, after: Facts) -> list[str]:
        """Parts and joints that two sets of facts put elsewhere, except for the fingers."""
        world_before, world_after = self._world(before), self._world(after)
        hands = {finger for arm in self.cell.arms for finger in finger_bodies(world_before, arm)}
        return [
            name
            for name, body in self.cell.bodies.items()
            if name not in hands
            and (is_free(self.cell, name) or (body.guide is not None and not body.guide.follows))
            and self._differs(name, world_before, world_after)
        ]

    def _differs(self, name: str, one: GeometricWorld, other: GeometricWorld) -> bool:
        mine, theirs = one.placed[name], other.placed[name]
        same = np.abs(mine.T_parent_frame - theirs.T_parent_frame).max() < 1e-9
        return mine.parent != theirs.parent or not same

    def _is_where(self, name: str, facts: Facts) -> bool:
        """Whether a body is where some facts put it.

        What is in a hand is measured from the hand.
        """
        world, body = self._world(facts), self.cell.bodies[name]
        if body.guide is not None:
            return self.stage.is_near(name, guide_position(world, name))
        actual = self.stage.actual(world).pose("world", name)[:3, 3]
        return float(np.linalg.norm(self.stage.pose(name)[:3, 3] - actual)) <= NEAR_M


HINDRANCE_OPTIONS = ("friction", "block", "stick")


def mujoco_simulator(setup: DriverSetup) -> Simulator:
    """The physical cell for a run.

    Options beside those of the simulator: friction, block and stick. Raises `InvalidInput`.
    """
    settings, unknown = (
        settings_of(setup, (*HINDRANCE_OPTIONS, *UNKNOWN_OPTIONS)),
        unknown_of(setup.options, setup.problem),
    )
    cell = moving_cell(setup.problem.domain.path)
    hindrance = _read_hindrance(setup.options, cell)
    semantics = PlanGate().semantics(setup.problem)
    walk = PlanWalk(semantics, cell, geometry_backend(), setup.seed)
    body = PhysicalCell(walk, semantics.initial(), hindrance, unknown)
    base = fault_base(setup.problem)
    hidden = HiddenCell(
        setup.problem, base, settings.injections, setup.seed, body=body, unknown=unknown
    )
    return Simulator(hidden, settings)


def _read_hindrance(options: Mapping[str, str], cell: Cell) -> CellHindrance:
    friction = option_number(options, "friction", -1.0) if "friction" in options else None
    if friction is not None and not 0.0 < friction <= 10.0:
        reason = f"a friction of {options['friction']} is no share of a force"
        raise InvalidInput([Diagnostic(Source("--option"), "K107", reason, "write friction=0.1")])
    joints = [name for name, body in cell.bodies.items() if body.guide is not None]
    parts = [name for name in cell.bodies if is_free(cell, name)]
    return CellHindrance(
        friction,
        tuple(_known_bodies("block", options, joints, "joint")),
        tuple(_known_bodies("stick", options, parts, "part or tool")),
    )


def _known_bodies(
    option: str, options: Mapping[str, str], names: list[str], kind: str
) -> list[str]:
    """The bodies that an option names, with commas between them."""
    asked = [name.strip() for name in options.get(option, "").split(",") if name.strip()]
    for body in asked:
        if body not in names:
            hint = nearest_hint(body, names) or f"one of: {', '.join(names)}"
            reason = f"the cell has no {kind} '{body}'"
            raise InvalidInput([Diagnostic(Source(f"--option {option}"), "K107", reason, hint)])
    return asked
