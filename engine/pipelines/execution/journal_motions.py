"""Motions found from a run's journal: where arms and bodies are at any time of the run.

A journal says which step was under way and since when, not how the arm went. So each step gets the
motion that planning would give it, from where the arm was, and the motion takes the time that the
step took. What the arm has met is in the way from then on; a step that was stopped leaves the arm
where it was.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import LegKind, MovedStep, StepLeg, Unmoved
from cellwright.engine.model.run_protocol import (
    BODIES_SEEN,
    OBSTRUCTED_REPLIES,
    JournalRecord,
    RecordKind,
)
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.plan_records import read_ground_atom
from cellwright.engine.pipelines.motion.arm_progress import Where
from cellwright.engine.pipelines.motion.places_in_a_row import step_parts
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, operation_of
from cellwright.engine.pipelines.motion.seen_bodies import seen_in, with_seen
from cellwright.engine.pipelines.motion.step_motion import guide_value
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.kb.model.cell_model import Cell
from cellwright.kb.model.plan_model import Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom

MAX_KEPT_WORLDS = 64  # worlds, each for other facts


@dataclass(frozen=True, slots=True, eq=False)
class TakenStep:
    """A step that a run began with the record `number`: its motion, or why it has none, and the
    facts before and after it.
    """

    number: int
    command: int
    motion: MovedStep | Unmoved
    before: frozenset[Atom]
    after: frozenset[Atom]


@dataclass(eq=False)
class Retracing:
    """Finds the motions of the steps of a run, record by record; `number` is that of the last,
    `facts` what the run holds for true.
    """

    walk: PlanWalk
    facts: frozenset[Atom]
    number: int = 0
    _changes: dict[int, Mapping[str, list[str]]] = field(default_factory=dict)
    _met: dict[str, Any] = field(default_factory=dict)
    _stood: dict[int, Where] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._cell = self.walk.cell

    @classmethod
    def of(
        cls, problem: Problem, cell: Cell, backend: GeometryBackend, seed: int = 0
    ) -> "Retracing":
        """At the start of a run of the problem."""
        walk = PlanWalk(PlanGate().semantics(problem), cell, backend, seed)
        return cls(walk, frozenset(initial_situation(problem).state))

    def take(self, record: JournalRecord) -> TakenStep | None:
        """Take in a record; the motion that begins with it, if one does."""
        content, self.number = record.content, record.number
        match record.kind:
            case RecordKind.PLAN:
                self._changes = {step["id"]: step for step in content["steps"]}
            case RecordKind.DONE | RecordKind.WORLD:
                self.facts = self._after(content)
                if content.get("bodies"):
                    self._sees(content["bodies"])
            case RecordKind.REPLY:
                stood = self._stood.pop(content["command"], {})
                self.walk.hands.put(stood if content.get("text") == OBSTRUCTED_REPLIES else {})
            case RecordKind.COMMAND if content.get("step") in self._changes:
                return self._begun(record, self._changes[content["step"]])
            case _:
                pass
        return None

    def _after(self, change: Mapping[str, list[str]]) -> frozenset[Atom]:
        ended = set(map(read_ground_atom, change.get("ends", ())))
        return (self.facts - ended) | set(map(read_ground_atom, change.get("adds", ())))

    def _sees(self, told: Mapping[str, Any]) -> None:
        """Some bodies were seen: they are in the way from now on, or are where a fact puts them."""
        self._met = {name: body for name, body in {**self._met, **told}.items() if body}
        seen, _ = seen_in({BODIES_SEEN: self._met}, self._cell)
        where, lying = self.walk.hands.where(), {body.name: body.T_world for body in seen}
        known_poses = {name: T for name, T in lying.items() if name in self._cell.bodies}
        self.walk = PlanWalk(
            self.walk.semantics,
            with_seen(self._cell, seen),
            self.walk.backend,
            self.walk.seed,
            lying=known_poses,
        )
        self.walk.hands.put(where)

    def _begun(self, record: JournalRecord, change: Mapping[str, list[str]]) -> TakenStep | None:
        action = read_ground_atom(record.content["action"])
        operation = operation_of(self.walk.cell, action)
        if operation is None:
            return None
        step, after = Step(StepId(record.content["step"]), action), self._after(change)
        self._stood[record.content["command"]] = self.walk.hands.where()
        motion = self.walk.step(step, operation, self.facts, after)
        return TakenStep(record.number, record.content["command"], motion, self.facts, after)


@dataclass(frozen=True, eq=False)
class StepStretch:
    """A part of a step, from `start_s` on, in the state before it or after it; without a leg
    the arm rests at `q` (k,).
    """

    start_s: float
    seconds: float
    leg: StepLeg | None
    q: Floats
    later: bool


def step_stretches(motion: MovedStep) -> list[StepStretch]:
    """The parts of a motion in their order.

    What is done at the place is done when the arm is in it, and before it goes out.
    """
    legs = motion.legs
    inside = max((n for n, leg in enumerate(legs) if leg.kind is LegKind.IN), default=len(legs) - 1)
    parts, now = [], 0.0
    for n, leg in enumerate(legs):
        later = leg.kind is LegKind.OUT and n > inside
        parts.append(StepStretch(now, leg.seconds, leg, leg.path[-1], later))
        now += leg.seconds
        if n == inside and motion.takes_s:
            driven = leg if leg.kind is LegKind.DRIVE else None
            parts.append(StepStretch(now, motion.takes_s, driven, leg.path[-1], False))
            now += motion.takes_s
    return parts


def configuration_at(stretch: StepStretch, seconds: float) -> Floats:
    """The configuration (k,) of the arm so long after the start of the step; between corners
    the joints go evenly.
    """
    leg = stretch.leg
    if leg is None or len(leg.path) < 2 or leg.kind is LegKind.DRIVE:
        return stretch.q
    at = np.clip(seconds - stretch.start_s, 0.0, leg.seconds)
    columns = [np.interp(at, leg.corners_s, column) for column in leg.path.T]
    q: Floats = np.array(columns)
    return q


class RestingCell:
    """The cell with its bodies where facts put them, and its arms at home; the last few worlds
    are kept.
    """

    def __init__(self, cell: Cell) -> None:
        self.home = GeometricWorld.of(cell)
        self.with_facts = lru_cache(MAX_KEPT_WORLDS)(
            lambda facts: world_after_facts(self.home, facts)
        )


def world_during(resting: RestingCell, taken: TakenStep, share: float) -> GeometricWorld:
    """The cell when a share (0 to 1) of the step's time is over.

    A step without a motion leaves everything where it was until it is over.
    """
    motion = taken.motion
    if isinstance(motion, Unmoved) or not motion.legs:
        return resting.with_facts(taken.after if share >= 1.0 else taken.before)
    arm, after = motion.legs[0].arm, resting.with_facts(taken.after)
    if share >= 1.0:
        return after.moved(arm, motion.legs[-1].path[-1])
    before = resting.with_facts(taken.before)
    part, old, new, seconds = _part_at(motion, before, after, share * motion.seconds)
    parts = step_stretches(part)
    now = next((part for part in reversed(parts) if part.start_s <= seconds), parts[0])
    world = new if now.later else old
    if now.leg is not None and now.leg.kind is LegKind.DRAG:
        dragged = _operation_body(resting.home, taken, "drags")
        world = world.moved(arm, now.leg.path[0])
        return world.affix(dragged, f"{arm}.tool").moved(arm, configuration_at(now, seconds))
    if now.leg is not None and now.leg.kind is LegKind.DRIVE and now.seconds:
        world = _driven_world(resting, taken, world, (seconds - now.start_s) / now.seconds)
    return world.moved(arm, configuration_at(now, seconds))


def _part_at(
    motion: MovedStep, before: GeometricWorld, after: GeometricWorld, seconds: float
) -> tuple[MovedStep, GeometricWorld, GeometricWorld, float]:
    """The part of a step at one place that is under way after so many seconds, with the cell before
    and after it; the time since that part began.
    """
    parts = [part for part in step_parts(motion, before, after) if part[0].legs]
    for part in parts[:-1]:
        if seconds < part[0].seconds:
            return (*part, seconds)
        seconds -= part[0].seconds
    return (*parts[-1], seconds)


def _operation_body(world: GeometricWorld, taken: TakenStep, kind: str) -> str:
    operation = operation_of(world.cell, taken.motion.operator)
    assert operation is not None
    return str(getattr(operation, kind))


def _driven_world(
    resting: RestingCell, taken: TakenStep, world: GeometricWorld, share: float
) -> GeometricWorld:
    """The world with the body that carries the arm a share of its way along."""
    body = _operation_body(resting.home, taken, "drives")
    first, last = (
        guide_value(resting.with_facts(facts), body) for facts in (taken.before, taken.after)
    )
    return world.guided(body, first + min(1.0, share) * (last - first))


def tool_path(resting: RestingCell, taken: TakenStep, count: int = 60) -> Floats:
    """Points (count, 3) that the tool of the arm passes during a step, in the world; none if
    nothing moves.
    """
    if isinstance(taken.motion, Unmoved) or not taken.motion.legs:
        return np.zeros((0, 3))
    arm = taken.motion.legs[0].arm
    shares: Iterable[float] = np.linspace(0.0, 1.0, count)
    poses = [
        world_during(resting, taken, float(share)).pose("world", f"{arm}.tool") for share in shares
    ]
    return np.array([pose[:3, 3] for pose in poses])
