"""The planner against brute force, and every order that a plan allows."""

from collections.abc import Callable, Hashable, Iterable, Iterator
from typing import TypeVar

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.ground_task import progress_state
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning.regression.backward_search import BackwardSpace, Regression
from cellwright.engine.stages.planning.regression.mutex_pairs import find_mutexes
from cellwright.engine.stages.validation import validate_plan
from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.plan_model import Plan, Step
from cellwright.kb.model.planning_problem import Problem
from tests.properties.problems import problems, shortest, successors

FAMILIES = st.one_of(problems(), problems(conditional=True), problems(deductive=True))
DILIGENT = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))


@given(FAMILIES)
@DILIGENT
def test_the_planner_agrees_with_brute_force_on_solvability(problem: Problem) -> None:
    try:
        outcome = checked_plan.plan_problem(problem)
    except InvalidInput:
        assume(False)
    length = shortest(problem)
    if length is None:
        assert isinstance(outcome, Infeasible)
    else:
        assert isinstance(outcome, Found)
        assert len(outcome.plan.steps) >= length


def linearisations(plan: Plan, limit: int) -> list[list[Step]]:
    """Orders of the steps that the plan allows, at most `limit`."""
    found: list[list[Step]] = []

    def extend(done: list[Step], rest: list[Step]) -> None:
        if len(found) >= limit:
            return
        if not rest:
            found.append(done)
        names = {step.id for step in done}
        for step in rest:
            if set(step.after) <= names:
                extend([*done, step], [other for other in rest if other is not step])

    extend([], list(plan.steps))
    return found


@given(FAMILIES)
@DILIGENT
def test_every_linearisation_of_a_plan_executes(problem: Problem) -> None:
    try:
        outcome = checked_plan.plan_problem(problem)
    except InvalidInput:
        assume(False)
    assume(isinstance(outcome, Found))
    assert isinstance(outcome, Found)
    semantics = Semantics(problem)
    for order in linearisations(outcome.plan, 40):
        state = semantics.initial()
        for step in order:
            following = dict(successors(semantics, problem, state))
            assert step.operator in following
            state = following[step.operator]
        assert condition_holds(problem.goal, semantics.facts(state), {})


@pytest.mark.slow
@given(FAMILIES, st.data())
@settings(
    DILIGENT, max_examples=20
)  # most problems have no plan; `test_checker.py` tries more, on random sequences
def test_the_checker_refuses_a_plan_whose_order_can_fail(
    problem: Problem, data: st.DataObject
) -> None:
    """Steps and orders are taken away at random; what the checker still accepts must execute in
    every order.
    """
    try:
        outcome = checked_plan.plan_problem(problem)
    except InvalidInput:
        assume(False)
    assume(isinstance(outcome, Found) and outcome.plan.steps)
    assert isinstance(outcome, Found)
    gone = data.draw(st.sampled_from([None, *(step.id for step in outcome.plan.steps)]))
    steps = []
    for step in outcome.plan.steps:
        if step.id != gone:
            kept = tuple(b for b in step.after if b != gone and data.draw(st.booleans()))
            steps.append(
                Step(step.id, step.operator, kept, step.resources, step.duration, step.cost)
            )
    links = tuple(k for k in outcome.plan.links if gone not in (k.producer, k.consumer))
    mutated = Plan(tuple(steps), links)
    if validate_plan(problem, mutated):
        return
    semantics = Semantics(problem)
    for order in linearisations(mutated, 40):
        state = semantics.initial()
        for step in order:
            following = dict(successors(semantics, problem, state))
            assert step.operator in following
            state = following[step.operator]
        assert condition_holds(problem.goal, semantics.facts(state), {})


@given(FAMILIES, st.data())
@DILIGENT
def test_regressed_goals_suffice_for_the_goals(problem: Problem, data: st.DataObject) -> None:
    try:
        task = ground(problem)
    except InvalidInput:
        assume(False)
    plain = [operator for operator in task.operators if not operator.conditional]
    assume(plain)
    space = BackwardSpace(Regression(plain, task.weights, find_mutexes(task)), task.initial)
    some = st.integers(0, (1 << len(task.atoms)) - 1)
    root = space.root(data.draw(some) | data.draw(st.sampled_from(plain)).adds)
    for _, _, operator, open_ in space.successors(root) if root else ():
        reached = progress_state(open_ | data.draw(some), plain[operator])
        assert root is not None
        assert root.open & ~reached == 0


@given(FAMILIES)
@DILIGENT
def test_no_reachable_state_holds_two_atoms_of_a_mutex_group(problem: Problem) -> None:
    try:
        task = ground(problem)
    except InvalidInput:
        assume(False)

    def applied(state: int) -> Iterator[int]:
        return (
            progress_state(state, operator)
            for operator in task.operators
            if operator.preconditions & ~state == 0
        )

    for state in reachable(task.initial, applied):
        assert all((state & group).bit_count() <= 1 for group in task.mutex_groups), task.names(
            state
        )


State = TypeVar("State", bound=Hashable)


def reachable(start: State, following: Callable[[State], Iterable[State]]) -> set[State]:
    """Everything that can be reached from `start`."""
    seen, waiting = {start}, [start]
    while waiting:
        for state in following(waiting.pop()):
            if state not in seen:
                seen.add(state)
                waiting.append(state)
    return seen


@given(FAMILIES)
@DILIGENT
def test_the_ground_task_has_the_states_of_the_domain(problem: Problem) -> None:
    try:
        task = ground(problem)
    except InvalidInput:
        assume(False)
    semantics = Semantics(problem)
    plain = [operator for operator in task.operators if not operator.instance.name.startswith("_")]

    def applied(state: int) -> Iterator[int]:
        return (
            progress_state(state, operator)
            for operator in plain
            if operator.preconditions & ~state == 0
        )

    slow = reachable(
        semantics.initial(),
        lambda state: [each for _, each in successors(semantics, problem, state)],
    )
    fast = reachable(task.initial, applied)
    fluents = {"p", "q", "r"}
    assert {
        frozenset(atom for atom in task.names(state) if atom.name in fluents) for state in fast
    } == slow
