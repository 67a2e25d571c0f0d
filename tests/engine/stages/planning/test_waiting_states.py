"""What waits in the queues of searches is small, and nothing else changes by that."""

from unittest.mock import patch

from hypothesis import HealthCheck, assume, given, settings

from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning.forward.forward_search import MAX_SMALL_NUMBER, in_order
from cellwright.engine.stages.planning.regression.backward_search import (
    BackwardSpace,
    BestFirstRegression,
    Regression,
    _conditions_key,
)
from cellwright.engine.stages.planning.regression.mutex_pairs import find_mutexes
from cellwright.engine.stages.planning.search_control import Effort
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.planning_problem import Problem
from tests.properties.problems import problems

SOME = settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))


@given(problems())
@SOME
def test_backward_search_with_digests_takes_the_same_steps_as_with_the_conditions(
    problem: Problem,
) -> None:
    try:
        task = ground(problem)
    except InvalidInput:
        assume(False)
        return
    space = BackwardSpace(
        Regression(task.operators, task.weights, find_mutexes(task)), task.initial
    )
    roots = [root for goal in task.goals if (root := space.root(goal)) is not None]
    efforts = [Effort(1000), Effort(1000)]
    plain = BestFirstRegression(space, roots, 5).run(efforts[0])
    with patch(
        "cellwright.engine.stages.planning.regression.backward_search.SHORT_CONDITION_BITS", -1
    ):
        assert BestFirstRegression(space, roots, 5).run(efforts[1]) == plain
    assert efforts[0].generated == efforts[1].generated


def test_long_conditions_become_short_and_different_ones_stay_different() -> None:
    many = [1 << 20_000 | 1 << place for place in range(1000)]
    found = {_conditions_key(each) for each in many}
    assert len(found) == 1000
    assert all(isinstance(each, bytes) and len(each) == 16 for each in found)


def test_successors_that_wait_take_four_bytes_each_and_numbers_of_any_size_are_kept() -> None:
    assert in_order([3, 1, 2]).tolist() == [2, 1, 3]
    assert in_order([3, 1, 2]).itemsize == 4
    assert in_order([MAX_SMALL_NUMBER + 1, 5]).tolist() == [5, MAX_SMALL_NUMBER + 1]
