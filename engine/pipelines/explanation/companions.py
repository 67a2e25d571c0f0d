"""Events that nobody asks for. What no workflow asks for cannot occur, so it may be all that is missing that it is asked for.

A step that reaches a stage may let others happen, too: all that lies in a rotor is spun. And a step that a goal needs may let
something happen, such as what fills a tube, while the problem has no workflow.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.model.explanation import Amendment
from cellwright.engine.model.outcome import Found, Outcome
from cellwright.engine.pipelines.explanation.amendments import changed
from cellwright.engine.pipelines.explanation.causes import causes, happening
from cellwright.engine.pipelines.explanation.culprits import Goal
from cellwright.engine.pipelines.explanation.space import Space
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.conditions import And, Comparison, Condition, Exists, ForAll, Literal, Not, Or
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Chain, Problem
from cellwright.kb.terms import Atom, Number, parts_of, substitute_atom, variables

MOST = 60  # changes that are planned with, for each size
ENOUGH = 3
SIZES = (1, 2)  # events that are asked for, too
MOST_CAUSES = 50  # steps that are looked at for one fact

Planned = Callable[[Problem], Outcome | None]


def companions(
    problem: Problem, goals: Sequence[Goal], space: Space, planned: Planned
) -> Iterator[tuple[Amendment, Found]]:
    """The fewest events that have to be asked for besides the goals so that there is a plan, with that plan."""
    events = tuple(unasked(problem, goals, space))
    loose = planned(_allowing(problem, events)) if events else None
    if not isinstance(
        loose, Found
    ):  # what is open with all of them is not closed by fewer in the time there is
        return
    found = 0
    for size in SIZES:
        for each in itertools.islice(itertools.combinations(events, size), MOST):
            if found < ENOUGH:
                change = Amendment(stages=each)
                outcome = planned(changed(problem, change))
                if isinstance(outcome, Found):
                    found += 1
                    yield change, outcome
        if found:
            return
    yield from _used(problem, loose.plan, events, planned)


def _allowing(problem: Problem, events: Iterable[Atom]) -> Problem:
    """The problem with events that may occur and need not."""
    more = (Chain(str(each), (each,), wanted=False) for each in events)
    return replace(problem, chains=(*problem.chains, *more))


def _used(
    problem: Problem, plan: Plan, events: Sequence[Atom], planned: Planned
) -> Iterator[tuple[Amendment, Found]]:
    """Those of the events that occur in a plan, if there is a plan where they are asked for, and none of them can be left out."""
    happened = _events(problem, plan)
    kept = [each for each in events if each in happened]
    for each in list(kept):
        rest = [other for other in kept if other != each]
        if isinstance(planned(_allowing(problem, rest)), Found):
            kept = rest
    change = Amendment(stages=tuple(kept))
    outcome = planned(changed(problem, change))
    if isinstance(outcome, Found):
        yield change, outcome


def _events(problem: Problem, plan: Plan) -> frozenset[Atom]:
    """What happens in a plan."""
    semantics = Semantics(problem)
    state, found = semantics.initial(), set[Atom]()
    for step in plan.steps:
        bound = semantics.binding(step.operator)
        assert not isinstance(bound, str)
        change = semantics.change(*bound, semantics.facts(state), state)
        state = (state - change.ends) | change.adds
        found.update(change.events)
    return frozenset(found)


def unasked(problem: Problem, goals: Sequence[Goal], space: Space) -> Iterator[Atom]:
    """Each event that no workflow asks for and that a step lets happen which reaches a goal, or what that step needs.

    First come those of steps that reach `goals`, then those of steps that all other goals need.
    """
    numbers = tuple(dict.fromkeys(_amounts(problem)))
    asked = {stage for chain in problem.chains for stage in chain.stages}
    seeking = _Seeking(Semantics(problem), space, numbers, asked)
    lengths = {goal.chain: goal.stages for goal in goals}
    for chain in problem.chains:
        for stage in chain.stages[: lengths.get(chain.name, 0)]:
            for part in parts_of(stage):
                yield from seeking.behind(part)
    for condition in (*(goal.condition for goal in goals if goal.condition is not None), problem.goal):
        for atom in _atoms(condition):
            yield from seeking.behind(atom)


@dataclass
class _Seeking:
    """Looks backward for events. Each is told once, and each fact looked at once."""

    semantics: Semantics
    space: Space
    numbers: tuple[Number, ...]
    told: set[Atom]
    seen: set[Atom] = field(default_factory=set)

    def behind(self, atom: Atom) -> Iterator[Atom]:
        """The events of steps that make an atom true; then of those that make true what these need and cannot have."""
        if atom in self.seen:
            return
        self.seen.add(atom)
        found = list(itertools.islice(causes(self.semantics, atom), MOST_CAUSES))
        for cause in found:
            for event in (
                each for one in happening(self.semantics, cause) for each in self._valued(one.event)
            ):
                if event not in self.told:
                    self.told.add(event)
                    yield event
        for cause in found:
            for each in filter(self.space.misses, cause.atoms):
                yield from self.behind(each)

    def _valued(self, event: Atom) -> Iterator[Atom]:
        """The event; with each of the numbers, if one number of it is not known."""
        match list(dict.fromkeys(variables(event))):
            case []:
                yield event
            case [unknown]:
                yield from (substitute_atom(event, {unknown: each}) for each in self.numbers)


def _atoms(condition: Condition) -> Iterator[Atom]:
    """What a condition asks to be true. A quantity has a variable for its value."""
    match condition:
        case Literal(atom, True):
            yield atom
        case And(parts) | Or(parts):
            yield from (atom for each in parts for atom in _atoms(each))
        case Exists(_, part) | ForAll(_, part):
            yield from _atoms(part)


def _amounts(problem: Problem) -> Iterator[Number]:
    """The numbers that the goals name, then how far quantities are from them at the start."""
    named = tuple(dict.fromkeys(_numbers(problem.goal)))
    yield from named
    for atom in problem.initial if named else ():
        if atom.name in problem.domain.quantities and isinstance(value := atom.arguments[-1], Number):
            away = (abs(each.value - value.value) for each in named)
            yield from (Number(each) for each in away if each)


def _numbers(condition: Condition) -> Iterator[Number]:
    """The numbers that a condition compares something with."""
    match condition:
        case Comparison(left, _, right):
            yield from (each for each in (left, right) if isinstance(each, Number))
        case And(parts) | Or(parts):
            yield from (number for each in parts for number in _numbers(each))
        case Exists(_, part) | ForAll(_, part) | Not(part):
            yield from _numbers(part)
