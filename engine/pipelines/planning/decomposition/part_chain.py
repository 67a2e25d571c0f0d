"""A chain of parts, each planned from the state that the one before leaves, with learned
MACROPs.
"""

import time
from collections import Counter, defaultdict
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from cellwright.engine.model.outcome import Found, GaveUp, Outcome
from cellwright.engine.pipelines.planning.checked_plan import search_plan
from cellwright.engine.stages.grounding.grounding_program import ChangingPredicates
from cellwright.engine.stages.grounding.initial_facts import initial_state
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.lifted.operator_schemas import NotGeneral
from cellwright.engine.stages.macros.learning.plan_generalisation import generalise_plan
from cellwright.engine.stages.macros.lookup.macro_index import MacroIndex
from cellwright.engine.stages.macros.lookup.macro_instances import check_instance
from cellwright.engine.stages.macros.lookup.macro_lookup import LookupHit, look_up
from cellwright.engine.stages.macros.lookup.macro_query import (
    MacroQuery,
    make_query,
    query_variants,
)
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.sequencing import TourLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.conditions import And, Condition
from cellwright.kb.model.plan_model import Macrop, Plan, Step
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom


class MacroMemory(Protocol):
    """Where MACROPs are found and kept; a `Repertoire` of a library is one."""

    def find(self, asked: MacroQuery) -> LookupHit | None:
        """A checked plan for a query; None if no MACROP serves it."""
        ...

    def learn(self, macrop: Macrop, planning_s: float = 0.0) -> Hashable | None:
        """Keep a MACROP whose plan took so many seconds to find."""
        ...


class Notebook:
    """A memory of its own for one problem."""

    def __init__(self) -> None:
        self._index = MacroIndex()

    def find(self, asked: MacroQuery) -> LookupHit | None:
        """A checked plan for a query; None if no MACROP serves it."""
        return next(
            (
                hit
                for reading in query_variants(asked)
                if (hit := look_up(self._index, reading)) is not None
            ),
            None,
        )

    def learn(self, macrop: Macrop, planning_s: float = 0.0) -> Hashable | None:  # noqa: ARG002 - a notebook does not weigh
        """Keep a MACROP."""
        number = len(self._index) + 1
        self._index.add(number, macrop)
        return number


MAX_PART_STEPS = 100  # steps of a plan that is learned
INFINITE_COST = 1 << 62


@dataclass(frozen=True, slots=True)
class PlanningPart:
    """What is achieved at once: some goals.

    `name` is the measurement that they are about, if they are about one.
    """

    name: str
    goals: tuple[Condition, ...]


@dataclass
class PartChain:
    """Parts under way: where they have led, their steps, and what was counted and timed."""

    problem: Problem
    here: Situation
    memory: MacroMemory
    limits: SearchLimits
    steps: list[Step] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    def run(self, parts: Sequence[PlanningPart]) -> tuple[PlanningPart, Outcome] | None:
        """Plan all parts; the first that has no plan, and why, or None."""
        for part in parts:
            if self.limits.interrupted():
                return part, GaveUp("the search was stopped", "time")
            outcome = self._serve(part)
            if not isinstance(outcome, Found):
                return part, outcome
            self.steps += outcome.plan.steps
        return None

    def alone(self, part: PlanningPart, start: Situation) -> Outcome:
        """The planner's answer for one part from a situation."""
        own = replace(self.problem, goal=And(part.goals), chains=())
        return search_plan(own.replace(tuple(start.facts)), self.limits, statics=self._statics)[0]

    def trial(self, parts: Sequence[PlanningPart]) -> tuple[int, int]:
        """How long the plan of some parts lasts from here, and what it costs; very much if
        there is none.
        """
        trial_chain = self.led(parts)
        if trial_chain is None:
            return INFINITE_COST, INFINITE_COST
        return sum(step.duration for step in trial_chain.steps), sum(
            step.cost for step in trial_chain.steps
        )

    def led(self, parts: Sequence[PlanningPart]) -> "PartChain | None":
        """A chain of its own that goes on from here with some parts; None if one of them has no
        plan.
        """
        led_chain = PartChain(self.problem, self.here, self.memory, self.limits, counts=self.counts)
        return led_chain if led_chain.run(parts) is None else None

    def _serve(self, part: PlanningPart) -> Outcome:
        """A plan for one part from here; then `here` is where it leads."""
        own = replace(self.problem, goal=And(part.goals), chains=())
        asked = make_query(own, self.here)
        if asked is not None and asked.served:
            return Found(Plan(()))
        started = time.perf_counter()
        hit = self.memory.find(asked) if asked is not None else None
        self.seconds["MACROPs"] += time.perf_counter() - started
        if hit is not None:
            self.counts["parts by MACROPs"] += 1
            self.here = hit.after
            return Found(hit.plan)
        return self._planned(own)

    def _planned(self, own: Problem) -> Outcome:
        """The planner's answer, of which a MACROP is learned."""
        started = time.perf_counter()
        own = own.replace(tuple(self.here.facts))
        outcome, task = search_plan(own, self.limits, statics=self._statics, proves=False)
        spent = time.perf_counter() - started
        self.counts["parts planned"] += 1
        self.counts["operators"] = max(self.counts["operators"], len(task.operators))
        self.seconds["parts"] += spent
        if not isinstance(outcome, Found):
            return outcome
        self._learn(own, outcome.plan, spent)
        asked = make_query(own, self.here)
        assert asked is not None
        after = check_instance(outcome.plan, asked)
        assert isinstance(after, Situation), after
        self.here = after
        return outcome

    def _statics(self, name: str, _arity: int) -> Iterable[Atom]:
        return self.here.world.statics.named(name)

    def _learn(self, own: Problem, plan: Plan, spent: float) -> None:
        started = time.perf_counter()
        if plan.steps and len(plan.steps) <= MAX_PART_STEPS:
            try:
                self.memory.learn(
                    generalise_plan(own, plan, self.here.world, self.here.state).macrop, spent
                )
            except NotGeneral:
                self.counts["parts not learned"] += 1
        self.seconds["learning"] += time.perf_counter() - started


def start_of(problem: Problem) -> Situation:
    """The initial state of a problem. Raises `InvalidInput` if its facts contradict one another."""
    state, contradicted = initial_state(problem, ChangingPredicates(problem.domain))
    if contradicted:
        raise InvalidInput(contradicted)
    return Situation.of(CellDomain(problem), state)


def chain_of(problem: Problem, limits: TourLimits, memory: MacroMemory | None = None) -> PartChain:
    """A chain at the start of a problem, within the limits of a sequence."""
    own = SearchLimits(seed=limits.seed, interrupted=limits.interrupted)
    return PartChain(problem, start_of(problem), memory or Notebook(), own)
