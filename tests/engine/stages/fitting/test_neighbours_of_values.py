"""What neighbours let expect: smooth surfaces are explained, bad values are not, and few
neighbours tell nothing.
"""

import numpy as np
import pytest

from cellwright.engine.stages.fitting.deviation_outliers import LEAST, expect_deviations

UP = np.array([0.0, 0.0, 1.0])


def surface(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    points = np.concatenate([random.uniform(-1, 1, (count, 2)), np.zeros((count, 1))], axis=1)
    return points, np.tile(UP, (count, 1))


def test_a_slope_is_explained_exactly_also_beside_bad_neighbours() -> None:
    points, normals = surface(80, 1)
    values = 3.0 + points @ np.array([40.0, -25.0, 0.0])
    wrong = values.copy()
    wrong[[5, 40]] += 500.0
    found = expect_deviations(points, normals, wrong, np.full(80, 1.0), np.ones(80, bool))
    assert found.known.all()
    assert found.value == pytest.approx(values, abs=1e-4)
    off = np.abs(found.off(wrong, np.full(80, 1.0)))
    assert set(np.flatnonzero(off > 3.0)) == {5, 40}


@pytest.mark.parametrize("seed", range(5))
def test_every_value_of_six_standard_deviations_is_told_and_few_others(seed: int) -> None:
    points, normals = surface(600, seed)
    random = np.random.default_rng(100 + seed)
    values = 30.0 * np.sin(2.0 * points[:, 0]) + random.normal(0.0, 4.0, 600)
    bad = random.choice(600, 12, replace=False)
    values[bad] += random.choice([-1, 1], 12) * random.uniform(7, 40, 12) * 4.0
    found = expect_deviations(points, normals, values, np.full(600, 4.0), np.ones(600, bool))
    told = set(np.flatnonzero(np.abs(found.off(values, np.full(600, 4.0))) > 3.0))
    assert set(bad) <= told
    assert len(told) <= 12 + 12


def test_points_of_another_side_are_no_neighbours() -> None:
    points, normals = surface(40, 3)
    normals[::2] = [1.0, 0.0, 0.0]
    values = np.where(np.arange(40) % 2, 0.0, 100.0)
    found = expect_deviations(points, normals, values, np.ones(40), np.ones(40, bool))
    assert found.value == pytest.approx(values, abs=1e-6)


@pytest.mark.parametrize("count", [0, 1, LEAST])
def test_few_neighbours_tell_nothing(count: int) -> None:
    points, normals = surface(count, 4)
    found = expect_deviations(
        points, normals, np.zeros(count), np.ones(count), np.ones(count, bool)
    )
    assert not found.known.any()
    assert (found.off(np.full(count, 99.0), np.ones(count)) == 0).all()


def test_points_on_a_line_or_in_one_place_are_no_trouble() -> None:
    for points in (np.outer(np.arange(20.0), [1.0, 0.0, 0.0]), np.zeros((20, 3))):
        found = expect_deviations(
            points, np.tile(UP, (20, 1)), np.full(20, 7.0), np.ones(20), np.ones(20, bool)
        )
        assert np.isfinite(found.value).all()
        assert found.value == pytest.approx(np.full(20, 7.0), abs=1e-4)
