"""Motions of a run: what its arms can do in the cell as believed, kept apart from each other.

The orders of a plan keep its arms apart as long as they move as planned. An arm may take another
way while a run goes on, because it has met something or stands elsewhere. So each step is looked at
once more, before it is sent, beside what all other arms do then.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cellwright.engine.model.motion_values import LegKind, MovedStep, Unmoved
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.run_protocol import BODIES_SEEN
from cellwright.engine.model.troubleshooting import Revision
from cellwright.engine.pipelines.motion.arm_conflicts import (
    ArmEncounters,
    ArmPassage,
    ArmRider,
    StepMoment,
    passages_of,
)
from cellwright.engine.pipelines.motion.arm_passing import kept_apart
from cellwright.engine.pipelines.motion.arm_progress import Front, Where
from cellwright.engine.pipelines.motion.cell_state import arms_of_step
from cellwright.engine.pipelines.motion.moving_plan import MAX_REFUSED_STEPS, with_times
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, Ways, operation_of
from cellwright.engine.pipelines.motion.seen_bodies import (
    SeenBody,
    at_places,
    placing_facts,
    seen_in,
    with_seen,
)
from cellwright.engine.pipelines.planning.goal_selection import RelinquishedGoal
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.restrictions import (
    forbid_unreachable_steps,
    refusal_sentence,
)
from cellwright.engine.pipelines.recovery import Dynamics
from cellwright.engine.pipelines.recovery.observations import correct_state
from cellwright.engine.pipelines.recovery.replanning import recover_goals
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.cell_model import Cell
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function


@dataclass(frozen=True, slots=True, eq=False)
class _ArmsUnderWay:
    """What the arms of a command do."""

    passages: dict[str, tuple[ArmPassage, ...]]
    rides: bool


@dataclass(eq=False)
class ArmInterlock:
    """What is under way in a cell of several arms, by the numbers of commands."""

    encounters: ArmEncounters
    _under_way: dict[int, _ArmsUnderWay] = field(default_factory=dict)

    @classmethod
    def of(cls, cell: Cell) -> "ArmInterlock | None":
        """Nothing is under way yet; None for a cell with one arm, which meets no other."""
        return cls(ArmEncounters(geometry_backend())) if len(cell.arms) > 1 else None

    def met(self, number: int, moment: StepMoment, where: Where) -> str:
        """What the arms of a step meet, as the command of that number; empty if nothing, and the
        step is under way then.

        `where` is where all arms were before it.
        """
        own = _ArmsUnderWay(
            {arm: tuple(passages_of(moment, arm, where[arm][0])) for arm in moment.arms},
            moment.moved is not None
            and any(leg.kind is LegKind.DRIVE for leg in moment.moved.legs),
        )
        for arm in where:
            if arm not in own.passages and (how := self._meets(own, arm, moment, where)):
                return f"{' and '.join(own.passages)} would meet {arm} {how}"
        self._under_way[number] = own
        return ""

    def _meets(self, own: _ArmsUnderWay, arm: str, moment: StepMoment, where: Where) -> str:
        """How a step meets another arm; empty if it does not.

        An arm that rides is taken to meet one that moves.
        """
        mine = [passage for passages in own.passages.values() for passage in passages]
        for command in self._under_way.values():
            if arm in command.passages:
                met = own.rides or command.rides or self._any(mine, command.passages[arm])
                return "on its way" if met else ""
        rest = ArmPassage(ArmRider(moment.before, arm), where[arm][0][None])
        return "where it stands" if self._any(mine, [rest]) else ""

    def _any(self, mine: Sequence[ArmPassage], theirs: Sequence[ArmPassage]) -> bool:
        return any(
            self.encounters.meet(passage, arm_passage) for passage in mine for arm_passage in theirs
        )

    def ended(self, number: int) -> None:
        """A command has ended, or was stopped."""
        self._under_way.pop(number, None)


def step_moment(
    walk: PlanWalk, moved: MovedStep, before: frozenset[Atom], after: frozenset[Atom]
) -> StepMoment:
    """A step with the cell before and after it."""
    arms = arms_of_step(walk.cell, moved.operator, operation_of(walk.cell, moved.operator))
    return StepMoment(moved.step, walk.room(before).world, walk.room(after).world, moved, arms)


def going_home(cell: Cell, steps: Iterable[MovedStep]) -> frozenset[Function]:
    """The steps after which an arm goes to where it rests."""
    home = GeometricWorld.of(cell).configurations
    return frozenset(
        step.operator
        for step in steps
        for leg in step.legs[-1:]
        if leg.kind is LegKind.WAY and np.array_equal(leg.path[-1], home[leg.arm])
    )


Facts = frozenset[Atom]


@dataclass(frozen=True, slots=True)
class ReroutedPlan:
    """A plan from where a run stands that moves: its problem, with the real times of its steps,
    and what was given up for it.
    """

    problem: Problem
    plan: Plan
    given_up: tuple[RelinquishedGoal, ...] = ()
    starts: Mapping[StepId, int] | None = None  # where several arms keep apart


@dataclass(eq=False)
class RunPaths:
    """The motions of a run of a problem. `cell` is the cell as its file has it, `met` what was seen
    beside.

    After the steps in `home` arms go to where they rest, out of the way of others.
    """

    problem: Problem
    cell: Cell
    seed: int = 0
    ways: Ways = field(default_factory=dict)
    met: dict[str, SeenBody] = field(default_factory=dict)
    planned: PlanWalk | None = None  # the walk through the first plan, which knows its motions
    last: str = ""  # what was seen last
    home: frozenset[Function] = frozenset()
    _why: str = "it has no motion"  # the last step that was refused
    _refused: list[Unmoved] = field(default_factory=list)
    _before: dict[int, Where] = field(default_factory=dict)
    _lasts_ms: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._walk = self.planned or self._fresh(self.problem)
        self._walk.hands.go_home()
        self._apart = ArmInterlock.of(self.cell)

    def _fresh(self, problem: Problem) -> PlanWalk:
        """The arm in the cell as it is believed to be, in a problem."""
        cell = with_seen(self.cell, tuple(self.met.values()))
        lying = {name: body.T_world for name, body in self.met.items() if name in self.cell.bodies}
        semantics = PlanGate().semantics(problem)
        return PlanWalk(semantics, cell, geometry_backend(), self.seed, ways=self.ways, lying=lying)

    def refusal(self, number: int, step: Function, before: Facts, after: Facts) -> str:
        """Why a step has no motion from where the arm stands, as the command of that number; empty
        if it has one, or needs none.

        The arm is at its end then.
        """
        operation = operation_of(self._walk.cell, step)
        if operation is None:
            return ""
        where = self._walk.hands.where()
        motion = self._walk.step(Step(StepId(1), step), operation, before, after)
        if isinstance(motion, Unmoved):
            self._walk.hands.put(where)
            self._refused.append(motion)
            self._why = motion.reason
            return f"{step} has no motion: {motion.reason}"
        if self._apart is not None:
            motion = self._walk.then_home(motion, after) if step in self.home else motion
            self._why = self._apart.met(
                number, step_moment(self._walk, motion, before, after), where
            )
            if self._why:
                self._walk.hands.put(where)
                return f"{step} is not begun: {self._why}"
        self._before[number] = where
        if not operation.drives:
            self._lasts_ms[number] = math.ceil(motion.seconds * 1000 - 1e-6)
        return ""

    def lasts_ms(self, number: int) -> int | None:
        """How long the motion of a step takes, which was looked at as the command of that number.

        None if it needs none, or if the plan alone says how long: a body that carries the arm has
        no speeds. A plan counts whole units of time, rounded up for each step; over a thousand
        points that adds up.
        """
        return self._lasts_ms.pop(number, None)

    @property
    def reason(self) -> str:
        """Why the last step that was refused has no motion."""
        return self._why

    def done(self, number: int) -> dict[str, Any]:
        """A step has ended: where those arms are that it has moved, for the journal."""
        before = self._before.pop(number, None)
        if self._apart is not None:
            self._apart.ended(number)
        if before is None:
            return {}
        now = self._walk.hands.where()
        return {
            arm: _place_entry(*now[arm]) for arm in now if not _same_place(now[arm], before[arm])
        }

    def stopped(self, number: int) -> None:
        """A step was stopped: its arms are where they were before it."""
        self._walk.hands.put(self._before.pop(number, {}))
        if self._apart is not None:
            self._apart.ended(number)

    def entry(self) -> dict[str, Any]:
        """What a checkpoint holds of it."""
        where = self._walk.hands.where()
        return {
            "met": {name: body.entry() for name, body in self.met.items()},
            "arms": {arm: _place_entry(*where[arm]) for arm in where},
        }

    def taken_up(self, met: Mapping[str, Any], arms: Mapping[str, Any]) -> None:
        """Go on with what the journal has of a run."""
        seen, _ = seen_in(
            {BODIES_SEEN: {name: entry for name, entry in met.items() if entry}}, self.cell
        )
        self.met = {body.name: body for body in seen}
        self._walk = self._fresh(self.problem) if self.met else self._walk
        self.stands(arms)

    def stands(self, arms: Mapping[str, Any]) -> None:
        """Some arms are where the journal has them."""
        self._walk.hands.put({arm: _read_place(entry) for arm, entry in arms.items()})

    def sees(self, seen: Sequence[SeenBody], facts: Facts) -> Facts:
        """The facts after some bodies were seen.

        A body that the cell knows is where a fact puts it, if it was seen at a place; else it lies
        where it was seen.
        """
        where = self._walk.hands.where()
        self.last = " and ".join(body.name for body in seen)
        for body in seen:
            self.met.pop(body.name, None)
            is_known = body.name in self.cell.bodies
            places = at_places(self.cell, body)[:1] if is_known else ()
            gone = tuple(
                fact for fact in placing_facts(self.cell, facts, (body.name,)) if fact not in places
            )
            try:
                facts = frozenset(correct_state(Dynamics(self.problem), facts, places, gone))
            except InvalidInput:  # the domain does not let it be there: it is in the way, no more
                places = ()
            if not places:
                self.met[body.name] = body
        self._walk = self._fresh(self.problem)
        self._walk.hands.put(where)
        return facts

    def forget(self) -> None:
        """A person has put the cell right: what was met is gone, and what had no motion may
        have one.
        """
        where = self._walk.hands.where()
        self.met.clear()
        self._refused.clear()
        self._walk = self._fresh(self.problem)
        self._walk.hands.put(where)

    def rerouted(
        self, rest: Problem, left: Plan | None, facts: Facts, limits: SearchLimits
    ) -> ReroutedPlan | str:
        """A plan for what is left of a run, from some facts and from where the arm stands, in
        which every step moves; why there is none.
        """
        where = self._walk.hands.where()
        while len(self._refused) <= MAX_REFUSED_STEPS:
            recovery = recover_goals(
                forbid_unreachable_steps(rest, self._refused), Revision(), limits, left, facts
            )
            if not isinstance(recovery.outcome, Found):
                return f"{recovery.outcome.reason}; {refusal_sentence(self._refused)}"
            walk = self._fresh(replace(recovery.problem, domain=rest.domain))
            steps = list(walk.steps(recovery.outcome.plan, start=where))
            if steps and isinstance(steps[-1], Unmoved):
                self._refused.append(steps[-1])
                continue
            moved = [moved_step for moved_step in steps if isinstance(moved_step, MovedStep)]
            timed_plan = self._in_time(
                walk, replace(recovery.problem, domain=rest.domain), recovery.outcome.plan, moved
            )
            if isinstance(timed_plan, str):
                return timed_plan
            self._walk = walk
            self._walk.hands.go_home()
            self._walk.hands.put(where)
            return replace(
                timed_plan, given_up=tuple(replace(g, why=self._lost(g)) for g in recovery.given_up)
            )
        return (
            f"{len(self._refused)} steps have no motion; the last: "
            f"{refusal_sentence(self._refused[-1:])}"
        )

    def _in_time(
        self, walk: PlanWalk, problem: Problem, plan: Plan, moved: Sequence[MovedStep]
    ) -> ReroutedPlan | str:
        """A plan with the times of its motions, in which several arms keep apart; why they
        cannot.
        """
        if self._apart is None:
            return ReroutedPlan(*with_times(problem, plan, moved))

        def lasting(plan: Plan, steps: Sequence[MovedStep]) -> Plan:
            return with_times(problem, plan, steps)[1]

        where = self._walk.hands.where()
        shared = kept_apart(walk, plan, lasting, self._apart.encounters, {}, where)
        if isinstance(shared, str):
            return f"the arms get in each other's way: {shared}"
        self.home = going_home(walk.cell, shared.steps)
        return ReroutedPlan(*with_times(problem, shared.plan, shared.steps), starts=shared.starts)

    def _lost(self, given_up: RelinquishedGoal) -> str:
        return (
            f"{given_up.why}; {refusal_sentence(self._refused)}" if self._refused else given_up.why
        )


def _same_place(one: tuple[Any, Front | None], other: tuple[Any, Front | None]) -> bool:
    return one[1] is other[1] and np.array_equal(one[0], other[0])


def _place_entry(q: Any, front: Front | None) -> dict[str, Any]:
    entry: dict[str, Any] = {"q": q.tolist()}
    if front is None:
        return entry
    return {
        **entry,
        "place": front.place,
        "inside": front.inside,
        "straight": front.straight.tolist(),
    }


def _read_place(entry: Mapping[str, Any]) -> tuple[Any, Front | None]:
    q = np.array(entry["q"], float)
    if "place" not in entry:
        return q, None
    return q, Front(entry["place"], np.array(entry["straight"], float), entry["inside"])
