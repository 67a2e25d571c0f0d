"""Finds events that no workflow asks for, and that would give a plan if they were asked for.

A step that reaches a stage may let others happen, too: all that lies in a rotor is spun. And a step
that a goal needs may let something happen, such as what fills a tube, while the problem has no
workflow.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.model.outcome import Found, Outcome
from cellwright.engine.model.plan_explanation import Amendment
from cellwright.engine.pipelines.explanation.amendments import apply_amendment
from cellwright.engine.pipelines.explanation.causes import find_causes, possible_companions
from cellwright.engine.pipelines.explanation.possible_facts import ProblemSpace
from cellwright.engine.pipelines.explanation.unreachable_goals import GoalOrStage
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.conditions import (
    And,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
)
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Chain, Problem
from cellwright.kb.terms import Atom, Number, stage_parts, substitute_atom, term_variables

MAX_EVENT_SETS = 60  # changes that are planned with, for each size
MAX_COMPANION_ANSWERS = 3
EVENT_SET_SIZES = (1, 2)  # events that are asked for, too
MAX_CAUSES = 50  # steps that are looked at for one fact

Planned = Callable[[Problem], Outcome | None]


def find_companions(
    problem: Problem, goals: Sequence[GoalOrStage], space: ProblemSpace, planned: Planned
) -> Iterator[tuple[Amendment, Found]]:
    """The fewest events that have to be asked for besides the goals so that there is a plan,
    with that plan.
    """
    events = tuple(unasked_events(problem, goals, space))
    loose = planned(_allow_events(problem, events)) if events else None
    if not isinstance(
        loose, Found
    ):  # what is open with all of them is not closed by fewer in the time there is
        return
    answers = 0
    for size in EVENT_SET_SIZES:
        for chosen_events in itertools.islice(itertools.combinations(events, size), MAX_EVENT_SETS):
            if answers < MAX_COMPANION_ANSWERS:
                change = Amendment(stages=chosen_events)
                outcome = planned(apply_amendment(problem, change))
                if isinstance(outcome, Found):
                    answers += 1
                    yield change, outcome
        if answers:
            return
    yield from _needed_events(problem, loose.plan, events, planned)


def _allow_events(problem: Problem, events: Iterable[Atom]) -> Problem:
    """The problem with events that may occur and need not."""
    more = (Chain(str(event), (event,), wanted=False) for event in events)
    return replace(problem, chains=(*problem.chains, *more))


def _needed_events(
    problem: Problem, plan: Plan, events: Sequence[Atom], planned: Planned
) -> Iterator[tuple[Amendment, Found]]:
    """Those of the events that occur in a plan, if there is a plan where they are asked for,
    and none of them can be left out.
    """
    happened = _plan_events(problem, plan)
    used_events = [event for event in events if event in happened]
    for event in list(used_events):
        rest = [kept_event for kept_event in used_events if kept_event != event]
        if isinstance(planned(_allow_events(problem, rest)), Found):
            used_events = rest
    change = Amendment(stages=tuple(used_events))
    outcome = planned(apply_amendment(problem, change))
    if isinstance(outcome, Found):
        yield change, outcome


def _plan_events(problem: Problem, plan: Plan) -> frozenset[Atom]:
    """What happens in a plan."""
    semantics = Semantics(problem)
    state, occurred = semantics.initial(), set[Atom]()
    for step in plan.steps:
        bound = semantics.binding(step.operator)
        assert not isinstance(bound, str)
        change = semantics.change(*bound, semantics.facts(state), state)
        state = (state - change.ends) | change.adds
        occurred.update(change.events)
    return frozenset(occurred)


def unasked_events(
    problem: Problem, goals: Sequence[GoalOrStage], space: ProblemSpace
) -> Iterator[Atom]:
    """Each event that no workflow asks for and that a step lets happen which reaches a goal, or
    what that step needs.

    First come those of steps that reach `goals`, then those of steps that all other goals need.
    """
    numbers = tuple(dict.fromkeys(_goal_amounts(problem)))
    asked = {stage for chain in problem.chains for stage in chain.stages}
    seeking = _EventSearch(Semantics(problem), space, numbers, asked)
    lengths = {goal.chain: goal.stages for goal in goals}
    for chain in problem.chains:
        for stage in chain.stages[: lengths.get(chain.name, 0)]:
            for part in stage_parts(stage):
                yield from seeking.behind(part)
    for condition in (
        *(goal.condition for goal in goals if goal.condition is not None),
        problem.goal,
    ):
        for atom in _asked_atoms(condition):
            yield from seeking.behind(atom)


@dataclass
class _EventSearch:
    """Looks backward for events. Each is told once, and each fact looked at once."""

    semantics: Semantics
    space: ProblemSpace
    numbers: tuple[Number, ...]
    told: set[Atom]
    seen: set[Atom] = field(default_factory=set)

    def behind(self, atom: Atom) -> Iterator[Atom]:
        """The events of steps that make an atom true; then of those that make true what these
        need and cannot have.
        """
        if atom in self.seen:
            return
        self.seen.add(atom)
        possible_causes = list(itertools.islice(find_causes(self.semantics, atom), MAX_CAUSES))
        for cause in possible_causes:
            for event in (
                valued_event
                for companion in possible_companions(self.semantics, cause)
                for valued_event in self._valued(companion.event)
            ):
                if event not in self.told:
                    self.told.add(event)
                    yield event
        for cause in possible_causes:
            for missed_atom in filter(self.space.misses, cause.atoms):
                yield from self.behind(missed_atom)

    def _valued(self, event: Atom) -> Iterator[Atom]:
        """The event; with each of the numbers, if one number of it is not known."""
        match list(dict.fromkeys(term_variables(event))):
            case []:
                yield event
            case [unknown]:
                yield from (substitute_atom(event, {unknown: number}) for number in self.numbers)


def _asked_atoms(condition: Condition) -> Iterator[Atom]:
    """What a condition asks to be true. A quantity has a variable for its value."""
    match condition:
        case Literal(atom, True):
            yield atom
        case And(parts) | Or(parts):
            yield from (atom for part in parts for atom in _asked_atoms(part))
        case Exists(_, part) | ForAll(_, part):
            yield from _asked_atoms(part)


def _goal_amounts(problem: Problem) -> Iterator[Number]:
    """The numbers that the goals name, then how far quantities are from them at the start."""
    named = tuple(dict.fromkeys(_compared_numbers(problem.goal)))
    yield from named
    for atom in problem.initial if named else ():
        if atom.name in problem.domain.quantities and isinstance(
            value := atom.arguments[-1], Number
        ):
            away = (abs(number.value - value.value) for number in named)
            yield from (Number(distance) for distance in away if distance)


def _compared_numbers(condition: Condition) -> Iterator[Number]:
    """The numbers that a condition compares something with."""
    match condition:
        case Comparison(left_term, _, right):
            yield from (side for side in (left_term, right) if isinstance(side, Number))
        case And(parts) | Or(parts):
            yield from (number for part in parts for number in _compared_numbers(part))
        case Exists(_, part) | ForAll(_, part) | Not(part):
            yield from _compared_numbers(part)
