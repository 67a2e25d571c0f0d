"""Tours, proofs and bounds with tools, stations, phases, precedence and ends, against all orders
of few visits.
"""

import itertools
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.tour_problem import (
    Metric,
    PoseProblem,
    Tour,
    TourProblem,
    Visit,
    cost_of,
    tour_violations,
)
from cellwright.engine.stages.sequencing import (
    TourLimits,
    farthest,
    phased_tours,
    sequence_tour,
    tour_solver,
)
from cellwright.engine.stages.sequencing.pose_tours import pose_tour_bound, pose_tour_time
from cellwright.engine.stages.sequencing.subset_orders import least_order_of

QUICK = TourLimits(work=50)
seeds = st.integers(0, 10**9)


def drawn_tour(seed: int, least: int, most: int) -> TourProblem:
    """Visits in the plane, on a line or anywhere, with a random choice of all conditions."""
    chance = random.Random(seed)
    n, phases = chance.randint(least, most), chance.choice([1, 1, 2, 3])
    visits = tuple(
        Visit(
            str(number),
            tool=chance.choice("abc"),
            station=chance.choice("xy"),
            phase=chance.randrange(phases),
        )
        for number in range(n)
    )
    changes = {pair: chance.randint(0, 15) for pair in itertools.permutations("abc", 2) if seed % 3}
    if chance.random() < 0.7:
        changes = {(a, b): changes[min((a, b), (b, a))] for a, b in changes}
    order = chance.sample(range(n), n)
    pairs = itertools.combinations(order, 2) if chance.random() < 0.3 else ()
    start, end = (chance.choice([None, None, chance.randrange(n)]) for _ in range(2))
    return TourProblem(
        "drawn",
        visits,
        drawn_travel(chance, n),
        chance.random() < 0.5,
        start,
        end,
        changes,
        tuple(pair for pair in pairs if chance.random() < 0.2),
        shifts={("x", "y"): 5, ("y", "x"): 5} if chance.random() < 0.3 else {},
    )


def drawn_travel(chance: random.Random, n: int) -> Metric | np.ndarray:
    if chance.random() < 0.6:
        flat = chance.random() < 0.4
        points = [(chance.randint(0, 9), 0 if flat else chance.randint(0, 9)) for _ in range(n)]
        kind = chance.choice(sorted(farthest.EXACT))
        return Metric(kind, np.array(points, float) / chance.choice([1, 3]))
    travel = np.array([[chance.randint(0, 20) for _ in range(n)] for _ in range(n)], np.int64)
    np.fill_diagonal(travel, 0)
    return np.minimum(travel, travel.T) if chance.random() < 0.7 else travel


def least_cost(problem: TourProblem) -> int | None:
    """The least cost of all orders that keep all conditions, from visit to visit; None if there
    are none.
    """
    n, arcs = len(problem.visits), problem.arcs.tolist()
    phases = [visit.phase for visit in problem.visits]
    before = [
        {a for a, later in problem.precedence if later == b}
        | {a for a in range(n) if phases[a] < phases[b]}
        for b in range(n)
    ]
    costs = []
    for first in range(n) if problem.start is None else [problem.start]:
        ways = {(frozenset({first}), first): 0} if not before[first] else {}
        for size in range(1, n):
            longer: dict[tuple[frozenset[int], int], int] = {}
            for (seen, at), cost in ways.items():
                for to in set(range(n)) - seen:
                    if before[to] <= seen and (to != problem.end or size == n - 1):
                        key, whole = (seen | {to}, to), cost + arcs[at][to]
                        longer[key] = min(whole, longer.get(key, whole))
            ways = longer
        costs += [
            cost + (arcs[at][first] if problem.closed and n > 1 else 0)
            for (_, at), cost in ways.items()
            if problem.end in (None, at)
        ]
    return min(costs, default=None)


def check_tour(problem: TourProblem, tour: object) -> None:
    """A tour that keeps all conditions, and no order costs less than its bound."""
    least = least_cost(problem)
    if least is None:
        assert isinstance(tour, Infeasible)
        return
    assert isinstance(tour, Tour)
    assert tour_violations(problem, tour.order) == []
    assert tour.lower_bound <= least <= tour.cost == cost_of(problem, tour.order)


