"""Searches for plans that cost less than a bound, and windows that they plan anew."""

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits, plan_task
from cellwright.engine.stages.planning.forward.weighted_search import (
    search_between,
    start_weighted_search,
)
from cellwright.engine.stages.planning.improvement.anytime_improvement import (
    PlanPool,
    WeightedSearches,
)
from cellwright.engine.stages.planning.improvement.plan_reordering import group_steps
from cellwright.engine.stages.planning.portfolio import SearchSetting
from cellwright.engine.stages.planning.search_control import Effort, SearchResult
from tests.engine.stages.planning.test_exact import SIZE, least, sets, tasks

PLENTY = 100_000


def after(state: Bits, steps: list[GroundOperator]) -> Bits:
    """The state after steps, each of which can be done."""
    for step in steps:
        assert not step.preconditions & ~state
        state = progress_state(state, step)
    return state


def cost_of(answer: SearchResult | None) -> int | None:
    assert answer is not None
    return None if answer.steps is None else sum(step.cost for step in answer.steps)


@given(tasks(), st.integers(0, 12), st.integers(1, 5), st.booleans(), st.integers(0, 3))
@settings(max_examples=300, deadline=None)
def test_a_plan_below_the_bound_is_found_if_there_is_one(
    task: GroundTask, bound: int, weight: int, landmarks: bool, seed: int
) -> None:
    answer = (
        start_weighted_search(task, landmarks=landmarks)
        .anew(weight, bound, seed)
        .run(Effort(PLENTY))
    )
    cost, cheapest = cost_of(answer), least(task)
    if cheapest is None or cheapest >= bound:
        assert cost is None
        return
    assert cost is not None
    assert cheapest <= cost < bound
    assert answer is not None
    state = after(task.initial, answer.steps or [])
    assert any(not goal & ~state for goal in task.goals)


@given(tasks(), sets, sets, st.integers(1, 9))
@settings(max_examples=200, deadline=None)
def test_between_two_states_of_a_plan_the_answer_is_a_cheaper_way(
    task: GroundTask, state: Bits, goals: Bits, bound: int
) -> None:
    search = search_between(task.operators, SIZE)
    search.between(goals, state, bound).run(Effort(PLENTY))  # which leaves nothing behind
    answer = search.between(state, goals, bound).run(Effort(PLENTY))
    cost = cost_of(answer)
    cheapest = least(GroundTask(task.atoms, task.operators, state, (goals,), task.weights))
    assert (cost is None) == (cheapest is None or cheapest >= bound)
    if cost is not None:
        assert cost < bound
        assert answer is not None
        assert not goals & ~after(state, answer.steps or [])


@given(tasks())
@settings(max_examples=200, deadline=None)
def test_improvement_without_end_ends_with_a_proof(task: GroundTask) -> None:
    cheapest = least(task)
    outcome = plan_task(task, SearchLimits(thorough=True, room=None))
    assert isinstance(outcome, Found) == (cheapest is not None)
    if isinstance(outcome, Found):
        assert outcome.optimal
        assert outcome.plan.cost == cheapest


@given(tasks(), st.integers(0, 1 << 30))
@settings(max_examples=200, deadline=None)
def test_what_belongs_together_is_done_side_by_side_with_the_same_effect(
    task: GroundTask, seed: int
) -> None:
    chance, state, steps = Random(seed), task.initial, list[GroundOperator]()
    for _ in range(chance.randrange(20)):
        ready = [each for each in task.operators if not each.preconditions & ~state]
        if ready:
            steps.append(chance.choice(ready))
            state = progress_state(state, steps[-1])
    order = group_steps(steps, chance)
    assert sorted(map(id, order)) == sorted(map(id, steps))
    assert after(task.initial, order) == state


def test_errands_that_a_plan_mixes_stand_side_by_side() -> None:
    takes = [GroundOperator(str(n), 0, 1 << n, 0) for n in range(8)]  # type: ignore[arg-type]
    brings = [GroundOperator(str(n), 1 << n, 1 << 8 + n, 0) for n in range(8)]  # type: ignore[arg-type]
    order = group_steps([*takes, *brings], Random(1))
    assert [takes.index(each) for each in order[::2]] == [
        brings.index(each) for each in order[1::2]
    ]


@pytest.mark.parametrize("landmarks", [False, True])
def test_the_cheapest_plan_of_a_cell_is_found_with_ever_lower_bounds(landmarks: bool) -> None:
    task = ground(problem_of("bulkhead/both_tools"))
    search, bound = start_weighted_search(task, landmarks=landmarks), 100
    while (cost := cost_of(search.anew(2, bound, 0).run(Effort(PLENTY)))) is not None:
        bound = cost
    assert bound == 12


def test_searches_begin_where_a_plan_was_found_last_and_hear_when_to_stop() -> None:
    task = ground(problem_of("themse/two"))
    pool = PlanPool([list(task.operators)])
    searches = WeightedSearches(SearchSetting(task), pool)
    for _ in range(3):
        for steps in searches.round(lambda: False):
            assert sum(step.cost for step in steps) < sum(step.cost for step in pool.best)
            pool.add(list(steps))
    assert not searches.ended
    assert list(searches.round(lambda: True)) == []
