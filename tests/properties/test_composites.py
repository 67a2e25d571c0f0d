"""Composite operators: what they do is what their parts do, and a search has with them the
answers that it has without.
"""

import itertools

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import STRATEGIES, Macros, SearchLimits, plan_task
from cellwright.engine.stages.planning.composites import Pattern, PatternJoins, compose_operators
from cellwright.engine.stages.planning.forward.forward_search import (
    CompositeSuggestions,
    start_forward_search,
)
from cellwright.engine.stages.planning.regression.backward_search import (
    BackwardSpace,
    BestFirstRegression,
    Regression,
)
from cellwright.engine.stages.planning.regression.mutex_pairs import find_mutexes
from cellwright.engine.stages.planning.search_control import Effort
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Term, Variable, match_term
from tests.properties.problems import problems, shortest

DILIGENT = settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
sets = st.integers(0, 31)
NAMES, OBJECTS, VARIABLES = ("go", "take"), ("a", "b", "c"), ("X", "Y", "Z")


def terms(names: tuple[str, ...], kind: type) -> st.SearchStrategy[Term]:
    plain = st.sampled_from(names).map(kind)
    return st.one_of(plain, plain.map(lambda inner: Function("slot", (inner,))))


def instances(argument: st.SearchStrategy[Term]) -> st.SearchStrategy[Function]:
    arguments = st.tuples(argument, argument)
    return st.builds(Function, st.sampled_from(NAMES), arguments)


ground_operators = st.builds(
    GroundOperator, instances(terms(OBJECTS, Function)), sets, sets, sets, cost=st.integers(0, 3)
)
patterns = st.lists(
    instances(st.one_of(terms(VARIABLES, Variable), terms(OBJECTS, Function))),
    min_size=2,
    max_size=3,
).map(tuple)


@given(st.lists(ground_operators, min_size=1, max_size=4), sets)
def test_a_composite_does_what_its_parts_do_in_turn_and_needs_what_they_need(
    parts: list[GroundOperator], state: int
) -> None:
    whole, reached = compose_operators(parts), state
    for part in parts:
        if part.preconditions & ~reached:
            assert whole is None or whole.preconditions & ~state
            return
        reached = progress_state(reached, part)
    if whole is None:
        assert reached & ~state == 0  # nothing is gained
        return
    assert whole.preconditions & ~state == 0
    assert progress_state(state, whole) == reached
    assert whole.cost == sum(part.cost for part in parts)


@given(st.lists(ground_operators, max_size=5), patterns)
def test_joins_find_what_matching_all_sequences_finds(
    operators: list[GroundOperator], pattern: Pattern
) -> None:
    slow = []
    for numbers in itertools.permutations(range(len(operators)), len(pattern)):
        bindings: dict[Variable, Term] | None = {}
        for step, number in zip(pattern, numbers, strict=True):
            bindings = (
                None if bindings is None else match_term(step, operators[number].instance, bindings)
            )
        slow += [] if bindings is None else [(0, numbers)]
    everything = range(len(operators))
    assert sorted(PatternJoins(operators, [pattern]).sequences(everything, everything)) == slow


@given(st.lists(ground_operators, max_size=5), patterns, sets)
def test_suggested_composites_are_applicable_and_all_of_the_relaxed_plan(
    operators: list[GroundOperator], pattern: Pattern, state: int
) -> None:
    everything = range(len(operators))
    suggestions = CompositeSuggestions(operators, [pattern])
    for number in suggestions.suggested(state, everything, everything):
        reached = state
        for part in suggestions.unfolded(number):
            assert part.preconditions & ~reached == 0
            reached = progress_state(reached, part)
        assert progress_state(state, suggestions.operators[number]) == reached
        assert suggestions.pattern(number) == pattern


def _task(problem: Problem) -> GroundTask:
    try:
        task = ground(problem)
    except InvalidInput:
        assume(False)
    return task


def _chosen(task: GroundTask, data: st.DataObject) -> Macros:
    """Sequences of the task's own operators, some of their arguments made variables."""
    assume(task.operators)
    found = []
    for _ in range(data.draw(st.integers(1, 3))):
        operators = data.draw(st.lists(st.sampled_from(task.operators), min_size=2, max_size=3))
        lifted = data.draw(st.booleans())
        names: dict[Term, Term] = {}
        found.append(
            tuple(
                Function(
                    each.instance.name,
                    tuple(
                        names.setdefault(a, Variable(f"X{len(names)}")) if lifted else a
                        for a in each.instance.arguments
                    ),
                )
                for each in operators
            )
        )
    return Macros(tuple(found), tuple(found))


@given(st.one_of(problems(), problems(conditional=True)), st.data())
@DILIGENT
def test_the_planner_with_macrops_agrees_with_brute_force_on_solvability(
    problem: Problem, data: st.DataObject
) -> None:
    task = _task(problem)
    macros = _chosen(task, data)
    for strategy in ("auto", "backward", "forward", "landmarks"):
        assert strategy in STRATEGIES
        outcome = plan_task(task, SearchLimits(strategy=strategy), macros)
        if shortest(problem) is None:
            assert isinstance(outcome, Infeasible)
        else:
            assert isinstance(outcome, Found)


@given(problems(), st.data())
@DILIGENT
def test_searches_that_take_composites_return_executable_steps(
    problem: Problem, data: st.DataObject
) -> None:
    task = _task(problem)
    assume(len(task.goals) == 1)
    chosen = _chosen(task, data).forward
    regression = Regression(task.operators, task.weights, find_mutexes(task))
    extended = BackwardSpace(regression, task.initial).offered(chosen, 1000)
    root = extended.root(task.goals[0])
    searches = [
        start_forward_search(task, 0, patterns=chosen),
        *([BestFirstRegression(extended, [root], 5)] if root else []),
    ]
    for search in searches:
        answer = search.run(Effort(10_000))
        assert answer is not None
        assert (answer.steps is None) == (shortest(problem) is None)
        state = task.initial
        for step in answer.steps or ():
            assert step.preconditions & ~state == 0
            state = progress_state(state, step)
        assert answer.steps is None or task.goals[0] & ~state == 0
        assert set(answer.offer.used) <= set(answer.offer.offered) <= set(chosen)
