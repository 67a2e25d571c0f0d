import itertools
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cellwright.engine.stages.sequencing import kernels
from cellwright.engine.stages.sequencing.kernels import distances, kicks
from tests.engine.interpreted import interpreted_package

SOURCES = interpreted_package(kernels)
PLAIN = SOURCES["kicks"]
COSTS = {kicks: distances, PLAIN: SOURCES["distances"]}
BOTH = pytest.mark.parametrize("module", [kicks, PLAIN], ids=["imported", "interpreted"])


def instance(n: int, seed: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Costs between random points, and each point's neighbours in order of distance."""
    points = np.random.default_rng(seed).integers(0, 1000, (n, 2))
    cost = np.rint(np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))).astype(np.int32)
    far = cost.astype(np.int64) + np.eye(n, dtype=np.int64) * 10**9
    return cost, np.argsort(far, axis=1, kind="stable")[:, : min(10, n - 1)].astype(np.int32)


def tolls(cost: NDArray[Any], near: NDArray[np.int32]) -> NDArray[np.int64]:
    return np.take_along_axis(cost, near, 1).astype(np.int64)


def kicker_of(
    module: ModuleType,
    tour: NDArray[np.int32],
    cost: NDArray[Any],
    near: NDArray[np.int32],
    seed: int,
) -> Any:
    """What anneals a tour."""
    loose = np.full(len(tour), -1, np.int32)
    return module.Kicker(tour, COSTS[module].Distances(cost), near, tolls(cost, near), loose, seed)


def length(tour: NDArray[np.int32], cost: NDArray[np.int32]) -> int:
    return int(cost[tour, np.roll(tour, -1)].sum())


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("module", "n"),
    [*itertools.product([kicks], [8, 9, 60, 300]), *itertools.product([PLAIN], [8, 9, 30])],
)
def test_the_gain_is_the_difference_of_the_tours_and_both_visit_every_city(
    module: ModuleType, n: int, seed: int
) -> None:
    cost, near = instance(n, seed)
    tour = np.random.default_rng(seed).permutation(n).astype(np.int32)
    before = length(tour, cost)
    kicker = kicker_of(module, tour, cost, near, seed)
    assert kicker.settle(0, n) == before - length(tour, cost) >= 0
    settled = length(tour, cost)
    for _ in range(5):
        kicker.anneal(40 if module is kicks else 4, 20.0, 0.99)
        assert sorted(kicker.best()) == sorted(tour) == list(range(n))
        assert length(kicker.best(), cost) == settled - kicker.best_gain
        assert length(tour, cost) == settled - kicker.gain
        assert kicker.best_gain >= max(kicker.gain, 0)


@pytest.mark.parametrize("seed", range(8))
def test_small_tours_are_as_short_as_brute_force_finds_them(seed: int) -> None:
    n = 8
    cost, near = instance(n, seed)
    shortest = min(
        length(np.array((0, *rest)), cost) for rest in itertools.permutations(range(1, n))
    )
    kicker = kicker_of(kicks, np.arange(n, dtype=np.int32), cost, near, seed)
    kicker.settle(0, n)
    kicker.anneal(500, 50.0, 0.99)
    assert length(kicker.best(), cost) == shortest


def test_the_same_seed_gives_the_same_tour() -> None:
    cost, near = instance(200, 1)
    tours = []
    for _ in range(2):
        kicker = kicker_of(kicks, np.arange(200, dtype=np.int32), cost, near, 7)
        kicker.anneal(300, 10.0, 0.99)
        tours.append(kicker.best())
    assert (tours[0] == tours[1]).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(8, 40), st.integers(0, 10**6), st.sampled_from((1, 10**7)), st.floats(0.0, 50.0))
def test_compiled_and_interpreted_anneal_alike_whatever_the_width_of_costs(
    n: int, seed: int, scale: int, warmth: float
) -> None:
    cost, near = instance(n, seed)
    wide = cost.astype(np.int64) * scale
    start = np.random.default_rng(seed).permutation(n).astype(np.int32)
    narrow = cost if scale == 1 else wide
    runs = []
    for module, costs in ((kicks, narrow), (PLAIN, narrow), (kicks, wide)):
        tour = start.copy()
        kicker = kicker_of(module, tour, costs, near, seed)
        kicker.settle(0, n)
        left = kicker.anneal(25, warmth * scale, 0.97)
        runs.append((kicker.best().tolist(), tour.tolist(), kicker.best_gain, kicker.gain, left))
    assert runs[0] == runs[1] == runs[2]


@settings(max_examples=25, deadline=None)
@given(st.integers(12, 40), st.integers(0, 10**6), st.integers(1, 5))
def test_edges_that_must_stay_stay(n: int, seed: int, pairs: int) -> None:
    cost, near = instance(n, seed)
    mate = np.full(n, -1, np.int32)
    for pair in range(pairs):
        mate[2 * pair], mate[2 * pair + 1] = 2 * pair + 1, 2 * pair
    tour = np.arange(n, dtype=np.int32)
    kicker = kicks.Kicker(tour, distances.Distances(cost), near, tolls(cost, near), mate, seed)
    kicker.settle(0, n)
    kicker.anneal(100, 50.0, 0.99)
    for found in (tour, kicker.best()):
        beside = {
            frozenset(pair)
            for pair in zip(found.tolist(), np.roll(found, -1).tolist(), strict=True)
        }
        assert {frozenset((2 * pair, 2 * pair + 1)) for pair in range(pairs)} <= beside


@BOTH
def test_arrays_that_do_not_go_together_are_refused(module: ModuleType) -> None:
    cost, near = instance(9, 1)
    tour, loose = np.arange(9, dtype=np.int32), np.full(9, -1, np.int32)
    toll, of = tolls(cost, near), COSTS[module].Distances
    with pytest.raises(ValueError, match="were expected"):
        of(cost[:8])
    with pytest.raises(ValueError, match="were expected"):
        module.Kicker(tour[:7], of(cost[:7, :7].copy()), near[:7], toll[:7], loose[:7], 0)
    with pytest.raises(ValueError, match="were expected"):
        module.Kicker(tour, of(cost), near, toll[:8], loose, 0)
    with pytest.raises(ValueError, match="numbered 0 to 8"):
        module.Kicker(tour + 1, of(cost), near, toll, loose, 0)
