"""Unordered steps that could disturb each other, against all unordered pairs."""

from collections.abc import Callable, Iterator
from unittest.mock import patch

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from engine.stages.validation import validate
from engine.stages.validation.pairs import Touched, pairs
from engine.stages.validation.precedence import Precedence
from kb.model.plan import Plan, Step, StepId
from kb.model.problem import Problem
from kb.terms import Function
from tests.engine.stages.validation.test_precedence import plans
from tests.properties.plans import posed

SOME = settings(max_examples=50, deadline=None, suppress_health_check=list(HealthCheck))
keys = st.frozensets(st.sampled_from("abc"), max_size=2)


def every(order: Precedence, touched: Callable[[int], object]) -> Iterator[tuple[int, int]]:
    """All unordered pairs."""
    for place, step in enumerate(order.ids):
        for other in order.unordered_before(step):
            _ = touched(place), touched(other)
            yield place, other


@given(plans(), st.data())
def test_all_unordered_pairs_with_something_in_common_are_found_once_and_in_order(
    plan: Plan, data: st.DataObject
) -> None:
    order = Precedence(plan)
    touched = [Touched(data.draw(keys), data.draw(keys)) for _ in plan.steps]
    meeting = [
        (one, other)
        for one, other in every(order, touched.__getitem__)
        if touched[one].changed & touched[other].exposed or touched[one].exposed & touched[other].changed
    ]
    assert list(pairs(order, touched.__getitem__)) == meeting


@given(posed())
@SOME
def test_the_checker_tells_of_the_same_conflicts_as_with_all_pairs(given: tuple[Problem, Plan]) -> None:
    found = validate(*given)
    with patch("engine.stages.validation.interference.pairs", every):
        assert validate(*given) == found


def test_parallel_steps_that_touch_nothing_common_are_no_pairs_and_a_sequence_asks_for_no_step() -> None:
    parallel = Plan(tuple(Step(StepId(n), Function("s")) for n in range(1, 301)))
    touched = [Touched(frozenset([n]), frozenset([n])) for n in range(300)]
    assert not list(pairs(Precedence(parallel), touched.__getitem__))
    sequence = Plan(
        tuple(Step(StepId(n), Function("s"), (StepId(n - 1),) if n > 1 else ()) for n in range(1, 301))
    )
    assert not list(pairs(Precedence(sequence), [].__getitem__))
