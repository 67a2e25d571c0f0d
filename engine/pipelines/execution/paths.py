"""What the arm of a run can do in the cell as it is believed to be.

Before a step is sent its motion is looked up from where the arm stands. What the arm meets, or a sensor sees, joins the cell. Where a
step has no motion any more, planning goes on without it, until a plan moves, or none is left. Where several arms share the cell, a
step is not sent either while it would meet another arm.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cellwright.engine.model.cases import Revision
from cellwright.engine.model.execution import SEEN
from cellwright.engine.model.moves import MovedStep, Unmoved
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.attainment import GivenUp
from cellwright.engine.pipelines.execution.apart import Apart, going_home, moment_of
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.moves.bars import told, without_blocked
from cellwright.engine.pipelines.moves.hands import Front, Where
from cellwright.engine.pipelines.moves.passing import kept_apart
from cellwright.engine.pipelines.moves.planning import MOST_BARS, with_times
from cellwright.engine.pipelines.moves.recognising import at_places, putting
from cellwright.engine.pipelines.moves.seen import Seen, seen_in, with_seen
from cellwright.engine.pipelines.moves.walking import Walk, Ways, operation_of
from cellwright.engine.pipelines.revision.observing import corrected
from cellwright.engine.pipelines.simulation import Dynamics
from cellwright.engine.pipelines.troubleshooting.recovery import recover
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.planning import Limits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.cell import Cell
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function

Facts = frozenset[Atom]


@dataclass(frozen=True, slots=True)
class Rerouted:
    """A plan from where a run stands that moves: its problem, with the real times of its steps, and what was given up for it."""

    problem: Problem
    plan: Plan
    given_up: tuple[GivenUp, ...] = ()
    starts: Mapping[StepId, int] | None = None  # where several arms keep apart


@dataclass(eq=False)
class Paths:
    """The motions of a run of a problem. `cell` is the cell as its file has it, `met` what was seen beside.

    After the steps in `home` arms go to where they rest, out of the way of others.
    """

    problem: Problem
    cell: Cell
    seed: int = 0
    ways: Ways = field(default_factory=dict)
    met: dict[str, Seen] = field(default_factory=dict)
    planned: Walk | None = None  # the walk through the first plan, which knows its motions
    last: str = ""  # what was seen last
    home: frozenset[Function] = frozenset()
    _why: str = "it has no motion"  # the last step that was refused
    _refused: list[Unmoved] = field(default_factory=list)
    _before: dict[int, Where] = field(default_factory=dict)
    _lasts_ms: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._walk = self.planned or self._fresh(self.problem)
        self._walk.hands.go_home()
        self._apart = Apart.of(self.cell)

    def _fresh(self, problem: Problem) -> Walk:
        """The arm in the cell as it is believed to be, in a problem."""
        cell = with_seen(self.cell, tuple(self.met.values()))
        lying = {name: each.T_world for name, each in self.met.items() if name in self.cell.bodies}
        semantics = PlanGate().semantics(problem)
        return Walk(semantics, cell, geometry_backend(), self.seed, ways=self.ways, lying=lying)

    def refusal(self, number: int, step: Function, before: Facts, after: Facts) -> str:
        """Why a step has no motion from where the arm stands, as the command of that number; empty if it has one, or needs none.

        The arm is at its end then.
        """
        operation = operation_of(self._walk.cell, step)
        if operation is None:
            return ""
        where = self._walk.hands.where()
        found = self._walk.step(Step(StepId(1), step), operation, before, after)
        if isinstance(found, Unmoved):
            self._walk.hands.put(where)
            self._refused.append(found)
            self._why = found.reason
            return f"{step} has no motion: {found.reason}"
        if self._apart is not None:
            found = self._walk.then_home(found, after) if step in self.home else found
            self._why = self._apart.met(number, moment_of(self._walk, found, before, after), where)
            if self._why:
                self._walk.hands.put(where)
                return f"{step} is not begun: {self._why}"
        self._before[number] = where
        if not operation.drives:
            self._lasts_ms[number] = math.ceil(found.seconds * 1000 - 1e-6)
        return ""

    def lasts_ms(self, number: int) -> int | None:
        """How long the motion of a step takes, which was looked at as the command of that number.

        None if it needs none, or if the plan alone says how long: a body that carries the arm has no speeds. A plan counts whole units
        of time, rounded up for each step; over a thousand points that adds up.
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
        return {arm: _entry(*now[arm]) for arm in now if not _same(now[arm], before[arm])}

    def stopped(self, number: int) -> None:
        """A step was stopped: its arms are where they were before it."""
        self._walk.hands.put(self._before.pop(number, {}))
        if self._apart is not None:
            self._apart.ended(number)

    def entry(self) -> dict[str, Any]:
        """What a checkpoint holds of it."""
        where = self._walk.hands.where()
        return {
            "met": {name: each.entry() for name, each in self.met.items()},
            "arms": {arm: _entry(*where[arm]) for arm in where},
        }

    def taken_up(self, met: Mapping[str, Any], arms: Mapping[str, Any]) -> None:
        """Go on with what the journal has of a run."""
        seen, _ = seen_in({SEEN: {name: each for name, each in met.items() if each}}, self.cell)
        self.met = {each.name: each for each in seen}
        self._walk = self._fresh(self.problem) if self.met else self._walk
        self.stands(arms)

    def stands(self, arms: Mapping[str, Any]) -> None:
        """Some arms are where the journal has them."""
        self._walk.hands.put({arm: _where(entry) for arm, entry in arms.items()})

    def sees(self, seen: Sequence[Seen], facts: Facts) -> Facts:
        """The facts after some bodies were seen.

        A body that the cell knows is where a fact puts it, if it was seen at a place; else it lies where it was seen.
        """
        where = self._walk.hands.where()
        self.last = " and ".join(each.name for each in seen)
        for each in seen:
            self.met.pop(each.name, None)
            known = each.name in self.cell.bodies
            found = at_places(self.cell, each)[:1] if known else ()
            gone = tuple(fact for fact in putting(self.cell, facts, (each.name,)) if fact not in found)
            try:
                facts = frozenset(corrected(Dynamics(self.problem), facts, found, gone))
            except InvalidInput:  # the domain does not let it be there: it is in the way, no more
                found = ()
            if not found:
                self.met[each.name] = each
        self._walk = self._fresh(self.problem)
        self._walk.hands.put(where)
        return facts

    def forget(self) -> None:
        """A person has put the cell right: what was met is gone, and what had no motion may have one."""
        where = self._walk.hands.where()
        self.met.clear()
        self._refused.clear()
        self._walk = self._fresh(self.problem)
        self._walk.hands.put(where)

    def rerouted(self, rest: Problem, left: Plan | None, facts: Facts, limits: Limits) -> Rerouted | str:
        """A plan for what is left of a run, from some facts and from where the arm stands, in which every step moves; why there is none."""
        where = self._walk.hands.where()
        while len(self._refused) <= MOST_BARS:
            found = recover(without_blocked(rest, self._refused), Revision(), limits, left, facts)
            if not isinstance(found.outcome, Found):
                return f"{found.outcome.reason}; {told(self._refused)}"
            walk = self._fresh(replace(found.problem, domain=rest.domain))
            steps = list(walk.steps(found.outcome.plan, start=where))
            if steps and isinstance(steps[-1], Unmoved):
                self._refused.append(steps[-1])
                continue
            moved = [each for each in steps if isinstance(each, MovedStep)]
            made = self._in_time(walk, replace(found.problem, domain=rest.domain), found.outcome.plan, moved)
            if isinstance(made, str):
                return made
            self._walk = walk
            self._walk.hands.go_home()
            self._walk.hands.put(where)
            return replace(made, given_up=tuple(replace(g, why=self._lost(g)) for g in found.given_up))
        return f"{len(self._refused)} steps have no motion; the last: {told(self._refused[-1:])}"

    def _in_time(
        self, walk: Walk, problem: Problem, plan: Plan, moved: Sequence[MovedStep]
    ) -> Rerouted | str:
        """A plan with the times of its motions, in which several arms keep apart; why they cannot."""
        if self._apart is None:
            return Rerouted(*with_times(problem, plan, moved))

        def lasting(plan: Plan, steps: Sequence[MovedStep]) -> Plan:
            return with_times(problem, plan, steps)[1]

        where = self._walk.hands.where()
        shared = kept_apart(walk, plan, lasting, self._apart.encounters, {}, where)
        if isinstance(shared, str):
            return f"the arms get in each other's way: {shared}"
        self.home = going_home(walk.cell, shared.steps)
        return Rerouted(*with_times(problem, shared.plan, shared.steps), starts=shared.starts)

    def _lost(self, given_up: GivenUp) -> str:
        return f"{given_up.why}; {told(self._refused)}" if self._refused else given_up.why


def _same(one: tuple[Any, Front | None], other: tuple[Any, Front | None]) -> bool:
    return one[1] is other[1] and np.array_equal(one[0], other[0])


def _entry(q: Any, front: Front | None) -> dict[str, Any]:
    found: dict[str, Any] = {"q": q.tolist()}
    if front is None:
        return found
    return {**found, "place": front.place, "inside": front.inside, "straight": front.straight.tolist()}


def _where(entry: Mapping[str, Any]) -> tuple[Any, Front | None]:
    q = np.array(entry["q"], float)
    if "place" not in entry:
        return q, None
    return q, Front(entry["place"], np.array(entry["straight"], float), entry["inside"])
