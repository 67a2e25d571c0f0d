"""Many visits: metrics without a matrix, merged tours, and bounds that see few edges, against
plain versions.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from cellwright.engine.model.outcome import GaveUp
from cellwright.engine.model.tour_problem import (
    METRIC_KINDS,
    Metric,
    Tour,
    TourProblem,
    Visit,
    cost_of,
    tour_violations,
)
from cellwright.engine.stages.sequencing import (
    TourLimits,
    city_costs,
    held_karp_bound,
    kernels,
    sequence_tour,
    symmetric_tours,
)
from cellwright.engine.stages.sequencing.city_costs import CityCosts, of_matrix
from cellwright.engine.stages.sequencing.first_tours import along_hilbert
from cellwright.engine.stages.sequencing.kernels import bounds, distances, graphs, trees
from tests.engine.interpreted import interpreted_package

PLAIN = interpreted_package(kernels)
seeds = st.integers(0, 10**6)
KERNELS = sorted(distances.METRICS)


def scattered(n: int, seed: int, dimensions: int = 2) -> np.ndarray:
    """Points of which some lie at the same place and some on half units."""
    return np.random.default_rng(seed).integers(-40, 40, (n, dimensions)) / 2.0


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(KERNELS), seeds, st.integers(2, 3))
def test_kernels_compute_the_costs_that_the_metric_says(
    kind: str, seed: int, dimensions: int
) -> None:
    points = scattered(12, seed, 2 if kind == "pseudo_euclidean" else dimensions)
    if kind == "micrometres":
        points = points * 1e-3
    rng = np.random.default_rng(seed)
    group, extra = rng.integers(0, 2, 12).astype(np.int32), np.array([[0, 7], [7, 0]])
    ends = rng.integers(0, 99, 13)
    costs = CityCosts(None, Metric(kind, points), group, extra, ends)
    every = np.arange(13)
    matrix = costs.between(every[:, None], every[None])
    for module in (distances, PLAIN["distances"]):
        kernel = replace_module(costs, module)
        assert [[kernel.between(a, b) for b in every if b != a] for a in every] == [
            [matrix[a, b] for b in every if b != a] for a in every
        ]


def replace_module(costs: CityCosts, module: object) -> distances.Distances:
    """The costs for loops of one of the two modules."""
    assert costs.metric is not None
    points = np.zeros((len(costs.metric), 3))
    points[:, : costs.metric.points.shape[1]] = costs.metric.points
    made: distances.Distances = module.Distances(  # type: ignore[attr-defined]
        metric=costs.metric.kind,
        points=points,
        group=costs.group,
        extra=costs.extra,
        ends=costs.ends,
    )
    return made


@pytest.mark.parametrize("kind", METRIC_KINDS)
def test_some_costs_are_those_of_the_matrix(kind: str) -> None:
    metric = Metric(kind, scattered(9, 3))
    a, b = np.arange(9)[::-1], np.arange(9)
    assert (metric.between(a, b) == metric.matrix()[a, b]).all()


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 60), seeds, st.integers(2, 3))
def test_the_curve_visits_every_point_once(n: int, seed: int, dimensions: int) -> None:
    assert sorted(along_hilbert(scattered(n, seed, dimensions))) == list(range(n))


def test_the_curve_goes_from_neighbour_to_neighbour_on_a_grid() -> None:
    grid = (
        np.stack(np.meshgrid(np.arange(16), np.arange(16)), axis=-1).reshape(-1, 2) * 4096.0 + 2048
    )
    points = np.concatenate((grid, [[0.0, 0.0], [65535.0, 65535.0]]))
    order = [each for each in along_hilbert(points) if each < 256]
    steps = np.abs(np.diff(grid[order], axis=0)).sum(axis=1)
    assert (steps == 4096).all()


@settings(max_examples=20, deadline=None)
@given(st.integers(8, 60), seeds, st.integers(1, 5), st.booleans())
def test_a_merged_tour_costs_no_more_than_the_first_and_keeps_what_all_have(
    n: int, seed: int, others: int, ended: bool
) -> None:
    rng = np.random.default_rng(seed)
    ends = rng.integers(0, 99, n) if ended else np.zeros(0, np.int64)
    costs = CityCosts(
        None, Metric("rounded", rng.integers(0, 500, (n - ended, 2)).astype(float)), ends=ends
    )
    tours = [np.arange(n, dtype=np.int32)]
    for _ in range(others):
        first, last = sorted(rng.integers(0, n, 2))
        other = tours[-1].copy()
        other[first:last] = other[first:last][::-1]
        tours.append(np.roll(other, int(rng.integers(0, n))))
    found = symmetric_tours.merge_tours(costs, tours, seed)
    assert sorted(found) == list(range(n))
    assert costs.of_tour(found) <= costs.of_tour(tours[0])
    sides = [edges_of(each) for each in tours]
    assert set.intersection(*sides) <= edges_of(found)


def edges_of(tour: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(pair) for pair in zip(tour.tolist(), np.roll(tour, 1).tolist(), strict=True)}


@settings(max_examples=15, deadline=None)
@given(st.integers(8, 40), seeds)
def test_trees_of_few_edges_and_without_a_matrix_weigh_what_trees_of_all_edges_do(
    n: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    metric = Metric("rounded", rng.integers(0, 100, (n, 2)).astype(float))
    penalty, degree, parent = (
        rng.integers(-500, 500, n) / 64,
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
    )
    weight = bounds.one_tree(metric.matrix().astype(np.int32), penalty, degree, parent)
    costs = CityCosts(None, metric)
    assert trees.full_tree(costs.kernel(), penalty, parent) - 2 * penalty.sum() == weight
    plain = replace_module(costs, PLAIN["distances"])
    assert PLAIN["trees"].full_tree(plain, penalty, parent) - 2 * penalty.sum() == weight
    a, b = np.triu_indices(n, 1)
    edges = rng.permutation(len(a))
    a, b = a[edges].astype(np.int32), b[edges].astype(np.int32)
    for module in (graphs, PLAIN["graphs"]):
        every = module.Graph(a, b, costs.between(a, b).astype(float), n)
        for _ in range(2):  # the order that it has then makes no difference
            assert every.weigh(penalty, degree, 1e300) == weight
            assert degree.sum() == 2 * n
        assert every.weigh(penalty, degree, float(rng.integers(-10, 100))) <= weight


@settings(max_examples=15, deadline=None)
@given(st.integers(3, 30), seeds)
def test_shortest_trees_and_their_clusters_are_those_of_scipy(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = (each.astype(np.int32) for each in np.triu_indices(n, 1))
    cost, penalty = rng.permutation(len(a)).astype(float), rng.integers(-500, 500, n) / 64
    cities, kept = int(rng.integers(2, n + 1)), int(rng.integers(0, n))
    weight = cost + penalty[a] + penalty[b]
    own = (a < cities) & (b < cities)
    least = weight.min() - 1  # a weight of 0 would be no edge
    matrix = csr_array((weight[own] - least, (a[own], b[own])), shape=(n, n))
    plain = np.sort(minimum_spanning_tree(matrix).data) + least
    for module in (graphs, PLAIN["graphs"]):
        graph, found, cluster = (
            module.Graph(a, b, cost, n),
            np.zeros(n, np.int32),
            np.zeros(n, np.int32),
        )
        tree = found[: graph.span(penalty, cities, found)]
        assert np.allclose(weight[tree], plain)
        graph.clusters(tree[:kept], cluster)
        some = tree[:kept]
        _, labels = connected_components(
            csr_array((np.ones(len(some)), (a[some], b[some])), shape=(n, n)), False
        )
        assert ((cluster[:, None] == cluster) == (labels[:, None] == labels)).all()


def test_few_points_find_the_neighbours_that_a_tree_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.random.default_rng(5).uniform(0, 1e4, (300, 3))
    costs = CityCosts(None, Metric("rounded", points))
    few = city_costs.quadrant_cities(points, costs)
    monkeypatch.setattr(city_costs, "MAX_COMPARED_POINTS", 0)
    assert (few == city_costs.quadrant_cities(points, costs)).all()


@pytest.mark.slow
def test_a_graph_of_few_edges_says_no_more_than_all_edges_allow() -> None:
    rng = np.random.default_rng(3)
    centres = rng.uniform(0, 1e5, (6, 2))
    points = np.concatenate([rng.normal(centre, 200, (50, 2)) for centre in centres])
    costs = of_matrix(Metric("rounded", points).matrix())
    tour = symmetric_tours.search_tour(costs, along_hilbert(points), TourLimits(work=20_000)).order
    lower, _ = held_karp_bound.sparse_lower_bound(
        costs, symmetric_tours.tour_candidates(costs, points), tour
    )
    assert 0.9 * costs.of_tour(tour) < lower <= costs.of_tour(tour)


@pytest.mark.slow
def test_the_bound_of_an_open_tour_counts_the_change_of_tools() -> None:
    """The city that stands for the ends is near all others, and the tools are far from each
    other though their places are not.
    """
    where = np.random.default_rng(11).uniform(0, 1000, (240, 2))
    visits = tuple(
        Visit(str(i), (float(x), float(y)), "ab"[i % 2]) for i, (x, y) in enumerate(where)
    )
    changes = {("a", "b"): 5000, ("b", "a"): 5000}
    ways = Metric("rounded", where).matrix()
    found = sequence_tour(
        TourProblem("two tools", visits, ways, closed=False, changes=changes),
        TourLimits(work=20_000),
    )
    assert isinstance(found, Tour)
    assert found.cost > 5000
    assert 0.98 * found.cost < found.lower_bound <= found.cost


@pytest.mark.slow
def test_a_bound_from_the_nearest_cities_lies_below_the_bound_from_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points = np.random.default_rng(5).uniform(0, 1000, (400, 2))
    costs = CityCosts(None, Metric("rounded", points))
    tour = symmetric_tours.search_tour(costs, along_hilbert(points), TourLimits(work=10_000)).order
    near = symmetric_tours.tour_candidates(costs)
    of_all, _ = held_karp_bound.sparse_lower_bound(costs, near, tour)
    monkeypatch.setattr(held_karp_bound, "MAX_DENSE_CITIES", 100)
    assert 0.97 * of_all < held_karp_bound.sparse_lower_bound(costs, near, tour)[0] <= of_all


def many(n: int, **options: object) -> TourProblem:
    """Visits at random places, without a matrix."""
    where = np.random.default_rng(n).uniform(0, 1e5, (n, 2))
    visits = tuple(
        Visit(str(i), (float(x), float(y)), "ab"[i % 2]) for i, (x, y) in enumerate(where)
    )
    made = TourProblem("many", visits, Metric("rounded", where))
    return replace(made, **options)  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, {("a", "b"): 5000, ("b", "a"): 5000}])
@pytest.mark.parametrize(
    "ends", [(True, None, None), (False, None, None), (False, 3, None), (True, 3, 7)]
)
def test_a_metric_gives_the_tours_that_its_matrix_gives_about(
    changes: dict[tuple[str, str], int], ends: tuple[bool, int | None, int | None]
) -> None:
    problem = many(300, changes=changes, closed=ends[0], start=ends[1], end=ends[2])
    quick = TourLimits(work=30_000)
    found = sequence_tour(problem, quick)
    plain = sequence_tour(replace(problem, travel=problem.travel.matrix()), quick)  # type: ignore[union-attr]
    assert isinstance(found, Tour)
    assert isinstance(plain, Tour)
    assert tour_violations(problem, found.order) == []
    assert found.lower_bound <= plain.cost
    assert plain.lower_bound <= found.cost == cost_of(problem, found.order)
    assert abs(found.cost - plain.cost) < 0.03 * plain.cost


@pytest.mark.slow
def test_many_visits_need_no_matrix_and_stop_soon_when_asked() -> None:
    problem = many(9000)
    answer = sequence_tour(problem, TourLimits(work=5000))
    assert isinstance(answer, Tour)
    assert tour_violations(problem, answer.order) == []
    assert 0.8 * answer.cost < answer.lower_bound <= answer.cost
    assert isinstance(sequence_tour(problem, TourLimits(interrupted=lambda: True)), Tour)


def test_what_needs_a_matrix_says_so() -> None:
    for answer in (
        sequence_tour(many(9000), method="chain1987"),
        sequence_tour(many(9000, precedence=((1, 2),))),
        sequence_tour(many(9000, changes={("a", "b"): 1})),
    ):
        assert isinstance(answer, GaveUp)
        assert "at most 8000 visits" in answer.reason
