"""Tests that are not sure: the search between bounds, the certainty asked for, and repetitions
that are independent.
"""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.cancellation import Poll
from cellwright.engine.model.troubleshooting import (
    Action,
    Conclusion,
    Troubleshooting,
    expected_cost,
)
from cellwright.engine.stages.diagnosis import search_arrays
from cellwright.engine.stages.diagnosis.action_selection import ActionSelector
from cellwright.engine.stages.diagnosis.bracket_search import BracketSearch
from cellwright.engine.stages.diagnosis.pair_bounds import POINTS, RATIOS, pair_bounds
from tests.engine.stages.diagnosis.fault_cases import (
    COSTS,
    brute_force,
    each_alone,
    names,
    priors,
    setups,
    uncertain,
)

SOME = settings(max_examples=40, deadline=None)
SHOWS = st.sampled_from((0.05, 0.2, 0.4, 0.7, 0.9, 0.95))
CURES = st.sampled_from((0.0, 0.0, 0.6, 0.9, 1.0))


@st.composite
def unsure(draw: st.DrawFn, causes: int = 3, tests: int = 3) -> Troubleshooting:
    """Unsure tests, repairs that may fail or cure several causes, and a safe stop."""
    count = draw(st.integers(1, causes))
    shows, cures = (
        st.lists(each, min_size=count, max_size=count).map(tuple) for each in (SHOWS, CURES)
    )
    actions = [
        uncertain(f"t{n}", draw(COSTS), draw(shows)) for n in range(draw(st.integers(1, tests)))
    ]
    ends = frozenset({0})
    actions += [
        uncertain(f"r{n}", 2 * draw(COSTS), draw(cures), ends)
        for n in range(draw(st.integers(0, 2)))
    ]
    stop = Conclusion("stop", (draw(st.sampled_from((8.0, 40.0))),) * count)
    setup = draw(st.none() | setups(len(actions)))
    return Troubleshooting(names(count), draw(priors(count)), tuple(actions), (stop,), setup)


def bracketed(problem: Troubleshooting, expansions: int = 100_000) -> tuple[float, float, int]:
    search = BracketSearch(search_arrays.belief_arrays(problem), Poll())
    return search.bounds(search_arrays.prior_weights(problem), 0, math.inf, expansions)


@given(unsure())
@SOME
def test_the_bounds_meet_at_the_least_cost(problem: Troubleshooting) -> None:
    low, high, _ = bracketed(problem)
    assert low == pytest.approx(brute_force(problem))
    assert high == pytest.approx(low)


@given(unsure(), st.integers(0, 12))
@SOME
def test_bounds_hold_however_little_was_searched(problem: Troubleshooting, expansions: int) -> None:
    low, high, _ = bracketed(problem, expansions)
    assert low <= brute_force(problem) * (1 + 1e-9)
    assert high >= brute_force(problem) * (1 - 1e-9)


def test_a_sure_cause_is_mended_without_any_expansion() -> None:
    test = Action("look", 1.0, ("yes", "no"), ((0.05,), (0.95,)), frozenset(), None)
    repair = Action("mend", 2.0, ("yes", "no"), ((0.6,), (0.4,)), frozenset({0}), None)
    stop = Conclusion("stop", (8.0,))
    problem = Troubleshooting(("worn",), (1.0,), (test, repair), (stop,), None, 1.0)
    selector = ActionSelector(problem, 0)
    advice = selector.advise(selector.start())
    assert (advice.action, advice.expected_cost) == (1, pytest.approx(5.2))


@given(unsure(), st.integers(0, 4))
@SOME
def test_going_on_as_advised_costs_no_more_than_the_upper_bound(
    problem: Troubleshooting, expansions: int
) -> None:
    selector = ActionSelector(problem, expansions)
    selector.exact = BracketSearch(search_arrays.belief_arrays(problem), Poll())
    advice = selector.advise(selector.start())
    assert expected_cost(selector.tree()) <= advice.expected_cost * (1 + 1e-9)
    assert advice.bound <= brute_force(problem) * (1 + 1e-9)


