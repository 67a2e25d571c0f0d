"""Test selection against brute force, worked cases, and the laws of beliefs and trees."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.troubleshooting import (
    Conclude,
    Conclusion,
    Tree,
    Troubleshooting,
    Try,
    expected_cost,
)
from cellwright.engine.stages.diagnosis import search_arrays
from cellwright.engine.stages.diagnosis.action_selection import (
    BASE_RULES,
    ActionSelector,
    BranchAndBound,
)
from cellwright.engine.stages.diagnosis.hidden_cause import simulated_cost
from tests.engine.stages.diagnosis.fault_cases import (
    brute_force,
    certain,
    each_alone,
    isolations,
    names,
    troubles,
    uncertain,
)

SIGNATURES = ("00000", "01001", "00110", "10011", "11000", "11110")


def six_states() -> Troubleshooting:
    """Six states, five tests of cost 1."""
    rows = [tuple(int(signature[test]) for signature in SIGNATURES) for test in range(5)]
    tests = tuple(certain(f"t{i + 1}", 1.0, row) for i, row in enumerate(rows))
    return Troubleshooting(names(6), (0.70, 0.01, 0.02, 0.10, 0.05, 0.12), tests, each_alone(6))


def four_repairs() -> Troubleshooting:
    """Three causes, four repairs, each cheaper than the next and less sure."""
    cures = ((1.0, 0.0, 0.0), (0.0, 0.95, 0.0), (0.99, 0.99, 0.0), (1.0, 1.0, 1.0))
    costs = (1.0, 2.0, 25.0, 500.0)
    repairs = [
        uncertain(f"a{i + 1}", cost, cure, frozenset({0}))
        for i, (cost, cure) in enumerate(zip(costs, cures, strict=True))
    ]
    return Troubleshooting(names(3), (0.80, 0.15, 0.05), tuple(repairs))


def test_the_six_state_table_costs_2_18_and_begins_with_the_second_test() -> None:
    selector = ActionSelector(six_states())
    advice = selector.advise(selector.start())
    assert advice.expected_cost == pytest.approx(2.18)
    assert (advice.action, advice.optimal) == (1, True)
    assert expected_cost(selector.tree()) == pytest.approx(2.18)


def test_the_second_and_the_fourth_test_tie() -> None:
    selector = ActionSelector(six_states())
    costs = {
        action: cost for action, cost, _ in selector.compare(selector.start(), (0, 1, 2, 3, 4))
    }
    assert costs[1] == pytest.approx(costs[3])
    assert min(costs[0], costs[2], costs[4]) > costs[1] + 0.1


def test_the_four_repairs_cost_27_875_in_the_order_of_their_numbers() -> None:
    selector = ActionSelector(four_repairs())
    tree, order = selector.tree(), []
    assert expected_cost(tree) == pytest.approx(27.875)
    while isinstance(tree, Try):
        order.append(tree.action)
        tree = tree.branches[-1][1]
    assert order == [0, 1, 2, 3]


def test_p_over_c_is_optimal_for_independent_repairs() -> None:
    selector = ActionSelector(four_repairs())
    assert expected_cost(selector.tree(choose=selector.rule("p/c"))) == pytest.approx(27.875)


@settings(max_examples=150, deadline=None)
@given(isolations())
def test_sets_of_causes_are_searched_exactly(problem: Troubleshooting) -> None:
    selector = ActionSelector(problem)
    assert isinstance(selector.exact, BranchAndBound)
    assert selector.exact.partition is not None
    advice = selector.advise(selector.start())
    assert advice.optimal
    assert advice.expected_cost == pytest.approx(brute_force(problem))
    assert expected_cost(selector.tree()) == pytest.approx(advice.expected_cost)


@settings(max_examples=150, deadline=None)
@given(troubles(), st.booleans())
def test_beliefs_are_searched_exactly(problem: Troubleshooting, bounded: bool) -> None:
    selector = ActionSelector(problem)
    if bounded:
        selector.exact = BranchAndBound(selector.exact.beliefs, None)
    advice = selector.advise(selector.start())
    assert advice.optimal
    assert advice.expected_cost == pytest.approx(brute_force(problem))
    assert expected_cost(selector.tree()) == pytest.approx(advice.expected_cost)


@settings(max_examples=100, deadline=None)
@given(isolations(5) | troubles())
def test_a_spent_budget_leaves_a_true_bound_and_a_cost_that_is_reached(
    problem: Troubleshooting,
) -> None:
    selector, optimum = ActionSelector(problem, expansions=1), brute_force(problem)
    advice = selector.advise(selector.start())
    assert advice.bound <= optimum + 1e-9
    reached = expected_cost(selector.tree())
    assert optimum - 1e-9 <= reached <= advice.expected_cost + 1e-9


@settings(max_examples=60, deadline=None)
@given(isolations() | troubles())
def test_no_rule_is_cheaper_than_the_optimum(problem: Troubleshooting) -> None:
    selector = ActionSelector(problem)
    optimum = selector.advise(selector.start()).expected_cost
    for name in BASE_RULES:
        assert expected_cost(selector.tree(choose=selector.rule(name))) >= optimum - 1e-9


@settings(max_examples=60, deadline=None)
@given(isolations() | troubles())
def test_the_probabilities_of_the_leaves_sum_to_one(problem: Troubleshooting) -> None:
    assert math.fsum(
        leaf.probability for leaf in _leaves(ActionSelector(problem).tree())
    ) == pytest.approx(1.0)


@settings(max_examples=20, deadline=None)
@given(isolations() | troubles())
def test_the_expected_cost_is_the_mean_of_simulated_cases(problem: Troubleshooting) -> None:
    tree = ActionSelector(problem).tree()
    costs = [simulated_cost(problem, tree, random.Random(seed)) for seed in range(2000)]
    mean = sum(costs) / len(costs)
    deviation = math.sqrt(sum((cost - mean) ** 2 for cost in costs) / len(costs))
    assert abs(mean - expected_cost(tree)) <= 5.0 * deviation / math.sqrt(len(costs)) + 1e-9


def test_causes_that_share_a_conclusion_are_not_told_apart() -> None:
    tests = (certain("dear", 9.0, (0, 1, 0)), certain("cheap", 1.0, (0, 0, 1)))
    both = Conclusion("0 or 1", (0.0, 0.0, math.inf))
    problem = Troubleshooting(names(3), (0.5, 0.3, 0.2), tests, (*each_alone(3), both))
    selector = ActionSelector(problem)
    tree = selector.tree()
    assert expected_cost(tree) == pytest.approx(1.0)
    assert {leaf.conclusion for leaf in _leaves(tree)} == {2, 3}


def test_an_observation_that_no_cause_explains_leaves_no_cause() -> None:
    selector = ActionSelector(six_states())
    standing = selector.observe(selector.start(), 1, 0)
    for test, outcome in ((0, 1), (2, 0), (4, 0)):
        standing = selector.observe(standing, test, outcome)
    assert standing.possible == 0


def _leaves(tree: Tree) -> list[Conclude]:
    if isinstance(tree, Conclude):
        return [tree]
    return [leaf for _, branch in tree.branches for leaf in _leaves(branch)]


@settings(max_examples=40, deadline=None)
@given(isolations(6) | troubles())
def test_neither_a_small_table_nor_short_slices_change_the_optimum(
    problem: Troubleshooting,
) -> None:
    cramped = ActionSelector(problem)
    beliefs = cramped.exact.beliefs
    cramped.exact = BranchAndBound(
        beliefs, search_arrays.cause_set_arrays(problem, beliefs), length=1 << 6
    )
    weights, rest = search_arrays.prior_weights(problem), 0
    value, proved = cramped.exact.value(weights, rest, math.inf, 100_000)
    assert proved
    assert value == pytest.approx(brute_force(problem))
    assert cramped.exact.table.length >= 1 << 6


@settings(max_examples=15, deadline=None)
@given(isolations(5))
def test_a_search_that_is_interrupted_leaves_a_true_bound(problem: Troubleshooting) -> None:
    stopped = ActionSelector(problem, interrupted=lambda: True)
    advice = stopped.advise(stopped.start())
    assert advice.bound <= brute_force(problem) + 1e-9
    assert advice.bound <= advice.expected_cost + 1e-9
