"""Chains that nobody wants to end: their events may occur.

Beside brute force over states and counters.
"""

import itertools
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace

from hypothesis import HealthCheck, assume, event, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.explanation.unreachable_goals import (
    GoalOrStage,
    minimal_goals,
    with_goals_only,
)
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.step_changes import State
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.conditions import ALWAYS_TRUE
from cellwright.kb.model.planning_problem import (
    Listed,
    Problem,
    final_stages,
    initial_progress,
    late_stages,
    next_stages,
    settle_chains,
    stage_holds,
    stages_in_turn,
    too_early,
)
from cellwright.kb.terms import Atom
from tests.properties.problems import CONSTANTS
from tests.properties.test_parts_of_goals import chained

DILIGENT = settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
Counts = tuple[int, ...]


def readings(problem: Problem, counts: Counts, events: Sequence[Atom]) -> Iterator[Counts]:
    """Every way in which events may move chains that wait for them: each moves one, and no
    chain moves twice.
    """
    names = [chain.name for chain in problem.chains]
    waiting = next_stages(problem.chains, dict(zip(names, counts, strict=True)))
    choices = [[n for n in waiting if waiting[n] == each] for each in events]
    for chosen in itertools.product(*choices):
        if len(set(chosen)) == len(chosen):
            yield tuple(count + (name in chosen) for name, count in zip(names, counts, strict=True))


def following(
    problem: Problem, semantics: Semantics, state: State, counts: Counts
) -> Iterator[tuple[State, Counts]]:
    """Every state and count after one step."""
    names = [chain.name for chain in problem.chains]
    facts, late = semantics.facts(state), late_stages(problem.chains, problem.domain)
    before = dict(zip(names, counts, strict=True))
    for operator in problem.domain.operators:
        for values in itertools.product(CONSTANTS, repeat=len(operator.parameters)):
            bindings = dict(zip(operator.variables, values, strict=True))
            if not condition_holds(operator.precondition, facts, bindings):
                continue
            change = semantics.change(operator, bindings, facts, state)
            after = (state - change.ends) | change.adds
            for moved in readings(problem, counts, change.events):
                found = settle_chains(
                    problem.chains, dict(zip(names, moved, strict=True)), stage_holds(Listed(after))
                )
                turn = stages_in_turn(problem.chains, before, found)
                if too_early(late, change.adds, stage_holds(Listed(state)), turn) is None:
                    yield after, tuple(found[name] for name in names)


def reachable(problem: Problem) -> bool:
    """Whether breadth-first search over states and counters of chains reaches the goals."""
    semantics = Semantics(problem)
    start = semantics.initial()
    counts = initial_progress(problem.chains, stage_holds(Listed(start)))
    first = (start, tuple(counts[chain.name] for chain in problem.chains))
    seen, queue = {first}, deque([first])
    while queue:
        state, reached = queue.popleft()
        if ended(problem, semantics, state, reached):
            return True
        for node in following(problem, semantics, state, reached):
            if node not in seen:
                seen.add(node)
                queue.append(node)
    return False


def ended(problem: Problem, semantics: Semantics, state: State, reached: Counts) -> bool:
    """Whether the goals hold, and each wanted chain has come to its end."""
    whole = all(
        n == len(c.stages) or not c.wanted for c, n in zip(problem.chains, reached, strict=True)
    )
    lasts = (last for own in final_stages(problem.chains, problem.domain).values() for last in own)
    met = problem.goal == ALWAYS_TRUE or condition_holds(problem.goal, semantics.facts(state), {})
    return whole and met and all(last in state for last in lasts)


@given(chained(), st.tuples(st.booleans(), st.booleans()))
@DILIGENT
def test_a_problem_with_chains_that_may_stay_open_has_a_plan_exactly_if_brute_force_finds_one(
    problem: Problem, wanted: tuple[bool, bool]
) -> None:
    chains = tuple(
        replace(each, wanted=own) for each, own in zip(problem.chains, wanted, strict=True)
    )
    problem = replace(problem, chains=chains)
    try:
        found = checked_plan.plan_problem(problem)
    except InvalidInput:
        assume(False)
    event(f"{type(found).__name__}, wanted {sum(wanted)}")
    assert isinstance(found, Found if reachable(problem) else Infeasible)


@given(chained())
@DILIGENT
def test_goals_named_as_out_of_reach_are_so_and_each_part_of_them_is_not(problem: Problem) -> None:
    try:
        assume(isinstance(checked_plan.plan_problem(problem), Infeasible))
    except InvalidInput:
        assume(False)
    goals: list[GoalOrStage] = minimal_goals(problem, lambda each: not reachable(each))
    event(f"{len(goals)} goals")
    assert isinstance(checked_plan.plan_problem(with_goals_only(problem, goals)), Infeasible)
    for left_out in goals if len(goals) > 1 else ():
        assert isinstance(
            checked_plan.plan_problem(
                with_goals_only(problem, [g for g in goals if g is not left_out])
            ),
            Found,
        )
