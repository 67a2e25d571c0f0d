"""Our own small linear algebra and angles agree with NumPy's to rounding."""

import numpy as np
import pytest

from cellwright.engine.kernels.geometry.angles import angle_of, angles_of, arc_cosine, sines_cosines
from cellwright.engine.kernels.linear import matmul, norm, solve_positive_definite


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(18)


SHAPES = [
    ((4, 4), (4, 4)),
    ((5, 4, 4), (4, 4)),
    ((2, 5, 3, 3), (5, 3, 3)),
    ((7, 3), (3, 3)),
    ((3, 3), (3,)),
    ((5, 3, 3), (3,)),
    ((3,), (3, 4)),
    ((3,), (3,)),
]


@pytest.mark.parametrize(("one", "other"), SHAPES)
def test_products_are_those_of_numpy(
    rng: np.random.Generator, one: tuple[int, ...], other: tuple[int, ...]
) -> None:
    a, b = rng.normal(size=one), rng.normal(size=other)
    assert np.allclose(matmul(a, b), a @ b, rtol=0.0, atol=1e-14)
    assert np.shape(matmul(a, b)) == np.shape(a @ b)


def test_products_go_from_left_to_right(rng: np.random.Generator) -> None:
    a, b, c = rng.normal(size=(3, 4, 4))
    assert np.array_equal(matmul(a, b, c), matmul(matmul(a, b), c))


@pytest.mark.parametrize("size", [1, 3, 7])
def test_a_solution_solves(rng: np.random.Generator, size: int) -> None:
    root = rng.normal(size=(20, size, size))
    matrix = np.swapaxes(root, 1, 2) @ root + 0.1 * np.eye(size)
    right = rng.normal(size=(20, size))
    assert np.allclose(
        (matrix @ solve_positive_definite(matrix, right)[..., None])[..., 0], right, atol=1e-10
    )


def test_lengths_are_those_of_numpy(rng: np.random.Generator) -> None:
    vector = rng.normal(size=5)
    assert norm(vector) == pytest.approx(np.linalg.norm(vector), rel=1e-15)


def test_angles_are_those_of_numpy_to_rounding(rng: np.random.Generator) -> None:
    x, y = rng.normal(size=(2, 5000)) * 10.0 ** rng.integers(-9, 9, (2, 5000))
    assert np.abs(angles_of(y, x) - np.arctan2(y, x)).max() < 1e-15
    cosines = rng.uniform(-1.0, 1.0, 1000)
    assert max(abs(arc_cosine(each) - np.arccos(each)) for each in cosines.tolist()) < 1e-15


def test_angles_at_the_axes_and_of_what_is_no_point() -> None:
    assert [
        angle_of(y, x) for y, x in ((0.0, 0.0), (0.0, 2.0), (3.0, 0.0), (-3.0, 0.0), (0.0, -1.0))
    ] == [
        0.0,
        0.0,
        np.pi / 2,
        -np.pi / 2,
        np.pi,
    ]
    assert np.isnan([angle_of(np.nan, 1.0), angle_of(1.0, np.nan), angle_of(np.inf, 1.0)]).all()


def test_sines_keep_the_shape_of_their_angles(rng: np.random.Generator) -> None:
    for shape in ((), (3,), (2, 1, 4)):
        angles = rng.uniform(-9.0, 9.0, shape)
        s, c = sines_cosines(angles)
        assert s.shape == c.shape == shape
        assert np.allclose(s, np.sin(angles), atol=1e-15)
        assert np.allclose(c, np.cos(angles), atol=1e-15)