@given(unsure(causes=2))
@SOME
def test_a_pair_costs_no_less_than_its_bound(problem: Troubleshooting) -> None:
    """At the ratio of some point, nothing tried yet."""
    if len(problem.causes) < 2:
        return
    bound = pair_bounds(search_arrays.belief_arrays(problem)).values[0, 0]
    for point in (POINTS // 3, POINTS // 2, POINTS - 20):
        total = RATIOS[point] + 1.0
        at = replace(problem, priors=(RATIOS[point] / total, 1.0 / total))
        assert bound[point] <= brute_force(at) * total * (1 + 1e-9)


def dynamic_program(problem: Troubleshooting) -> float:
    """The least expected cost over all sets of outcomes seen, as one table in a dictionary."""
    stop = problem.conclusions[0].losses[0]

    @cache
    def value(seen: tuple[int, ...]) -> float:
        weights = np.array(problem.priors)
        for action, digit in zip(problem.actions, seen, strict=True):
            weights = weights * (np.array(action.likelihoods[digit - 1]) if digit else 1.0)
        best = total = float(weights.sum())
        best *= stop
        for number, action in enumerate(problem.actions):
            if seen[number] or total <= 0.0:
                continue
            going = action.cost * total
            for outcome in range(len(action.outcomes)):
                if outcome not in action.ends:
                    going += value((*seen[:number], outcome + 1, *seen[number + 1 :]))
            best = min(best, going)
        return best

    return value((0,) * len(problem.actions))


@pytest.mark.parametrize("seed", range(6))
def test_a_case_of_six_unsure_tests_costs_what_the_dynamic_program_says(seed: int) -> None:
    chance = np.random.default_rng(seed)
    tests = [
        uncertain(f"t{n}", float(chance.integers(1, 9)), tuple(chance.uniform(0.05, 0.95, 2)))
        for n in range(4)
    ]
    ends = frozenset({0})
    repairs = [uncertain(f"r{n}", 20.0 + n, (float(n == 0), float(n == 1)), ends) for n in range(2)]
    problem = Troubleshooting(
        names(2), (0.6, 0.4), (*tests, *repairs), (Conclusion("stop", (300.0,) * 2),)
    )
    low, high, _ = bracketed(problem)
    assert low == pytest.approx(dynamic_program(problem))
    selector = ActionSelector(problem)
    assert expected_cost(selector.tree()) == pytest.approx(low)
    assert high == pytest.approx(low)


def repeated(test: Action, times: int) -> tuple[Action, ...]:
    """A test and its independent repetitions."""
    return tuple(replace(test, repeats=n - 1 if n else None) for n in range(times))


@given(unsure(causes=2, tests=1), st.integers(2, 3))
@SOME
def test_repetitions_are_worth_what_as_many_tests_of_one_kind_are(
    problem: Troubleshooting, times: int
) -> None:
    test, *others = problem.actions
    apart = replace(problem, actions=(*(test,) * times, *others), setup=None)
    joined = replace(problem, actions=(*repeated(test, times), *others), setup=None)
    assert bracketed(joined)[1] == pytest.approx(brute_force(apart))
    assert expected_cost(ActionSelector(joined).tree()) == pytest.approx(brute_force(apart))


def test_the_order_of_outcomes_of_repetitions_does_not_matter() -> None:
    test = uncertain("look", 1.0, (0.9, 0.2))
    problem = Troubleshooting(names(2), (0.5, 0.5), repeated(test, 3), each_alone(2, 50.0))
    selector = ActionSelector(problem)
    ends = set()
    for outcomes in ((0, 1, 1), (1, 0, 1), (1, 1, 0)):
        standing = selector.start()
        for action, outcome in enumerate(outcomes):
            standing = selector.observe(standing, action, outcome)
        ends.add(standing)
    assert len(ends) == 1


def test_a_cause_is_concluded_when_it_is_likely_enough() -> None:
    test = uncertain("look", 1.0, (0.95, 0.05))
    stop = Conclusion("stop", (100.0, 100.0))
    for asked, cost in ((0.95, 1.0), (0.96, 100.0), (0.5, 0.0)):
        problem = Troubleshooting(
            names(2), (0.5, 0.5), (test,), (*each_alone(2), stop), certainty=asked
        )
        assert expected_cost(ActionSelector(problem).tree()) == pytest.approx(cost)
