"""How far a rollout looks in problems of different sizes, and what the searches keep apart."""

import math
from dataclasses import replace

import pytest

from cellwright.engine.kernels.cancellation import Poll
from cellwright.engine.model.troubleshooting import Action, Conclusion, Setup, Troubleshooting
from cellwright.engine.stages.diagnosis import action_selection, search_arrays
from cellwright.engine.stages.diagnosis.action_selection import (
    BASE_RULES,
    ActionSelector,
    BranchAndBound,
    ValueTable,
)
from tests.engine.stages.diagnosis.fault_cases import (
    brute_force,
    certain,
    each_alone,
    names,
    uncertain,
)


def sized(causes: int, sure: int, unsure: int = 0) -> Troubleshooting:
    """So many causes, tests that tell one cause from all others, and uncertain tests."""
    tests = [
        certain(f"t{n}", 1.0, tuple(int(c == n % causes) for c in range(causes)))
        for n in range(sure)
    ]
    guesses = [
        uncertain(f"g{n}", 1.0, tuple(0.1 + 0.8 * ((c + n) % 2) for c in range(causes)))
        for n in range(unsure)
    ]
    return Troubleshooting(
        names(causes), (1 / causes,) * causes, (*tests, *guesses), each_alone(causes)
    )


def reached(problem: Troubleshooting, share: float = 1.0) -> tuple[int, int, float]:
    """The steps of the lookahead, how many actions it tries, and the weight of branches that it
    leaves.
    """
    selector = ActionSelector(problem, 0)
    selector.groups.limit(0, 9.0)
    weights, rest = selector._state(selector.start())
    return selector._reach(share * weights, rest), selector.groups.width, selector.groups.least


@pytest.mark.parametrize(("tests", "steps"), [(4, 3), (10, 3), (11, 2), (21, 2)])
def test_of_few_actions_a_rollout_tries_all(tests: int, steps: int) -> None:
    """Twenty outcomes to the third power are at most 10,000 leaves; 42 outcomes are few."""
    assert reached(sized(24, tests)) == (steps, tests, 0.0)


def test_of_more_actions_it_tries_those_for_which_there_is_time() -> None:
    """Two steps over w actions have (2 w)^2 / 4 leaves of `node * nodes` nanoseconds each, in
    0.3 s.
    """
    causes, tests = 200, 100
    node = len(BASE_RULES) * causes * 2 * 0.2 * tests
    leaf = node * 8 * math.log2(causes + 1)
    steps, width, least = reached(sized(causes, tests))
    assert (steps, least) == (2, 0.0)
    assert (
        (2 * width) ** 2 / 4 * leaf
        <= action_selection.ROLLOUT_NS
        < (2 * (width + 1)) ** 2 / 4 * leaf
    )
    assert width < tests


def test_it_tries_no_more_actions_than_there_are() -> None:
    assert reached(sized(30, 22)) == (2, 22, 0.0)


def test_with_many_uncertain_tests_it_tries_one_and_leaves_what_is_unlikely() -> None:
    """Each uncertain test doubles what can be seen: of 2^30 ways those are followed that have
    some weight.
    """
    node = len(BASE_RULES) * 10 * 2 * (0.2 + 10.0) * 30
    for share in (1.0, 0.5):
        steps, width, least = reached(sized(10, 0, 30), share)
        assert (steps, width) == (1, 1)
        assert least == pytest.approx(share * 8 * node / action_selection.ROLLOUT_NS)


def test_one_step_is_looked_ahead_where_there_is_time_for_a_few_actions_only() -> None:
    """Each of seven leaves takes 42 ms, with three outcomes of an action: one step over two
    actions.
    """
    problem = sized(20, 10, 11)
    third = certain("third", 1.0, tuple(n % 3 for n in range(20)))
    steps, width, least = reached(replace(problem, actions=(third, *problem.actions)))
    leaf = len(BASE_RULES) * 20 * 3 * (0.2 * 22 + 10.0 * 11) * 2**11
    assert (steps, least) == (1, 0.0)
    assert width == int(action_selection.ROLLOUT_NS / leaf / 3) == 2


def test_an_interrupted_table_of_values_knows_what_each_cause_costs_at_least() -> None:
    guess = uncertain("guess", 1.0, (0.5, 0.25))
    conclusions = (Conclusion("ask", (3.0, 4.0)), Conclusion("leave", (9.0, 2.0)))
    problem = Troubleshooting(names(2), (0.75, 0.25), (guess,), conclusions)
    table = ValueTable(search_arrays.belief_arrays(problem), problem, Poll(lambda: True))
    assert table.value(search_arrays.prior_weights(problem), 0, math.inf, 1) == (
        0.75 * 3.0 + 0.25 * 2.0,
        False,
    )


@pytest.mark.parametrize("turned", [False, True])
def test_the_same_causes_elsewhere_are_another_state(turned: bool) -> None:
    """Two tests tell the same, each in a place of its own; what tells the rest is far from one
    of them.
    """
    here, there = certain("here", 1.0, (0, 1, 1)), certain("there", 1.5, (0, 1, 1))
    actions: tuple[Action, ...] = (here, there, certain("rest", 1.0, (0, 0, 1)))
    costs, following = ((0.0, 0.0, 9.0), (0.0, 5.0, 5.0), (5.0, 0.0, 0.0)), ((1, 2, 2),) * 3
    if turned:
        actions, costs = (
            (there, here, actions[2]),
            ((0.0, 0.0, 9.0), (0.0, 5.0, 0.0), (5.0, 0.0, 5.0)),
        )
    problem = Troubleshooting(
        names(3), (0.1, 0.45, 0.45), actions, each_alone(3), Setup(costs, following)
    )
    search = action_selection.make_searcher(
        problem, search_arrays.belief_arrays(problem), 100_000, Poll()
    )
    assert isinstance(search, BranchAndBound)
    value, proved = search.value(search_arrays.prior_weights(problem), 0, math.inf, 100_000)
    assert (value, proved) == (pytest.approx(brute_force(problem)), True)
