"""Sub-sequences of a domain's plans as MACROPs inside planning: learned from plans, tried, offered, and dropped.

A sub-sequence that recurs in a plan is generalised like any plan, by explanation. The plan's task is then solved again
with it. If a kind of search needs less work with the sub-sequence, it is kept, and offered to that kind of search. Such
trials are made for the first few tasks of a domain. After that only uses are counted. A sub-sequence that is offered often
but seldom used is no longer offered.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.outcome import Statistics
from cellwright.engine.model.task import Task
from cellwright.engine.pipelines.reuse.composition import PlanPart
from cellwright.engine.stages.macros.learning.generalise import NotGeneral, generalise
from cellwright.engine.stages.macros.learning.subsequences import (
    LARGEST,
    Order,
    Recurring,
    fits,
    occurring,
    recurring,
    shape,
)
from cellwright.engine.stages.macros.lifted.digests import Digests
from cellwright.engine.stages.macros.lifted.execution import executed
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lookup.specialise import specialised
from cellwright.engine.stages.planning import Macros
from cellwright.engine.stages.planning.composites import Pattern
from cellwright.engine.stages.planning.utility import TOGETHER, Trial, measured
from cellwright.kb.model.conditions import And, Literal
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.macro import Macrop, MacroPart
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.store import Library, Record, Stored, Use
from cellwright.kb.store.utilities import Figures, Utility
from cellwright.kb.terms import Function, ordered

SIGNATURE = "(sub-sequence)"
SEARCHES = ("backward", "forward")
CANDIDATES = 12  # the most sub-sequences of one plan that are tried
OFTEN = 2  # the fewest times that a sub-sequence must occur in the plan
LESSONS = 8  # the number of tasks of a domain on which trials are made
OPERATORS = 20_000  # the most ground operators of such a task
FAILED = 3  # after so many trials a MACROP that pays in no search is dropped
NO_UTILITY = Utility()


@dataclass(frozen=True, slots=True)
class KnownSubsequence:
    """A sub-sequence in the library, with its measured utility for each kind of search."""

    stored: Stored
    utilities: dict[str, Utility]

    @property
    def pattern(self) -> Pattern:
        """The steps of the sub-sequence."""
        return pattern_of(self.stored.macrop)

    def pays(self, search: str) -> bool:
        """Whether the sub-sequence is worth offering to a kind of search."""
        return self.utilities.get(search, NO_UTILITY).pays


class Subsequences:
    """The sub-sequences that a library holds for the present version of a domain."""

    def __init__(self, library: Library, domain: Domain) -> None:
        self.domain = domain
        self._library, self._digests = library, Digests(domain)
        self._known = self._fetched()

    @cached_property
    def _lessons(self) -> str:
        """The key under which trials are counted. It depends on the operators: when they change, the count begins anew."""
        names = sorted({operator.name for operator in self.domain.operators})
        operators = "".join(self._digests.of(f"operator {name}") for name in names)
        return f"{SIGNATURE} {hashlib.sha256(operators.encode()).hexdigest()[:16]}"

    def _fetched(self) -> list[KnownSubsequence]:
        """The stored sub-sequences that are not stale."""
        stored = self._library.serving(self.domain.name, SIGNATURE)
        figures = self._library.utilities(self.domain.name) if stored else {}
        return [
            KnownSubsequence(each, {s: figures[each.id, s] for s in SEARCHES if (each.id, s) in figures})
            for each in stored
            if self._digests.fresh(each.macrop.depends)
        ]

    def offered(self) -> Macros:
        """The sub-sequences that the searches may use as operators: the few that save the greatest share of work."""
        return Macros(*(tuple(each.pattern for each in self._paying(search)) for search in SEARCHES))

    def _paying(self, search: str) -> list[KnownSubsequence]:
        found = [each for each in self._known if each.pays(search)]
        return sorted(found, key=lambda each: (each.utilities[search].share, each.stored.id))[:TOGETHER]

    def note(self, statistics: Statistics) -> None:
        """Count which sub-sequences were offered to the search that found the answer, and which of them it used."""
        offer = statistics.offer
        self._count(
            {
                (each.stored.id, offer.search): Utility(offered=1, used=int(each.pattern in offer.used))
                for each in self._known
                if each.pattern in offer.offered
            }
        )

    def _count(self, more: Figures) -> None:
        if more:
            self._library.note_utilities(more)
            self._known = self._fetched()

    def folded(self, plan: Plan) -> tuple[PlanPart, ...]:
        """The plan split into known sub-sequences and single steps. Of sub-sequences that overlap the longest is taken."""
        parts: list[PlanPart] = []
        taken: set[StepId] = set()
        order = Order(plan)
        for each in sorted(self._known, key=lambda known: (-len(known.pattern), known.stored.id)):
            for steps in occurring(order, each.pattern, taken):
                purpose = ", ".join(str(step.operator) for step in steps)
                parts.append(PlanPart(each.stored.id, str(each.stored.macrop.name), purpose, _ids(steps)))
                taken.update(parts[-1].steps)
        single = [
            PlanPart(None, str(each.operator), "", (each.id,)) for each in plan.steps if each.id not in taken
        ]
        places = {step.id: place for place, step in enumerate(plan.steps)}
        return tuple(sorted([*parts, *single], key=lambda part: places[part.steps[0]]))

    def study(self, problem: Problem, plan: Plan, task: Task, here: Situation, stop: Interrupted) -> None:
        """Learn from a plan for `task` from the situation `here`: try its recurring sub-sequences and the known ones."""
        tasks = sum(self._library.trials(self.domain.name, self._lessons))
        small = len(task.operators) <= OPERATORS and 1 < len(plan.steps) <= LARGEST
        if tasks >= LESSONS or not small or stop():
            return
        fresh = _distinct(lifted(each, problem, here) for each in self._strangers(plan))
        patterns = [*(each.pattern for each in self._known), *map(pattern_of, fresh)]
        trials = {search: measured(task, search, patterns, stop) for search in SEARCHES} if patterns else {}
        if stop():
            return
        paying = [each for each in fresh if any(t[pattern_of(each)].paid for t in trials.values() if t)]
        self._library.note_trial(self.domain.name, self._lessons, bool(paying))
        self._keep(paying)
        self._count(self._figures(trials))
        order = Order(plan)
        self._library.note_uses({each.stored.id: Use(_times(order, each), 0.0) for each in self._known})
        self._drop()

    def _strangers(self, plan: Plan) -> list[Recurring]:
        """The sub-sequences that recur in a plan and are not known yet."""
        often = [each for each in recurring(plan) if each.count >= OFTEN]
        return [each for each in often if not any(_is(known, each) for known in self._known)][:CANDIDATES]

    def _keep(self, macrops: Sequence[Macrop]) -> None:
        if macrops:
            parts = [(str(each.stored.macrop.name), each.pattern) for each in self._known]
            parts += [(str(each.name), pattern_of(each)) for each in macrops]
            self._library.add([Record(replace(m, parts=_parts(m, parts)), SIGNATURE) for m in macrops])
            self._known = self._fetched()

    def _figures(self, trials: dict[str, dict[Pattern, Trial]]) -> Figures:
        return {
            (known.stored.id, search): Utility(trials=1, without=trial.without, beside=trial.beside)
            for search, found in trials.items()
            for known in self._known
            if (trial := found.get(known.pattern)) is not None
        }

    def _drop(self) -> None:
        """Remove the sub-sequences that were tried often enough and pay in no kind of search."""
        gone = [
            each.stored.id
            for each in self._known
            if max((u.trials for u in each.utilities.values()), default=0) >= FAILED
            and not any(map(each.pays, SEARCHES))
        ]
        if gone:
            self._library.forget(gone)
            self._known = self._fetched()


def pattern_of(macrop: Macrop) -> Pattern:
    """The steps of a MACROP in an order in which they can run."""
    return tuple(step.operator for step in macrop.steps)


def _ids(steps: Sequence[Step]) -> tuple[StepId, ...]:
    return tuple(step.id for step in steps)


def _is(known: KnownSubsequence, found: Recurring) -> bool:
    return len(known.pattern) == len(found.operators) and fits(known.pattern, found.operators)


def _times(order: Order, known: KnownSubsequence) -> int:
    return sum(1 for _ in occurring(order, known.pattern))


def _distinct(macrops: Iterable[Macrop | None]) -> list[Macrop]:
    """One MACROP of each shape."""
    return list({shape(pattern_of(each)): each for each in macrops if each is not None}.values())


def lifted(found: Recurring, problem: Problem, here: Situation) -> Macrop | None:
    """The MACROP of a sub-sequence; None if it cannot be generalised.

    The sub-sequence is generalised like a plan: from the situation where it begins, with the facts that it adds as goals.
    """
    start = executed(Plan(found.before), here)
    own = _in_sequence(found.steps)
    end = executed(own, start) if start is not None else None
    if start is None or end is None:
        return None
    gained = tuple(Literal(atom) for atom in ordered(end.state - start.state))
    alone = replace(problem.replace(ordered(start.facts)), goal=And(gained), chains=())
    try:
        made = generalise(alone, own, start.world, start.state).macrop
    except NotGeneral:
        return None
    made = specialised(made, found.operators)
    name = Function("_then_".join(step.operator.name for step in made.steps), made.name.arguments)
    return replace(made, name=name, subsequence=True)


def _in_sequence(steps: Sequence[Step]) -> Plan:
    """The steps as a plan: numbered from 1, each after the one before it."""
    return Plan(
        tuple(
            replace(step, id=StepId(place + 1), after=(StepId(place),) if place else ())
            for place, step in enumerate(steps)
        )
    )


def _parts(macrop: Macrop, known: Sequence[tuple[str, Pattern]]) -> tuple[MacroPart, ...]:
    """The shorter MACROPs inside a MACROP's steps. The longest are taken first, and none overlaps another."""
    pattern, found = pattern_of(macrop), []
    free = [True] * len(pattern)
    for name, part in sorted(known, key=lambda each: -len(each[1])):
        for first in range(len(pattern) - len(part) + 1):
            places = range(first, first + len(part))
            inside = len(part) < len(pattern) and all(free[place] for place in places)
            if inside and fits(part, pattern[first : first + len(part)]):
                found.append(MacroPart(name, tuple(macrop.steps[place].id for place in places)))
                free[first : first + len(part)] = [False] * len(part)
    return tuple(found)
