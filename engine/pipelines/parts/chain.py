"""Parts of a problem, planned one after another: each from the state that the last one leaves (ITA's heterogeneous hierarchy).

A MACROP that was learned from an earlier part serves if it can; else the part is planned by itself, over what it can need.
"""

import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.model.outcome import Found, GaveUp, Outcome
from cellwright.engine.pipelines.parts.memory import Memory
from cellwright.engine.pipelines.planning import searched
from cellwright.engine.stages.macros.learning.generalise import NotGeneral, generalise
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lookup.checking import check
from cellwright.engine.stages.macros.lookup.query import query
from cellwright.engine.stages.planning import Limits
from cellwright.kb.model.conditions import And, Condition
from cellwright.kb.model.plan import Plan, Step
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom

LARGEST = 100  # steps of a plan that is learned
MUCH = 1 << 62


@dataclass(frozen=True, slots=True)
class Part:
    """What is achieved at once: some goals. `name` is the measurement that they are about, if they are about one."""

    name: str
    goals: tuple[Condition, ...]


@dataclass
class Chain:
    """Parts under way: where they have led, their steps, and what was counted and timed."""

    problem: Problem
    here: Situation
    memory: Memory
    limits: Limits
    steps: list[Step] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    def run(self, parts: Sequence[Part]) -> tuple[Part, Outcome] | None:
        """Plan all parts; the first that has no plan, and why, or None."""
        for part in parts:
            if self.limits.interrupted():
                return part, GaveUp("the search was stopped", "time")
            outcome = self._serve(part)
            if not isinstance(outcome, Found):
                return part, outcome
            self.steps += outcome.plan.steps
        return None

    def alone(self, part: Part, start: Situation) -> Outcome:
        """The planner's answer for one part from a situation."""
        own = replace(self.problem, goal=And(part.goals), chains=())
        return searched(own.replace(tuple(start.facts)), self.limits, statics=self._statics)[0]

    def trial(self, parts: Sequence[Part]) -> tuple[int, int]:
        """How long the plan of some parts lasts from here, and what it costs; very much if there is none."""
        other = self.led(parts)
        if other is None:
            return MUCH, MUCH
        return sum(step.duration for step in other.steps), sum(step.cost for step in other.steps)

    def led(self, parts: Sequence[Part]) -> "Chain | None":
        """A chain of its own that goes on from here with some parts; None if one of them has no plan."""
        other = Chain(self.problem, self.here, self.memory, self.limits, counts=self.counts)
        return other if other.run(parts) is None else None

    def _serve(self, part: Part) -> Outcome:
        """A plan for one part from here; then `here` is where it leads."""
        own = replace(self.problem, goal=And(part.goals), chains=())
        asked = query(own, self.here)
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
        outcome, task = searched(own, self.limits, statics=self._statics, proves=False)
        spent = time.perf_counter() - started
        self.counts["parts planned"] += 1
        self.counts["operators"] = max(self.counts["operators"], len(task.operators))
        self.seconds["parts"] += spent
        if not isinstance(outcome, Found):
            return outcome
        self._learn(own, outcome.plan, spent)
        asked = query(own, self.here)
        assert asked is not None
        after = check(outcome.plan, asked)
        assert isinstance(after, Situation), after
        self.here = after
        return outcome

    def _statics(self, name: str, _arity: int) -> Iterable[Atom]:
        return self.here.world.statics.named(name)

    def _learn(self, own: Problem, plan: Plan, spent: float) -> None:
        started = time.perf_counter()
        if plan.steps and len(plan.steps) <= LARGEST:
            try:
                self.memory.learn(generalise(own, plan, self.here.world, self.here.state).macrop, spent)
            except NotGeneral:
                self.counts["parts not learned"] += 1
        self.seconds["learning"] += time.perf_counter() - started
