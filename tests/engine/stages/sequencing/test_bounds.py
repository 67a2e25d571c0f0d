"""1-trees against networkx, the excess of edges against trees that are made to have them,
bounds against brute force.
"""

import itertools

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cellwright.engine.stages.sequencing.city_costs import of_matrix, quadrant_cities
from cellwright.engine.stages.sequencing.kernels import bounds
from cellwright.engine.stages.sequencing.kernels.bounds import ascend, excess, one_tree

GRAIN = 64.0  # penalties are whole parts of this, as in the kernel
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
sizes, seeds = st.integers(4, 9), st.integers(0, 10**6)


def drawn(n: int, seed: int) -> tuple[Ints, Floats]:
    """Symmetric costs and penalties that are whole multiples of the grain."""
    rng = np.random.default_rng(seed)
    half = np.triu(rng.integers(1, 60, (n, n)), 1)
    return (half + half.T).astype(np.int32), rng.integers(-500, 500, n) / GRAIN


def weight_of_one_tree(cost: Ints, penalty: Floats, forced: tuple[int, int] | None = None) -> float:
    """The weight of the cheapest 1-tree with a forced edge, less twice the penalties, by
    networkx and sorting.
    """
    n = len(cost)
    weight = cost + penalty[:, None] + penalty[None]
    graph = nx.Graph()
    for a, b in itertools.combinations(range(1, n), 2):
        graph.add_edge(a, b, weight=weight[a, b] - (10**6 if forced == (a, b) else 0))
    tree = nx.minimum_spanning_tree(graph)
    total = sum(weight[a, b] for a, b in tree.edges)
    ends = sorted(range(1, n), key=lambda b: weight[0, b] - (10**6 if forced == (0, b) else 0))[:2]
    return float(total + sum(weight[0, b] for b in ends) - 2 * penalty.sum())


@settings(deadline=None)
@given(sizes, seeds)
def test_one_trees_weigh_what_networkx_says_and_have_as_many_edges_as_cities(
    n: int, seed: int
) -> None:
    cost, penalty = drawn(n, seed)
    degree, parent = np.zeros(n, np.int32), np.zeros(n, np.int32)
    assert one_tree(cost, penalty, degree, parent) == weight_of_one_tree(cost, penalty)
    assert degree.sum() == 2 * n
    assert degree[0] == 2


@settings(max_examples=40, deadline=None)
@given(sizes, seeds)
def test_the_excess_of_an_edge_is_what_a_tree_with_it_weighs_more(n: int, seed: int) -> None:
    cost, penalty = drawn(n, seed)
    found, least = excess(cost, penalty), weight_of_one_tree(cost, penalty)
    for a, b in itertools.combinations(range(n), 2):
        assert found[a, b] == found[b, a] == weight_of_one_tree(cost, penalty, (a, b)) - least


@settings(max_examples=60, deadline=None)
@given(st.integers(4, 7), seeds)
def test_a_bound_is_never_above_the_shortest_tour_and_is_shown_by_its_penalties(
    n: int, seed: int
) -> None:
    cost, _ = drawn(n, seed)
    tours = (np.array((0, *rest)) for rest in itertools.permutations(range(1, n)))
    shortest = min(int(cost[tour, np.roll(tour, -1)].sum()) for tour in tours)
    bound, penalty, _ = ascend(cost, np.zeros(n), float(shortest), 200, 1.0)
    assert bound <= shortest
    assert bound == pytest.approx(weight_of_one_tree(cost, penalty), abs=0)


def test_the_bound_of_random_cities_comes_near_a_good_tour() -> None:
    from cellwright.engine.stages.sequencing.first_tours import chain_tour

    places = np.random.default_rng(4).integers(0, 1000, (120, 2))
    cost = np.rint(np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))).astype(np.int32)
    tour = chain_tour(cost, places.astype(float))
    upper = int(cost[tour, np.roll(tour, -1)].sum())
    bound, _, _ = ascend(cost, np.zeros(120), float(upper), 500, 1.0)
    assert 0.9 * upper < bound <= upper


def test_an_interrupted_ascent_ends_soon_with_a_bound() -> None:
    n = 4000
    places = np.random.default_rng(5).integers(0, 10_000, (n, 2)).astype(np.float32)
    cost = np.empty((n, n), np.int32)
    for row in range(n):
        cost[row] = np.hypot(*(places - places[row]).T)
    bound, penalty, made = ascend(cost, np.zeros(n), 1e9, 60, 1.0, lambda: True)
    assert made < 60
    assert 0 < bound == pytest.approx(one_tree(cost, penalty, *np.zeros((2, n), np.int32)), abs=0)


@settings(max_examples=30, deadline=None)
@given(st.integers(8, 60), seeds)
def test_an_ascent_in_slices_is_the_ascent_at_once(n: int, seed: int) -> None:
    cost, _ = drawn(n, seed)
    whole = ascend(cost, np.zeros(n), 1e6, 40, 1.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bounds, "SLICE", 3 * n * n)
        sliced = ascend(cost, np.zeros(n), 1e6, 40, 1.0)
    assert (sliced[0], sliced[2]) == (whole[0], whole[2])
    assert (sliced[1] == whole[1]).all()


@settings(max_examples=20, deadline=None)
@given(st.integers(4, 200), seeds, st.booleans())
def test_candidates_are_the_cheapest_in_each_quadrant_then_the_cheapest(
    n: int, seed: int, flat: bool
) -> None:
    places = np.random.default_rng(seed).integers(0, 3 if flat else 500, (n, 2)).astype(float)
    cost = np.rint(np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))).astype(np.int64)
    for city, found in enumerate(quadrant_cities(places, of_matrix(cost))):
        others = sorted((c for c in range(n) if c != city), key=lambda c: (cost[city, c], c))
        side = {c: tuple(places[c] >= places[city]) for c in others}
        firsts = {next(c for c in others if side[c] == each) for each in set(side.values())}
        rest = [c for c in others if c not in firsts]
        wanted = firsts | set(rest[: max(0, len(found) - len(firsts))])
        best = [c for c in others if c in wanted][: len(found)]
        # of equals, any will do
        assert [cost[city, c] for c in found] == [cost[city, c] for c in best]
        assert {side[c] for c in found} == {side[c] for c in best}