@settings(max_examples=60, deadline=None)
@given(seeds)
def test_few_visits_are_ordered_for_the_least_cost(seed: int) -> None:
    problem = drawn_tour(seed, 1, 6)
    tour = sequence_tour(problem, QUICK)
    check_tour(problem, tour)
    assert isinstance(tour, Infeasible) or (isinstance(tour, Tour) and tour.proved)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_subsets_give_the_least_order(seed: int) -> None:
    problem = drawn_tour(seed, 1, 7)
    order = least_order_of(problem)
    least = least_cost(problem)
    assert (order[0] if order else None) == least
    assert order is None or tour_violations(problem, order[1]) == []
    assert order is None or cost_of(problem, order[1]) == least


@settings(max_examples=12, deadline=None)
@given(seeds, st.sampled_from([0, 3_000]), st.sampled_from([0.0, 2.0]))
def test_no_bound_of_a_search_is_above_the_least_cost(seed: int, few: int, proof: float) -> None:
    problem = drawn_tour(seed, 8, 9)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tour_solver, "MAX_EXACT_VISITS", 7)
        patch.setattr(tour_solver, "MAX_SUBSET_VISITS", 0)
        patch.setattr(farthest, "FEW", few)
        check_tour(problem, sequence_tour(problem, TourLimits(work=50, proof=proof)))


@settings(max_examples=40, deadline=None)
@given(seeds, st.sampled_from([0, 3_000]))
def test_no_order_costs_less_than_the_bound_by_far_places(seed: int, few: int) -> None:
    problem = drawn_tour(seed, 2, 6)
    least = least_cost(problem)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(farthest, "FEW", few)
        assert least is None or farthest.farthest(problem) <= least


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("phases", [1, 3])
@pytest.mark.parametrize("shape", ["line", "corner"])
def test_points_on_few_lines_are_nearly_proved(shape: str, phases: int, closed: bool) -> None:
    along = np.random.default_rng(phases).integers(0, 10_000, 60)
    across = np.arange(60) % 2 if shape == "corner" else np.zeros(60, int)
    points = np.stack([np.where(across, 0, along), np.where(across, along, 0)], 1).astype(float)
    visits = tuple(Visit(str(n), tool="ab"[n % 2], phase=n % phases) for n in range(60))
    changes = {("a", "b"): 3000, ("b", "a"): 3000} if phases == 1 else {}
    problem = TourProblem("lines", visits, Metric("rounded", points), closed, changes=changes)
    tour = sequence_tour(problem, TourLimits(work=200, proof=0.0))
    assert isinstance(tour, Tour)
    assert tour.gap < 0.12


def test_a_precedence_against_the_phases_has_no_tour() -> None:
    visits = (Visit("early", phase=1), Visit("late", phase=2))
    travel = np.array([[0, 1], [1, 0]], np.int64)
    answer = sequence_tour(TourProblem("t", visits, travel, precedence=((1, 0),)))
    assert isinstance(answer, Infeasible)
    assert "phases" in answer.reason


def test_a_closed_tour_in_phases_is_found_at_once_from_a_given_visit() -> None:
    chance = np.random.default_rng(2)
    points = chance.integers(0, 1000, (12, 2)).astype(float)
    visits = tuple(Visit(str(n), phase=n % 2) for n in range(12))
    problem = TourProblem("t", visits, Metric("rounded", points), True, 4)
    opened, way_back = phased_tours._cut_at_ends(problem)
    assert (len(opened.visits), opened.end, opened.closed, way_back) == (13, 12, False, 0)
    tour = sequence_tour(problem, TourLimits(work=200))
    assert isinstance(tour, Tour)
    assert tour.order[0] == 4
    assert tour.proved


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 5), seeds)
def test_no_tour_by_poses_is_faster_than_its_bound(n: int, seed: int) -> None:
    chance = np.random.default_rng(seed)
    poses = tuple(chance.uniform(-3, 3, (int(chance.integers(1, 4)), 2)) for _ in range(n))
    visits = tuple(Visit(str(number)) for number in range(n))
    problem = PoseProblem("drawn", visits, poses, np.array([1.0, 2.0]))
    least = min(
        pose_tour_time(problem, (0, *rest), choice)
        for rest in itertools.permutations(range(1, n))
        for choice in itertools.product(*(range(len(poses[visit])) for visit in (0, *rest)))
    )
    assert pose_tour_bound(problem, 10**9) <= 1e6 * least + 1e-6
