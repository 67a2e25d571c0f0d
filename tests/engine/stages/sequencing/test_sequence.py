"""Every option of a tour problem combined, against all permutations."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.tour_problem import Tour, TourProblem, Visit, cost_of, tour_violations
from cellwright.engine.stages.sequencing import TourLimits, sequence_tour
from cellwright.engine.stages.sequencing.directed_bounds import directed_lower_bound

QUICK = TourLimits(work=3000)


@st.composite
def problems(draw: st.DrawFn, least: int = 1, most: int = 6) -> TourProblem:
    """Small problems with any mixture of options."""
    n = draw(st.integers(least, most))
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    travel = rng.integers(0, 50, (n, n))
    if draw(st.booleans()):
        travel = travel + travel.T
    np.fill_diagonal(travel, 0)
    windows = [None] * n
    if draw(st.booleans()):
        early = rng.integers(0, 60, n)
        windows = [
            (int(a), int(a + w)) if rng.random() < 0.6 else None
            for a, w in zip(early, rng.integers(20, 200, n), strict=True)
        ]
    tools = (
        [str(rng.choice(["probe", "laser"])) for _ in range(n)] if draw(st.booleans()) else [""] * n
    )
    visits = tuple(
        Visit(
            f"v{i}", None, tools[i], int(rng.integers(0, 9)) * (windows[i] is not None), windows[i]
        )
        for i in range(n)
    )
    ends = st.none() | st.integers(0, n - 1)
    pairs = st.lists(
        st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)).filter(lambda p: p[0] != p[1]),
        max_size=3,
    )
    return TourProblem(
        "drawn",
        visits,
        travel.astype(np.int64),
        draw(st.booleans()),
        draw(ends),
        draw(ends),
        {("probe", "laser"): 30, ("laser", "probe"): draw(st.sampled_from([30, 7]))}
        if any(tools)
        else {},
        tuple(draw(pairs)) if n > 1 and draw(st.booleans()) else (),
    )


def least_cost(problem: TourProblem) -> int | None:
    """What the best of all permutations costs; None if none keeps what the problem says."""
    n = len(problem.visits)
    costs = [
        cost_of(problem, order)
        for order in itertools.permutations(range(n))
        if not tour_violations(problem, order)
    ]
    return min(costs, default=None)


@settings(max_examples=150, deadline=None)
@given(problems())
def test_small_problems_of_every_kind_are_solved_as_all_permutations_say(
    problem: TourProblem,
) -> None:
    answer = sequence_tour(problem, QUICK)
    least = least_cost(problem)
    if least is None:
        assert isinstance(answer, Infeasible)
    else:
        assert isinstance(answer, Tour)
        assert tour_violations(problem, answer.order) == []
        assert answer.cost == cost_of(problem, answer.order) == least
        assert answer.proved


@settings(max_examples=150, deadline=None)
@given(problems(2))
def test_no_order_that_keeps_the_conditions_costs_less_than_the_bound(problem: TourProblem) -> None:
    least = least_cost(problem)
    if least is not None:
        assert directed_lower_bound(problem, least + 1000) <= least


def test_bounds_are_near_where_conditions_leave_few_orders() -> None:
    problem = in_windows(60, 11, 150)
    answer = sequence_tour(problem, TourLimits(proof=0))
    assert isinstance(answer, Tour)
    assert answer.gap < 0.05


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(problems(7, 8))
def test_up_to_eight_visits_are_solved_as_all_permutations_say(problem: TourProblem) -> None:
    test_small_problems_of_every_kind_are_solved_as_all_permutations_say.hypothesis.inner_test(
        problem
    )  # type: ignore[attr-defined]


def points(n: int, seed: int, **options: object) -> TourProblem:
    """Visits at random points of a square, by straight lines."""
    where = np.random.default_rng(seed).integers(0, 1000, (n, 2))
    travel = np.rint(np.hypot(*(where[:, None] - where[None]).transpose(2, 0, 1))).astype(np.int64)
    visits = tuple(Visit(f"p{i}", (float(x), float(y))) for i, (x, y) in enumerate(where))
    return replace(TourProblem("square", visits, travel), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("ends", list(itertools.product((True, False), (None, 3), (None, 7))))
def test_ends_are_kept_and_the_bound_lies_below_the_cost(
    ends: tuple[bool, int | None, int | None],
) -> None:
    problem = points(40, 2, closed=ends[0], start=ends[1], end=ends[2])
    answer = sequence_tour(problem, QUICK)
    assert isinstance(answer, Tour)
    assert tour_violations(problem, answer.order) == []
    assert answer.lower_bound <= answer.cost == cost_of(problem, answer.order)
    assert answer.gap < 0.02


def test_open_tours_cost_no_more_than_closed_ones_without_their_dearest_arc() -> None:
    closed, opened = (sequence_tour(points(60, 4, closed=each), QUICK) for each in (True, False))
    assert isinstance(closed, Tour)
    assert isinstance(opened, Tour)
    arcs = points(60, 4).travel
    dearest = max(
        int(arcs[a, b])
        for a, b in zip(closed.order, (*closed.order[1:], closed.order[0]), strict=True)
    )
    assert opened.cost <= closed.cost - dearest


def test_the_default_is_no_worse_than_the_chain_of_1987_and_both_respect_the_bound() -> None:
    problem = points(200, 1)
    ours, chain = sequence_tour(problem, QUICK), sequence_tour(problem, QUICK, "chain1987")
    assert isinstance(ours, Tour)
    assert isinstance(chain, Tour)
    assert max(ours.lower_bound, chain.lower_bound) <= ours.cost <= chain.cost


@pytest.mark.slow
def test_directed_costs_of_many_visits_are_improved_and_bounded() -> None:
    travel = np.random.default_rng(3).integers(1, 1000, (80, 80))
    np.fill_diagonal(travel, 0)
    problem = TourProblem(
        "directed", tuple(Visit(str(i)) for i in range(80)), travel.astype(np.int64)
    )
    answer = sequence_tour(problem, TourLimits(work=300_000))
    assert isinstance(answer, Tour)
    assert answer.lower_bound <= answer.cost < 3 * answer.lower_bound


def test_the_same_work_and_seed_give_the_same_tour() -> None:
    problem = points(150, 9)
    assert sequence_tour(problem, QUICK) == sequence_tour(problem, QUICK)


def test_an_interrupted_search_still_answers_with_a_tour() -> None:
    problem = points(300, 5)
    answer = sequence_tour(problem, TourLimits(interrupted=lambda: True))
    assert isinstance(answer, Tour)
    assert tour_violations(problem, answer.order) == []
    assert answer.work == 0


def in_windows(n: int, seed: int, width: int) -> TourProblem:
    """Visits with windows around the times at which the order by nearest neighbours reaches
    them.
    """
    problem = points(n, seed, closed=False, start=0)
    order, left = [0], set(range(1, n))
    while left:
        order.append(min(left, key=lambda visit: problem.travel[order[-1], visit]))
        left.remove(order[-1])
    clock = np.concatenate(([0], np.cumsum(problem.travel[order[:-1], order[1:]])))
    late = {
        visit: (max(0, int(time) - width), int(time) + width)
        for visit, time in zip(order, clock, strict=True)
    }
    visits = tuple(replace(visit, window=late[index]) for index, visit in enumerate(problem.visits))
    return replace(problem, visits=visits)


def test_windows_of_many_visits_are_kept_where_an_order_is_known_to_keep_them() -> None:
    problem = in_windows(60, 11, 150)
    answer = sequence_tour(problem, TourLimits(proof=0))
    assert isinstance(answer, Tour)
    assert tour_violations(problem, answer.order) == []


def test_precedence_of_many_visits_is_kept() -> None:
    rng = np.random.default_rng(5)
    pairs = tuple(tuple(sorted(map(int, rng.choice(70, 2, replace=False)))) for _ in range(70))
    problem = points(70, 3, precedence=pairs)
    answer = sequence_tour(problem, TourLimits(work=200_000, proof=0))
    assert isinstance(answer, Tour)
    assert tour_violations(problem, answer.order) == []
    assert answer.cost < 0.7 * cost_of(problem, tuple(range(70)))
