"""Unordered steps that could disturb each other, against all unordered pairs."""

from collections.abc import Callable, Iterator
from unittest.mock import patch

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.validation import validate_plan
from cellwright.engine.stages.validation.step_precedence import (
    Region,
    StepPrecedence,
    TouchedKeys,
    disturbing_pairs,
    unordered_places,
)
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import ANYTHING, Function
from tests.engine.stages.validation.test_precedence import plans
from tests.properties.random_plans import posed

A = Function("a")
SOME = settings(max_examples=50, deadline=None, suppress_health_check=list(HealthCheck))
within = st.sampled_from([(name, first) for name in "pq" for first in (A, ANYTHING)][:3])
keys = st.frozensets(st.sampled_from("abc"), max_size=2)


def every(
    order: StepPrecedence, _: object, touched: Callable[[int], object]
) -> Iterator[tuple[int, int]]:
    """All unordered pairs."""
    for place, step in enumerate(order.ids):
        for other in order.unordered_before(step):
            _ = touched(place), touched(other)
            yield place, other


@given(plans(), st.data())
def test_all_unordered_pairs_with_something_in_common_are_found_once_and_in_order(
    plan: Plan, data: st.DataObject
) -> None:
    order = StepPrecedence(plan)
    touched = [TouchedKeys(data.draw(keys), data.draw(keys)) for _ in plan.steps]
    meeting = [
        (one, other)
        for one, other in every(order, None, touched.__getitem__)
        if touched[one].changed & touched[other].exposed
        or touched[one].exposed & touched[other].changed
    ]
    assert list(disturbing_pairs(order, order.partners(), touched.__getitem__)) == meeting


def meet(one: Region, other: Region) -> bool:
    return one == other or (one[0] == other[0] and ANYTHING in (one[1], other[1]))


@given(plans(), st.data())
def test_unordered_steps_that_touch_the_same_region_are_loose_and_no_others_without_such_steps(
    plan: Plan, data: st.DataObject
) -> None:
    order = StepPrecedence(plan)
    regions = [data.draw(st.frozensets(within, max_size=2)) for _ in plan.steps]
    meeting = {
        place
        for pair in every(order, None, regions.__getitem__)
        if any(meet(one, other) for one in regions[pair[0]] for other in regions[pair[1]])
        for place in pair
    }
    found = unordered_places(order, regions.__getitem__)
    assert meeting <= set(found)
    assert found == sorted(found)
    if not meeting and not any(each[1] == ANYTHING for own in regions for each in own):
        assert not found


@given(posed())
@SOME
def test_the_checker_tells_of_the_same_conflicts_as_with_all_pairs(
    given: tuple[Problem, Plan],
) -> None:
    found = validate_plan(*given)
    with patch("cellwright.engine.stages.validation.step_interference.disturbing_pairs", every):
        assert validate_plan(*given) == found


def test_parallel_steps_that_touch_nothing_common_are_no_pairs_and_a_sequence_asks_for_no_step() -> (
    None
):
    parallel = Plan(tuple(Step(StepId(n), Function("s")) for n in range(1, 301)))
    touched = [TouchedKeys(frozenset([n]), frozenset([n])) for n in range(300)]
    assert not list(disturbing_pairs(StepPrecedence(parallel), range(300), touched.__getitem__))
    sequence = Plan(
        tuple(
            Step(StepId(n), Function("s"), (StepId(n - 1),) if n > 1 else ()) for n in range(1, 301)
        )
    )
    assert not list(unordered_places(StepPrecedence(sequence), [].__getitem__))
