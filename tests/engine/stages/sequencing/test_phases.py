"""Tours in phases keep them, and are bounded from below."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.tour_problem import Tour, TourProblem, Visit, cost_of, tour_violations
from cellwright.engine.stages.sequencing import TourLimits, sequence_tour
from cellwright.engine.stages.sequencing.phased_tours import by_phases

QUICK = TourLimits(work=50, proof=1.0)


def problem(phases: list[int], seed: int = 0, **ends: object) -> TourProblem:
    places = np.random.default_rng(seed).integers(0, 1000, (len(phases), 2))
    travel = np.rint(np.linalg.norm(places[:, None] - places[None], axis=2)).astype(np.int64)
    visits = tuple(Visit(f"v{n}", phase=phase) for n, phase in enumerate(phases))
    return TourProblem("phases", visits, travel, **ends)  # type: ignore[arg-type]


def solved(asked: TourProblem) -> Tour:
    found = sequence_tour(asked, QUICK)
    assert isinstance(found, Tour)
    assert tour_violations(asked, found.order) == []
    assert found.cost == cost_of(asked, found.order)
    assert found.lower_bound <= found.cost
    return found


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(-2, 0), min_size=1, max_size=7), st.booleans(), st.integers(0, 5))
def test_few_visits_in_phases_are_ordered_as_well_as_by_trying_all(
    phases: list[int], closed: bool, seed: int
) -> None:
    asked = problem(phases, seed, closed=closed)
    orders = (
        order for order in permutations(range(len(phases))) if not tour_violations(asked, order)
    )
    assert solved(asked).cost == min(cost_of(asked, order) for order in orders)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(-2, 0), min_size=2, max_size=7), st.integers(0, 5))
def test_the_bound_of_phases_one_after_another_is_not_above_the_least_cost(
    phases: list[int], seed: int
) -> None:
    asked = problem(phases, seed, closed=False)
    orders = (
        order for order in permutations(range(len(phases))) if not tour_violations(asked, order)
    )
    least = min(cost_of(asked, order) for order in orders)
    found = by_phases(asked, QUICK, "auto", sequence_tour)
    assert isinstance(found, Tour)
    assert found.lower_bound <= least <= found.cost


@pytest.mark.parametrize("closed", [True, False])
def test_many_visits_keep_their_phases(closed: bool) -> None:
    asked = problem([-2] * 10 + [0] * 60 + [-1] * 15, closed=closed)
    assert [asked.visits[each].phase for each in solved(asked).order] == [-2] * 10 + [-1] * 15 + [
        0
    ] * 60


def test_ends_that_contradict_the_phases_are_refused() -> None:
    for ends in ({"start": 0}, {"end": 1}):
        found = sequence_tour(problem([0, -1] + [0] * 10, closed=False, **ends), QUICK)
        assert isinstance(found, Infeasible)


def test_an_end_within_its_phase_is_kept() -> None:
    order = solved(problem([-1, -1] + [0] * 10, closed=False, start=1, end=5)).order
    assert (order[0], order[-1]) == (1, 5)


def test_phases_hold_together_with_precedence() -> None:
    asked = problem([-1] * 5 + [0] * 10, closed=False, precedence=((4, 0), (9, 6)))
    solved(asked)


def test_phases_are_searched_together_where_they_meet_is_chosen_with_all_tours() -> None:
    asked = problem([-1] * 12 + [0] * 14, seed=3, closed=False)
    alone = by_phases(asked, TourLimits(), "auto", sequence_tour)
    found = sequence_tour(asked, TourLimits())
    assert isinstance(alone, Tour)
    assert isinstance(found, Tour)
    assert tour_violations(asked, found.order) == []
    assert found.cost <= alone.cost
    assert found.lower_bound >= alone.lower_bound
    assert found.proved


@settings(max_examples=15, deadline=None)
@given(st.integers(4, 8), st.integers(4, 8), st.integers(1, 4), st.integers(0, 9))
def test_the_bound_of_phases_together_is_not_above_a_tour_in_phases(
    a: int, b: int, c: int, seed: int
) -> None:
    asked = problem([-2] * a + [-1] * b + [0] * c, seed, closed=False)
    alone = by_phases(asked, QUICK, "auto", sequence_tour)
    assert isinstance(alone, Tour)
    assert solved(asked).lower_bound <= alone.cost
