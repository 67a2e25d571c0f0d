import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from engine.stages.sequencing.kernels.exchange import improve


def instance(n: int, seed: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Costs between random points, and each point's neighbours in order of distance."""
    points = np.random.default_rng(seed).integers(0, 1000, (n, 2))
    cost = np.rint(np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))).astype(np.int32)
    far = cost.astype(np.int64) + np.eye(n, dtype=np.int64) * 10**9
    return cost, np.argsort(far, axis=1, kind="stable")[:, : min(10, n - 1)].astype(np.int32)


def tolls(cost: NDArray[np.int32], near: NDArray[np.int32]) -> NDArray[np.int32]:
    return np.take_along_axis(cost, near, 1)


def length(tour: NDArray[np.int32], cost: NDArray[np.int32]) -> int:
    return int(cost[tour, np.roll(tour, -1)].sum())


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("n", [8, 9, 60, 300])
def test_the_gain_is_the_difference_of_the_tours_and_both_visit_every_city(n: int, seed: int) -> None:
    cost, near = instance(n, seed)
    tour = np.random.default_rng(seed).permutation(n).astype(np.int32)
    before = length(tour, cost)
    best, best_gain, gain, _ = improve(tour, cost, near, tolls(cost, near), 200, 20.0, 0.99, seed)
    assert sorted(best) == sorted(tour) == list(range(n))
    assert length(best, cost) == before - best_gain
    assert length(tour, cost) == before - gain
    assert best_gain >= gain >= 0 or best_gain >= 0


@pytest.mark.parametrize("seed", range(8))
def test_small_tours_are_as_short_as_brute_force_finds_them(seed: int) -> None:
    n = 8
    cost, near = instance(n, seed)
    shortest = min(length(np.array((0, *rest)), cost) for rest in itertools.permutations(range(1, n)))
    best, *_ = improve(np.arange(n, dtype=np.int32), cost, near, tolls(cost, near), 500, 50.0, 0.99, seed)
    assert length(best, cost) == shortest


def test_the_same_seed_gives_the_same_tour() -> None:
    cost, near = instance(200, 1)
    tours = [
        improve(np.arange(200, dtype=np.int32), cost, near, tolls(cost, near), 300, 10.0, 0.99, 7)[0]
        for _ in range(2)
    ]
    assert (tours[0] == tours[1]).all()
