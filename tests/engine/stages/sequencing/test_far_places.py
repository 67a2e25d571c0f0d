"""The bound by two far places: never above the least tour, and the tour itself on a line."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.model.tour_problem import (
    Metric,
    Tour,
    TourProblem,
    Visit,
    cost_of,
    tour_violations,
)
from cellwright.engine.stages.sequencing import TourLimits, farthest, sequence_tour
from cellwright.engine.stages.sequencing.farthest import farthest as bound_of

KINDS = sorted(farthest.EXACT)
small = st.integers(0, 9)


@st.composite
def tours(draw: st.DrawFn) -> TourProblem:
    """Four or five visits with rounded distances, or with any costs; with ends or without."""
    count = draw(st.integers(2, 5))
    visits = tuple(Visit(str(number), tool=draw(st.sampled_from("ab"))) for number in range(count))
    places = st.tuples(small, small)
    travel: Metric | np.ndarray
    if draw(st.booleans()):
        points = draw(st.lists(places, min_size=count, max_size=count))
        travel = Metric(
            draw(st.sampled_from(KINDS)), np.array(points, float) / draw(st.sampled_from([1, 3]))
        )
    else:
        rows = st.lists(small, min_size=count, max_size=count)
        travel = np.array(draw(st.lists(rows, min_size=count, max_size=count)), np.int64)
        np.fill_diagonal(travel, 0)
    ends = st.none() | st.integers(0, count - 1)
    start, end = draw(ends), draw(ends)
    changes = {("a", "b"): draw(small), ("b", "a"): draw(small)} if draw(st.booleans()) else {}
    return TourProblem("t", visits, travel, draw(st.booleans()), start, end, changes)


@given(problem=tours(), few=st.sampled_from([0, 3_000]))
def test_no_tour_costs_less_than_the_bound(problem: TourProblem, few: int) -> None:
    orders = [
        o
        for o in itertools.permutations(range(len(problem.visits)))
        if not tour_violations(problem, o)
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(farthest, "FEW", few)
        least = bound_of(problem)
    assert all(least <= cost_of(problem, order) for order in orders)


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("start", [None, 7])
@pytest.mark.parametrize("kind", ["rounded", "micrometres"])
def test_a_tour_on_a_line_is_proved(kind: str, closed: bool, start: int | None) -> None:
    places = np.random.default_rng(3).integers(0, 10_000, 150)
    points = np.stack([places, np.full(150, 5)], 1).astype(float)
    visits = tuple(Visit(str(number)) for number in range(150))
    found = sequence_tour(
        TourProblem("line", visits, Metric(kind, points), closed, start), TourLimits(work=300)
    )
    assert isinstance(found, Tour)
    assert found.proved


@pytest.mark.parametrize("closed", [True, False])
def test_tours_of_coincident_points_have_a_bound(closed: bool) -> None:
    chance = np.random.default_rng(1)
    points = np.repeat(chance.integers(0, 10_000, (45, 2)), 4, 0).astype(float)
    visits = tuple(Visit(str(number)) for number in range(len(points)))
    found = sequence_tour(
        TourProblem("same", visits, Metric("rounded", points), closed), TourLimits(work=300)
    )
    assert isinstance(found, Tour)
    assert found.lower_bound > 0.9 * found.cost
