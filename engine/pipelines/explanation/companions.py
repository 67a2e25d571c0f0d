"""Events that nobody asks for. A step that reaches a stage may let others happen, too: all that lies in a rotor is spun.

What no workflow asks for cannot occur. So it may be all that is missing that it is asked for.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator

from engine.model.explanation import Amendment
from engine.model.outcome import Found, Outcome
from engine.pipelines.explanation.amendments import changed
from engine.pipelines.explanation.causes import causes, company
from engine.pipelines.explanation.culprits import Goal
from engine.stages.validation.semantics import Semantics
from kb.model.domain import Kind
from kb.model.problem import Problem
from kb.terms import Atom

MOST = 60  # changes that are planned with, for each size
ENOUGH = 3
SIZES = (1, 2)  # events that are asked for, too

Planned = Callable[[Problem], Outcome | None]


def companions(
    problem: Problem, goals: Iterable[Goal], planned: Planned
) -> Iterator[tuple[Amendment, Found]]:
    """The fewest events that have to be asked for besides the goals so that there is a plan, with that plan."""
    events, found = tuple(unasked(problem, goals)), 0
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


def unasked(problem: Problem, goals: Iterable[Goal]) -> Iterator[Atom]:
    """Each event that a step may let happen while it reaches a stage of the goals, and that no workflow asks for."""
    semantics, lengths = Semantics(problem), {goal.chain: goal.stages for goal in goals}
    asked = {stage for chain in problem.chains for stage in chain.stages}
    seen: set[Atom] = set()
    for chain in problem.chains:
        for stage in chain.stages[: lengths.get(chain.name, 0)]:
            if problem.domain.predicates[stage.name].kind is Kind.EVENT:
                for cause in causes(semantics, stage):
                    for each in company(semantics, cause):
                        if each.event not in asked and each.event not in seen:
                            seen.add(each.event)
                            yield each.event
