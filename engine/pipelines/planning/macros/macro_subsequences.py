"""Sub-sequences of plans as MACROPs in the search: learned, tried, offered, and dropped.

A sub-sequence that recurs in a plan is generalised like any plan, by explanation. The plan's task
is then solved again with it. If a kind of search needs less work with the sub-sequence, it is kept,
and offered to that kind of search. Such trials are made for the first few tasks of a domain. After
that only uses are counted. A sub-sequence that is offered often but seldom used is no longer
offered.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Statistics
from cellwright.engine.pipelines.planning.macros.macro_composition import PlanPart
from cellwright.engine.stages.lifted.cell_domain import Situation
from cellwright.engine.stages.lifted.domain_digests import DomainDigests
from cellwright.engine.stages.lifted.lifted_execution import final_situation
from cellwright.engine.stages.lifted.operator_schemas import NotGeneral
from cellwright.engine.stages.macros.learning.plan_generalisation import generalise_plan
from cellwright.engine.stages.macros.learning.plan_subsequences import (
    MAX_SEARCHED_STEPS,
    PlanOrder,
    RecurringSequence,
    matches_pattern,
    matching_sequences,
    recurring_sequences,
    sequence_shape,
    specialise_macro,
)
from cellwright.engine.stages.planning import Macros
from cellwright.engine.stages.planning.composites import Pattern
from cellwright.engine.stages.planning.macro_utility import (
    MAX_PATTERNS_TOGETHER,
    PatternTrial,
    measure_utility,
)
from cellwright.kb.model.conditions import And, Literal
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.plan_model import Macrop, MacroPart, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library, Record, Stored, Use
from cellwright.kb.store.usage_counts import Utility, UtilityFigures
from cellwright.kb.terms import Function, sort_naturally

SUBSEQUENCE_SIGNATURE = "(sub-sequence)"
SEARCH_KINDS = ("backward", "forward")
MAX_SUBSEQUENCE_TRIALS = 12  # the most sub-sequences of one plan that are tried
MIN_OCCURRENCES = 2  # the fewest times that a sub-sequence must occur in the plan
TRIAL_TASKS = 8  # the number of tasks of a domain on which trials are made
MAX_TRIAL_OPERATORS = 20_000  # the most ground operators of such a task
MAX_FAILED_TRIALS = 3  # after so many trials a MACROP that pays in no search is dropped
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
        self._library, self._digests = library, DomainDigests(domain)
        self._known = self._fetched()

    @cached_property
    def _lessons(self) -> str:
        """The key under which trials are counted.

        It depends on the operators: when they change, the count begins anew.
        """
        names = sorted({operator.name for operator in self.domain.operators})
        operators = "".join(self._digests.of(f"operator {name}") for name in names)
        return f"{SUBSEQUENCE_SIGNATURE} {hashlib.sha256(operators.encode()).hexdigest()[:16]}"

    def _fetched(self) -> list[KnownSubsequence]:
        """The stored sub-sequences that are not stale."""
        stored = self._library.serving(self.domain.name, SUBSEQUENCE_SIGNATURE)
        figures = self._library.utilities(self.domain.name) if stored else {}
        return [
            KnownSubsequence(
                macrop_stored,
                {
                    s: figures[macrop_stored.id, s]
                    for s in SEARCH_KINDS
                    if (macrop_stored.id, s) in figures
                },
            )
            for macrop_stored in stored
            if self._digests.fresh(macrop_stored.macrop.depends)
        ]

    def offered(self) -> Macros:
        """The sub-sequences that the searches may use as operators: the few that save the
        greatest share of work.
        """
        return Macros(
            *(
                tuple(subsequence.pattern for subsequence in self._paying(search))
                for search in SEARCH_KINDS
            )
        )

    def _paying(self, search: str) -> list[KnownSubsequence]:
        paying = [subsequence for subsequence in self._known if subsequence.pays(search)]
        return sorted(
            paying,
            key=lambda subsequence: (subsequence.utilities[search].share, subsequence.stored.id),
        )[:MAX_PATTERNS_TOGETHER]

    def note(self, statistics: Statistics) -> None:
        """Count which sub-sequences were offered to the search that found the answer, and which
        of them it used.
        """
        offer = statistics.offer
        self._count(
            {
                (subsequence.stored.id, offer.search): Utility(
                    offered=1, used=int(subsequence.pattern in offer.used)
                )
                for subsequence in self._known
                if subsequence.pattern in offer.offered
            }
        )

    def _count(self, more: UtilityFigures) -> None:
        if more:
            self._library.note_utilities(more)
            self._known = self._fetched()

    def folded(self, plan: Plan) -> tuple[PlanPart, ...]:
        """The plan split into known sub-sequences and single steps.

        Of sub-sequences that overlap the longest is taken.
        """
        parts: list[PlanPart] = []
        taken: set[StepId] = set()
        order = PlanOrder(plan)
        for subsequence in sorted(
            self._known,
            key=lambda known_subsequence: (
                -len(known_subsequence.pattern),
                known_subsequence.stored.id,
            ),
        ):
            for steps in matching_sequences(order, subsequence.pattern, taken):
                purpose = ", ".join(str(step.operator) for step in steps)
                parts.append(
                    PlanPart(
                        subsequence.stored.id,
                        str(subsequence.stored.macrop.name),
                        purpose,
                        _step_ids(steps),
                    )
                )
                taken.update(parts[-1].steps)
        single = [
            PlanPart(None, str(step.operator), "", (step.id,))
            for step in plan.steps
            if step.id not in taken
        ]
        places = {step.id: place for place, step in enumerate(plan.steps)}
        return tuple(sorted([*parts, *single], key=lambda part: places[part.steps[0]]))

    def study(
        self, problem: Problem, plan: Plan, task: GroundTask, start: Situation, stop: Interrupted
    ) -> None:
        """Learn from a plan for `task` from the situation `here`: try its recurring
        sub-sequences and the known ones.
        """
        tasks = sum(self._library.trials(self.domain.name, self._lessons))
        small = (
            len(task.operators) <= MAX_TRIAL_OPERATORS and 1 < len(plan.steps) <= MAX_SEARCHED_STEPS
        )
        if tasks >= TRIAL_TASKS or not small or stop():
            return
        fresh = _distinct_macrops(
            lift_subsequence(recurring_steps, problem, start)
            for recurring_steps in self._strangers(plan)
        )
        patterns = [*(subsequence.pattern for subsequence in self._known), *map(pattern_of, fresh)]
        trials = (
            {search: measure_utility(task, search, patterns, stop) for search in SEARCH_KINDS}
            if patterns
            else {}
        )
        if stop():
            return
        paying = [
            macrop
            for macrop in fresh
            if any(t[pattern_of(macrop)].paid for t in trials.values() if t)
        ]
        self._library.note_trial(self.domain.name, self._lessons, bool(paying))
        self._keep(paying)
        self._count(self._figures(trials))
        order = PlanOrder(plan)
        self._library.note_uses(
            {
                subsequence.stored.id: Use(_count_uses(order, subsequence), 0.0)
                for subsequence in self._known
            }
        )
        self._drop()

    def _strangers(self, plan: Plan) -> list[RecurringSequence]:
        """The sub-sequences that recur in a plan and are not known yet."""
        often = [
            recurring_part
            for recurring_part in recurring_sequences(plan)
            if recurring_part.count >= MIN_OCCURRENCES
        ]
        return [
            recurring_part
            for recurring_part in often
            if not any(
                _is_known(known_subsequence, recurring_part) for known_subsequence in self._known
            )
        ][:MAX_SUBSEQUENCE_TRIALS]

    def _keep(self, macrops: Sequence[Macrop]) -> None:
        if macrops:
            parts = [
                (str(subsequence.stored.macrop.name), subsequence.pattern)
                for subsequence in self._known
            ]
            parts += [(str(macrop.name), pattern_of(macrop)) for macrop in macrops]
            self._library.add(
                [
                    Record(replace(m, parts=_macro_parts(m, parts)), SUBSEQUENCE_SIGNATURE)
                    for m in macrops
                ]
            )
            self._known = self._fetched()

    def _figures(self, trials: dict[str, dict[Pattern, PatternTrial]]) -> UtilityFigures:
        return {
            (subsequence.stored.id, search): Utility(
                trials=1, without=trial.without, beside=trial.beside
            )
            for search, trial_result in trials.items()
            for subsequence in self._known
            if (trial := trial_result.get(subsequence.pattern)) is not None
        }

    def _drop(self) -> None:
        """Remove the sub-sequences that were tried often enough and pay in no kind of search."""
        gone = [
            subsequence.stored.id
            for subsequence in self._known
            if max((u.trials for u in subsequence.utilities.values()), default=0)
            >= MAX_FAILED_TRIALS
            and not any(map(subsequence.pays, SEARCH_KINDS))
        ]
        if gone:
            self._library.forget(gone)
            self._known = self._fetched()


def pattern_of(macrop: Macrop) -> Pattern:
    """The steps of a MACROP in an order in which they can run."""
    return tuple(step.operator for step in macrop.steps)


def _step_ids(steps: Sequence[Step]) -> tuple[StepId, ...]:
    return tuple(step.id for step in steps)


def _is_known(known: KnownSubsequence, recurrence: RecurringSequence) -> bool:
    return len(known.pattern) == len(recurrence.operators) and matches_pattern(
        known.pattern, recurrence.operators
    )


def _count_uses(order: PlanOrder, known: KnownSubsequence) -> int:
    return sum(1 for _ in matching_sequences(order, known.pattern))


def _distinct_macrops(macrops: Iterable[Macrop | None]) -> list[Macrop]:
    """One MACROP of each shape."""
    return list(
        {
            sequence_shape(pattern_of(macrop)): macrop for macrop in macrops if macrop is not None
        }.values()
    )


def lift_subsequence(
    recurrence: RecurringSequence, problem: Problem, situation: Situation
) -> Macrop | None:
    """The MACROP of a sub-sequence; None if it cannot be generalised.

    The sub-sequence is generalised like a plan: from the situation where it begins, with the facts
    that it adds as goals.
    """
    start = final_situation(Plan(recurrence.before), situation)
    own = _in_sequence(recurrence.steps)
    end = final_situation(own, start) if start is not None else None
    if start is None or end is None:
        return None
    gained = tuple(Literal(atom) for atom in sort_naturally(end.state - start.state))
    alone = replace(problem.replace(sort_naturally(start.facts)), goal=And(gained), chains=())
    try:
        macrop = generalise_plan(alone, own, start.world, start.state).macrop
    except NotGeneral:
        return None
    macrop = specialise_macro(macrop, recurrence.operators)
    name = Function(
        "_then_".join(step.operator.name for step in macrop.steps), macrop.name.arguments
    )
    return replace(macrop, name=name, subsequence=True)


def _in_sequence(steps: Sequence[Step]) -> Plan:
    """The steps as a plan: numbered from 1, each after the one before it."""
    return Plan(
        tuple(
            replace(step, id=StepId(place + 1), after=(StepId(place),) if place else ())
            for place, step in enumerate(steps)
        )
    )


def _macro_parts(macrop: Macrop, known: Sequence[tuple[str, Pattern]]) -> tuple[MacroPart, ...]:
    """The shorter MACROPs inside a MACROP's steps.

    The longest are taken first, and none overlaps another.
    """
    pattern, parts = pattern_of(macrop), []
    free = [True] * len(pattern)
    for name, part in sorted(known, key=lambda name_and_pattern: -len(name_and_pattern[1])):
        for first in range(len(pattern) - len(part) + 1):
            places = range(first, first + len(part))
            inside = len(part) < len(pattern) and all(free[place] for place in places)
            if inside and matches_pattern(part, pattern[first : first + len(part)]):
                parts.append(MacroPart(name, tuple(macrop.steps[place].id for place in places)))
                free[first : first + len(part)] = [False] * len(part)
    return tuple(parts)
