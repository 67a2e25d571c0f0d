"""The chain of 1987, part by part."""

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from cellwright.engine.stages.sequencing.first_tours import PEEPHOLE_WINDOW, chain_tour, convex_hull
from cellwright.engine.stages.sequencing.kernels.chain import exchange_edges, insert_all, peephole

Ints = NDArray[np.int32]


def city(n: int, seed: int) -> tuple[NDArray[np.float64], Ints]:
    places = np.random.default_rng(seed).integers(0, 1000, (n, 2)).astype(float)
    return places, np.rint(np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))).astype(
        np.int32
    )


def length(tour: Ints, cost: Ints) -> int:
    return int(cost[tour, np.roll(tour, -1)].sum())


@pytest.mark.parametrize("seed", range(4))
def test_all_points_lie_left_of_each_edge_of_their_hull(seed: int) -> None:
    places, _ = city(40, seed)
    hull = places[convex_hull(places)]
    for a, b in zip(hull, np.roll(hull, -1, axis=0), strict=True):
        side = (b[0] - a[0]) * (places[:, 1] - a[1]) - (b[1] - a[1]) * (places[:, 0] - a[0])
        assert (side >= 0).all()


@pytest.mark.parametrize("seed", range(4))
def test_insertion_keeps_the_order_of_the_hull(seed: int) -> None:
    places, cost = city(50, seed)
    hull = [int(each) for each in convex_hull(places)]
    tour = [int(each) for each in insert_all(np.array(hull, np.int32), cost)]
    assert sorted(tour) == list(range(50))
    assert [each for each in tour if each in hull] == hull


@pytest.mark.parametrize("seed", range(4))
def test_no_exchange_of_two_edges_is_left_that_helps(seed: int) -> None:
    _, cost = city(40, seed)
    tour = np.arange(40, dtype=np.int32)
    exchange_edges(tour, cost)
    before = length(tour, cost)
    for i, j in itertools.combinations(range(41), 2):
        other = tour.copy()
        other[i:j] = tour[i:j][::-1]
        assert length(other, cost) >= before


def test_each_window_of_the_peephole_is_in_its_best_order() -> None:
    _, cost = city(12, 7)
    tour = np.random.default_rng(1).permutation(12).astype(np.int32)
    peephole(tour, cost, 4)
    before = length(tour, cost)
    for start in range(12):
        turned = np.roll(tour, -start)
        for inner in itertools.permutations(turned[1:5]):
            assert length(np.concatenate((turned[:1], inner, turned[5:])), cost) >= before


@pytest.mark.parametrize("n", [3, 4, 7, PEEPHOLE_WINDOW + 2, 60])
@pytest.mark.parametrize("known", [True, False])
def test_the_chain_visits_every_city(n: int, known: bool) -> None:
    places, cost = city(n, n)
    assert sorted(chain_tour(cost, places if known else None)) == list(range(n))


def test_cities_at_one_place_are_toured() -> None:
    assert sorted(chain_tour(np.zeros((9, 9), np.int32), np.zeros((9, 2)))) == list(range(9))
