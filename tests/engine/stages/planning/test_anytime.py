"""Better plans one after another, several strategies at once, and the fewest steps proved."""

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found, GaveUp, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import RACE, SearchLimits, plan_task
from cellwright.engine.stages.planning.portfolio import STRATEGIES
from cellwright.engine.stages.planning.search_control import OutOfRange
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_problem
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.stopping import StoppedByCaller
from tests.properties.problems import problems, shortest


@given(st.one_of(problems(), problems(deductive=True)))
@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
def test_shortest_finds_as_few_steps_as_brute_force(problem: Problem) -> None:
    try:
        outcome = checked_plan.plan_problem(problem, SearchLimits(strategy="shortest"))
    except InvalidInput:
        assume(False)
    fewest = shortest(problem)
    assume(fewest is not None)
    assert isinstance(outcome, Found)
    assert len(outcome.plan.steps) == fewest


def test_every_plan_told_of_is_better_than_the_one_before_and_the_last_is_the_answer() -> None:
    problem, heard = load_problem("bulkhead/both_tools"), list[Plan]()
    outcome = checked_plan.plan_problem(
        problem,
        SearchLimits(
            thorough=True,
            interrupted=lambda: bool(heard) and heard[-1].cost <= 12,
            improved=heard.append,
        ),
    )
    assert isinstance(outcome, Found)
    costs = [each.cost for each in heard]
    assert costs == sorted(set(costs), reverse=True)
    assert len(costs) > 1
    assert outcome.plan == heard[-1]
    assert all(checked_plan.check_plan(problem, each) == [] for each in heard)


@given(problem=problems())
@settings(max_examples=4, deadline=None, suppress_health_check=list(HealthCheck))
def test_a_race_answers_as_brute_force_does(problem: Problem) -> None:
    try:
        outcome = checked_plan.plan_problem(problem, SearchLimits(strategy=RACE))
    except InvalidInput:
        assume(False)
    assert isinstance(outcome, Infeasible if shortest(problem) is None else Found)


def test_a_race_keeps_the_best_plan_when_interrupted() -> None:
    heard = list[Plan]()
    limits = SearchLimits(
        strategy=RACE, thorough=True, interrupted=lambda: bool(heard), improved=heard.append
    )
    outcome = checked_plan.plan_problem(load_problem("bulkhead/both_tools"), limits)
    assert isinstance(outcome, Found)
    assert outcome.plan.cost == heard[-1].cost


def test_a_race_that_may_not_expand_anything_gives_up() -> None:
    task = ground(load_problem("bulkhead/twelve_points"))
    assert isinstance(plan_task(task, SearchLimits(expansions=1, strategy=RACE)), GaveUp)


def test_the_best_plan_survives_want_of_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def greedy(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(
        "cellwright.engine.stages.planning.improvement.window_optimisation.optimise_windows", greedy
    )
    assert isinstance(checked_plan.plan_problem(load_problem("bulkhead/both_tools")), Found)


def test_the_best_plan_survives_a_grounding_that_is_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The time is over in the grounding of a window; the search is told then, so that the
    answer may still be checked.
    """
    asked: list[bool] = []

    def late(*_: object) -> None:
        raise StoppedByCaller

    monkeypatch.setattr(
        "cellwright.engine.stages.planning.improvement.window_optimisation.optimise_windows", late
    )
    limits = SearchLimits(interrupted=lambda: bool(asked.append(True)))
    outcome = checked_plan.plan_problem(load_problem("bulkhead/both_tools"), limits)
    assert isinstance(outcome, Found)
    assert asked


def test_the_best_plan_survives_values_that_other_searches_cannot_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried: list[object] = []

    def lost(*given: object) -> None:
        tried.append(given)
        raise OutOfRange

    monkeypatch.setitem(STRATEGIES, "landmarks", lost)
    limits = SearchLimits(thorough=True, room=None, interrupted=lambda: bool(tried))
    assert isinstance(checked_plan.plan_problem(load_problem("bulkhead/one_point"), limits), Found)
    assert tried


def test_want_of_memory_in_the_search_is_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    def greedy(*_: object) -> None:
        raise MemoryError

    monkeypatch.setitem(STRATEGIES, "auto", greedy)
    outcome = checked_plan.plan_problem(load_problem("bulkhead/both_tools"))
    assert isinstance(outcome, GaveUp)
    assert outcome.limit == "memory"
