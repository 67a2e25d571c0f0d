"""What touches by intention: the proof agrees with a plain look at many configurations."""

import numpy as np
import pytest

from cellwright.engine.stages.motion.path_proofs import touches_on_path
from tests.engine.stages.motion.conftest import finely, random_ground


@pytest.mark.parametrize("allowed_m", [0.005, 0.05])
def test_no_configuration_is_deeper_than_what_is_proved(
    rng: np.random.Generator, allowed_m: float
) -> None:
    proved = refused = 0
    for _ in range(40):
        ground = random_ground(rng, 3)
        path = rng.uniform(-1.5, 1.5, 2) + np.cumsum(rng.uniform(-0.3, 0.3, (3, 2)), axis=0)
        looked = [each for q in finely(path, 0.005) for each in ground.contacts(q)]
        deepest: dict[frozenset[str], float] = {}
        for each in looked:
            pair = frozenset((each.first, each.second))
            deepest[pair] = max(deepest.get(pair, 0.0), each.depth_m)
        told = {
            frozenset((each.first, each.second)): each
            for each in touches_on_path(ground, path, allowed_m)
        }
        for pair, depth in deepest.items():
            if depth > 0.0:
                assert pair in told or depth < 1e-4
            if depth > allowed_m:
                assert not told[pair].proved
        for pair, each in told.items():
            if not each.proved:
                assert deepest.get(pair, 0.0) > allowed_m - 0.01
        proved += sum(each.proved for each in told.values())
        refused += sum(not each.proved for each in told.values())
    assert proved + refused > 10
    assert refused


def test_one_configuration_that_is_too_deep_is_not_proved(rng: np.random.Generator) -> None:
    ground = random_ground(rng, 3)
    q = next(
        q
        for q in rng.uniform(-3.0, 3.0, (500, 2))
        if any(c.depth_m > 0.02 for c in ground.contacts(q))
    )
    assert not all(each.proved for each in touches_on_path(ground, q[None], 0.005))
    assert not all(each.proved for each in touches_on_path(ground, np.stack([q, q]), 0.005))
