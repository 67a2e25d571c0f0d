import itertools
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from engine.stages.sequencing import kernels
from engine.stages.sequencing.kernels import kicks
from engine.stages.sequencing.kernels.kicks import improve
from tests.engine.interpreted import interpreted_package

PLAIN = interpreted_package(kernels)["kicks"]
BOTH = pytest.mark.parametrize("module", [kicks, PLAIN], ids=["imported", "interpreted"])


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
@pytest.mark.parametrize(
    ("module", "n"), [*itertools.product([kicks], [8, 9, 60, 300]), *itertools.product([PLAIN], [8, 9, 30])]
)
def test_the_gain_is_the_difference_of_the_tours_and_both_visit_every_city(
    module: ModuleType, n: int, seed: int
) -> None:
    cost, near = instance(n, seed)
    tour = np.random.default_rng(seed).permutation(n).astype(np.int32)
    before = length(tour, cost)
    moves = 200 if module is kicks else 20
    best, best_gain, gain, _ = module.improve(tour, cost, near, tolls(cost, near), moves, 20.0, 0.99, seed)
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


@settings(max_examples=25, deadline=None)
@given(st.integers(8, 40), st.integers(0, 10**6), st.sampled_from((1, 10**7)), st.floats(0.0, 50.0))
def test_compiled_and_interpreted_anneal_alike_whatever_the_width_of_costs(
    n: int, seed: int, scale: int, warmth: float
) -> None:
    cost, near = instance(n, seed)
    wide = cost.astype(np.int64) * scale
    start = np.random.default_rng(seed).permutation(n).astype(np.int32)
    runs = []
    for module, costs in (
        (kicks, cost if scale == 1 else wide),
        (PLAIN, cost if scale == 1 else wide),
        (kicks, wide),
    ):
        tour = start.copy()
        best, *rest = module.improve(tour, costs, near, tolls(costs, near), 25, warmth * scale, 0.97, seed)
        runs.append((best.tolist(), tour.tolist(), *rest))
    assert runs[0] == runs[1] == runs[2]


@BOTH
def test_arrays_that_do_not_go_together_are_refused(module: ModuleType) -> None:
    cost, near = instance(9, 1)
    toll, tour = tolls(cost, near), np.arange(9, dtype=np.int32)
    with pytest.raises(ValueError, match="were expected"):
        module.improve(tour, cost[:8], near, toll, 1, 1.0, 1.0, 0)
    with pytest.raises(ValueError, match="were expected"):
        module.improve(tour[:7], cost[:7, :7], near[:7], toll[:7], 1, 1.0, 1.0, 0)
    with pytest.raises(ValueError, match="numbered 0 to 8"):
        module.improve(tour + 1, cost, near, toll, 1, 1.0, 1.0, 0)
