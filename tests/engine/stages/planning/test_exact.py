"""Cheapest plans: the kernel agrees with a slow, plain search on random tasks, and says when it
gives up.
"""

import heapq
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("unified_planning")

from cellwright.engine.formats.interop.up.state_space_proofs import prove_optimum
from cellwright.engine.kernels.bits import Bits, bitset
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.workflow_replay import STAGE_OPERATOR, reach_stages_early
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits, plan_task
from cellwright.engine.stages.planning.improvement.exact_optimum import (
    CheapestPlan,
    find_cheapest_plan,
)
from cellwright.engine.stages.planning.search_control import StateRoom
from cellwright.kb.terms import Function

SIZE = 40  # more atoms than a word has bits
USED = (0, 1, 2, 31, 32, 33)
sets = st.sets(st.sampled_from(USED), max_size=2).map(bitset)


@st.composite
def tasks(draw: st.DrawFn) -> GroundTask:
    """A few operators, some of them internal ones that cost nothing."""
    operators = []
    for number in range(draw(st.integers(1, 7))):
        needs, adds, deletes = draw(sets), draw(sets), draw(sets)
        operators.append(
            GroundOperator(
                Function(f"o{number}"), needs, adds, deletes, cost=draw(st.integers(0, 3))
            )
        )
    goals = tuple(draw(st.lists(sets, min_size=1, max_size=2)))
    atoms = tuple(Function(f"p{number}") for number in range(SIZE))
    return GroundTask(atoms, tuple(operators), draw(sets), goals, (1,) * SIZE)


def least(task: GroundTask) -> int | None:
    """The cost of a cheapest plan, by Dijkstra's algorithm as it stands in books."""
    known: dict[Bits, int] = {task.initial: 0}
    queue = [(0, task.initial)]
    while queue:
        cost, state = heapq.heappop(queue)
        if any(not goal & ~state for goal in task.goals):
            return cost
        for operator in task.operators:
            following = progress_state(state, operator)
            dearer = cost + operator.cost
            if not operator.preconditions & ~state and dearer < known.get(following, 1 << 30):
                known[following] = dearer
                heapq.heappush(queue, (dearer, following))
    return None


def searched(task: GroundTask, bound: int, room: StateRoom = StateRoom()) -> CheapestPlan | None:
    return find_cheapest_plan(
        task.operators, SIZE, task.initial, task.goals, bound, lambda: False, room
    )


@given(tasks(), st.integers(0, 12))
@settings(max_examples=300, deadline=None)
def test_the_cheapest_plan_below_a_bound_is_found_and_no_other(
    task: GroundTask, bound: int
) -> None:
    cost, found = least(task), searched(task, bound)
    assert found is not None
    if cost is None or cost >= bound:
        assert found.steps is None
        return
    assert found.steps is not None
    assert sum(step.cost for step in found.steps) == cost
    state = task.initial
    for step in found.steps:
        assert not step.preconditions & ~state
        state = progress_state(state, step)
    assert any(not goal & ~state for goal in task.goals)


def test_stages_are_reached_on_the_way() -> None:
    """An internal operator is no step of the plan, and is taken where it can be."""
    a, b, c = 1, 2, 4
    go = GroundOperator(Function("go"), 0, a, 0)
    reach = GroundOperator(Function(STAGE_OPERATOR), a | b, c, b, cost=0)
    task = GroundTask(tuple(map(Function, "abc")), (go, reach), b, (c,), (1,) * 3)
    assert searched(task, 5) == CheapestPlan((go,))
    assert reach_stages_early(task, [go]) == [go, reach]
    assert searched(replace(task, initial=a | b), 5) == CheapestPlan(())


def test_what_takes_too_long_is_given_up() -> None:
    task = ground(checked_plan.problem_of("themse/one"))
    size = len(task.atoms)
    small = StateRoom(states=100)
    assert (
        find_cheapest_plan(task.operators, size, task.initial, task.goals, 30, lambda: False, small)
        is None
    )
    assert (
        find_cheapest_plan(
            task.operators, size, task.initial, task.goals, 30, lambda: False, StateRoom(checks=99)
        )
        is None
    )
    assert (
        find_cheapest_plan(task.operators, size, task.initial, task.goals, 1 << 40, lambda: False)
        is None
    )
    two = ground(checked_plan.problem_of("themse/two"))
    stopped = find_cheapest_plan(
        two.operators, len(two.atoms), two.initial, two.goals, 40, lambda: True
    )
    assert stopped is None
    assert find_cheapest_plan(
        task.operators, size, task.initial, task.goals, 0, lambda: True
    ) == CheapestPlan(None)


SHORTEST = {
    "themse/furnace_of_two": 14,
    "themse/in_furnace": 5,
    "themse/lid_on_stand": 12,
    "themse/one": 21,
    "themse/two": 37,
    "themse/sentence": 37,
    "themse/four": 69,
    "bulkhead/one_point": 5,
    "bulkhead/both_tools": 12,
    "bulkhead/twelve_points": 56,
}


LONG = ("themse/four", "themse/sentence")


@pytest.mark.parametrize(
    "target",
    [pytest.param(each, marks=[pytest.mark.slow] if each in LONG else []) for each in SHORTEST],
)
def test_plans_of_the_bundled_problems_are_as_short_as_can_be(target: str) -> None:
    """All but the last were proved with room for four million states."""
    outcome = checked_plan.plan_problem(checked_plan.problem_of(target))
    assert isinstance(outcome, Found)
    assert outcome.plan.cost == SHORTEST[target]
    assert outcome.optimal == (target not in ("themse/four", "bulkhead/twelve_points"))


def test_a_proof_is_asked_for_where_planning_had_no_room_for_it() -> None:
    problem = checked_plan.problem_of("bulkhead/both_tools")
    rough = checked_plan.plan_problem(problem, SearchLimits(room=None, restarts=0, improvement=0))
    assert isinstance(rough, Found)
    assert not rough.optimal
    best = prove_optimum(problem, rough, lambda: False)
    assert best.optimal
    assert best.plan.cost == 12
    assert not prove_optimum(problem, rough, lambda: True).optimal


def test_a_plan_is_known_to_be_cheapest_without_a_search_for_a_proof_where_steps_cost_the_same() -> (
    None
):
    task = ground(checked_plan.problem_of("themse/lid_on_stand"))
    outcome = plan_task(task, SearchLimits(strategy="shortest", room=None, restarts=0))
    assert isinstance(outcome, Found)
    assert outcome.optimal
    assert outcome.plan.cost == 12
