"""Shapes through measured points: errors are as large as the stated uncertainty says, whatever
some points do.
"""

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import (
    apply,
    inverse,
    rotation_by_vector,
    transform,
    translation,
)
from cellwright.engine.model.shape_fits import SHAPE_PARAMETERS, Cloud, Fit, FitShape, Unfitted
from cellwright.engine.stages.fitting.shape_distances import (
    distance_normals,
    distance_slopes,
    shape_distances,
)
from cellwright.engine.stages.fitting.shape_fit import fit_measured_shape
from cellwright.engine.stages.fitting.shape_relations import relate_fits

SIGMA_M = 5e-5
RADIUS_M, ANGLE = 0.01, 0.4


def drawn(shape: FitShape, random: np.random.Generator, count: int = 200) -> Floats:
    """Points (n, 3) exactly on a shape, in its own frame."""
    around, along = random.uniform(-1.2, 1.2, count), random.uniform(-0.01, 0.01, count)
    out = {FitShape.CONE: RADIUS_M + along * np.tan(ANGLE)}.get(shape, np.full(count, RADIUS_M))
    if shape is FitShape.PLANE:
        return np.stack([random.uniform(-0.01, 0.01, count), along, np.zeros(count)], axis=1)
    if shape is FitShape.SPHERE:
        up = random.uniform(-0.5, 0.5, count)
        return RADIUS_M * np.stack(
            [np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)], axis=1
        )
    height = np.zeros(count) if shape is FitShape.CIRCLE else along
    return np.stack([out * np.cos(around), out * np.sin(around), height], axis=1)


def pose(random: np.random.Generator) -> Floats:
    return transform(rotation_by_vector(random.normal(size=3)), random.uniform(-1.0, 1.0, 3))


def cloud(shape: FitShape, random: np.random.Generator, wrong: float = 0.0) -> tuple[Cloud, Floats]:
    """Noisy points on a shape at a pose T; a share of them is wrong."""
    T, exact = pose(random), drawn(shape, random)
    points = apply(T, exact) + random.normal(0.0, SIGMA_M, exact.shape)
    spoilt = random.random(len(points)) < wrong
    points[spoilt] += random.uniform(-0.01, 0.01, (int(spoilt.sum()), 3))
    return Cloud(points, np.full(len(points), SIGMA_M)), T


@pytest.mark.slow
@pytest.mark.parametrize("shape", list(FitShape))
def test_sizes_err_as_the_covariance_says(shape: FitShape) -> None:
    random, errors = np.random.default_rng(7), []
    for _ in range(40):
        measured, T = cloud(shape, random, wrong=0.1)
        found = fit_measured_shape(shape, measured)
        assert isinstance(found, Fit)
        if shape is FitShape.PLANE:
            off = (found.origin - T[:3, 3]) @ T[:3, 2]
            errors.append(off / found.deviation("z"))
        else:
            errors.append((found.radius_m - _radius(shape, found, T)) / found.deviation("radius"))
    assert np.mean(np.abs(errors) < 1.96) >= 0.85
    assert 0.7 < np.std(errors) < 1.4


def _radius(shape: FitShape, found: Fit, T: Floats) -> float:
    """The true radius where the fit tells its own."""
    if shape is not FitShape.CONE:
        return RADIUS_M
    return RADIUS_M + float((found.origin - T[:3, 3]) @ T[:3, 2]) * np.tan(ANGLE)


@pytest.mark.parametrize("shape", list(FitShape))
def test_exact_points_give_the_shape_exactly(shape: FitShape) -> None:
    random = np.random.default_rng(3)
    T, exact = pose(random), drawn(shape, random)
    found = fit_measured_shape(shape, Cloud(apply(T, exact), np.full(len(exact), 1e-6)))
    assert isinstance(found, Fit)
    assert found.used.all()
    assert found.chi2 < 1e-9
    if shape is not FitShape.SPHERE:
        assert abs(float(found.axis @ T[:3, 2])) == pytest.approx(1.0, abs=1e-12)
    if shape is FitShape.CONE:
        assert found.angle_rad == pytest.approx(ANGLE)
        assert float(found.axis @ T[:3, 2]) > 0


@pytest.mark.parametrize("shape", list(FitShape))
def test_slopes_are_the_derivatives_of_distances(shape: FitShape) -> None:
    random, step = np.random.default_rng(5), 1e-6
    points = drawn(shape, random, 20) + random.normal(0.0, 0.001, (20, 3))
    known = distance_slopes(shape, points, RADIUS_M, ANGLE if shape is FitShape.CONE else 0.0)
    for number, name in enumerate(SHAPE_PARAMETERS[shape]):
        after, before = (_changed(shape, points, name, sign * step) for sign in (1.0, -1.0))
        assert known[..., number] == pytest.approx((after - before) / (2 * step), abs=2e-5)


def _changed(shape: FitShape, points: Floats, name: str, by: float) -> Floats:
    x, y, z, a, b, radius, angle = (
        by * (name == each) for each in ("x", "y", "z", "tilt_x", "tilt_y", "radius", "angle")
    )
    T = transform(rotation_by_vector(np.array([-b, a, 0.0])), (x, y, z))
    local = (points - T[:3, 3]) @ T[:3, :3]
    cone = ANGLE if shape is FitShape.CONE else 0.0
    return shape_distances(shape, local, np.asarray(RADIUS_M + radius), np.asarray(cone + angle))


@pytest.mark.parametrize("shape", list(FitShape))
def test_distances_grow_along_the_normals(shape: FitShape) -> None:
    random, step = np.random.default_rng(6), 1e-7
    angle = np.asarray(ANGLE if shape is FitShape.CONE else 0.0)
    points = drawn(shape, random, 20) + random.normal(0.0, 0.001, (20, 3))
    away = distance_normals(shape, points, float(angle))
    here = shape_distances(shape, points, np.asarray(RADIUS_M), angle)
    for row in range(away.shape[1]):
        there = shape_distances(shape, points + step * away[:, row], np.asarray(RADIUS_M), angle)
        assert (there - here)[:, row] == pytest.approx(step, rel=1e-3)


def test_what_cannot_be_fitted_is_told() -> None:
    random = np.random.default_rng(1)
    few = Cloud(np.zeros((3, 3)), np.ones(3))
    assert "at least" in _reason(FitShape.SPHERE, few)
    scattered = Cloud(random.uniform(-1.0, 1.0, (100, 3)), np.full(100, SIGMA_M))
    assert _reason(FitShape.SPHERE, scattered)
    flat = drawn(FitShape.PLANE, random) + random.normal(0.0, SIGMA_M, (200, 3))
    assert _reason(FitShape.SPHERE, Cloud(flat, np.full(200, SIGMA_M)))
    line = np.outer(np.linspace(0.0, 1.0, 50), [1.0, 2.0, 3.0])
    assert _reason(FitShape.PLANE, Cloud(line, np.full(50, SIGMA_M)))
    noisy = 0.01 * line + random.normal(0.0, SIGMA_M, line.shape)
    assert "its direction is known to" in _reason(
        FitShape.PLANE, Cloud(noisy, np.full(50, SIGMA_M))
    )
    assert "not a number" in _reason(FitShape.PLANE, Cloud(np.full((9, 3), np.nan), np.ones(9)))
    assert "more than 0" in _reason(FitShape.PLANE, Cloud(flat, np.zeros(200)))


def _reason(shape: FitShape, points: Cloud) -> str:
    found = fit_measured_shape(shape, points)
    assert isinstance(found, Unfitted)
    return found.reason


@pytest.mark.slow
def test_step_heights_and_angles_err_as_stated() -> None:
    random, errors = np.random.default_rng(9), []
    for _ in range(40):
        T, tilt = pose(random), float(random.uniform(0.02, 0.05))
        upper = transform(rotation_by_vector(np.array([tilt, 0.0, 0.0])), (0.0, 0.0, 0.004))
        one, other = (_plane(T @ each, random) for each in (np.eye(4), upper))
        distance, angle = relate_fits(one, other)
        _, y, _ = apply(inverse(T), other.origin[None])[0]
        errors += [
            (distance.value - 0.004 - y * np.tan(tilt)) / distance.sigma,
            (angle.value - tilt) / angle.sigma,
        ]
    assert np.mean(np.abs(errors) < 1.96) >= 0.85
    assert 0.7 < np.std(errors) < 1.4


def _plane(T: Floats, random: np.random.Generator) -> Fit:
    points = apply(T, drawn(FitShape.PLANE, random)) + random.normal(0.0, SIGMA_M, (200, 3))
    found = fit_measured_shape(FitShape.PLANE, Cloud(points, np.full(200, SIGMA_M)))
    assert isinstance(found, Fit)
    return found


def exact(shape: FitShape, T: Floats, random: np.random.Generator, noise_m: float = 1e-7) -> Fit:
    """A fit to points on a shape at T."""
    points = apply(T, drawn(shape, random))
    found = fit_measured_shape(
        shape, Cloud(points + random.normal(0.0, noise_m, points.shape), np.full(200, noise_m))
    )
    assert isinstance(found, Fit)
    return found


LYING = transform(rotation_by_vector(np.array([0.0, np.pi / 2, 0.0])), (0.0, 0.0, 0.0))
OFF = [
    (FitShape.CYLINDER, FitShape.CYLINDER, translation(0.03, 0.04, 0.02), 0.05, "of the axes"),
    (FitShape.CYLINDER, FitShape.SPHERE, translation(0.03, 0.04, 0.02), 0.05, "of the centre from "
    "the "
    "axis"),
    (FitShape.SPHERE, FitShape.CYLINDER, translation(0.03, 0.04, 0.02), 0.05, "of the centre from "
    "the "
    "axis"),
    (FitShape.CIRCLE, FitShape.CYLINDER, translation(0.0, 0.04, 0.02), 0.04, "of the centre from "
    "the "
    "axis"),
    (FitShape.CYLINDER, FitShape.CYLINDER, translation(0.03, 0.04, 0.02) @ LYING, None, ""),
    (FitShape.PLANE, FitShape.CYLINDER, translation(0.03, 0.04, 0.02) @ LYING, 0.02, "of the axis "
    "from "
    "the "
    "plane"),
    (FitShape.CYLINDER, FitShape.PLANE, translation(0.02, 0.04, 0.0) @ LYING, 0.02, "of the axis "
    "from "
    "the "
    "plane"),
    (FitShape.PLANE, FitShape.CYLINDER, translation(0.03, 0.04, 0.02), None, ""),
    (FitShape.PLANE, FitShape.PLANE, translation(0.03, 0.04, 0.02), 0.02, "of the second's middle "
    "from "
    "the "
    "first "
    "plane"),
    (FitShape.PLANE, FitShape.SPHERE, translation(0.03, 0.04, 0.02), 0.02, "of the centre from the "
    "plane"),
    (FitShape.SPHERE, FitShape.CIRCLE, translation(0.03, 0.04, 0.12), 0.13, "of the centres"),
]  # fmt: skip


@pytest.mark.parametrize(("one", "other", "T", "apart", "told"), OFF)
def test_shapes_are_as_far_apart_as_they_were_put(
    one: FitShape, other: FitShape, T: Floats, apart: float | None, told: str
) -> None:
    random = np.random.default_rng(3)
    at = pose(random)
    found = relate_fits(exact(one, at, random), exact(other, at @ T, random))
    distances = [each for each in found if each.what == "distance"]
    assert [each.of for each in distances] == ([told] if told else [])
    for each in distances:
        assert each.value == pytest.approx(apart, abs=4 * each.sigma)
        assert 0 < each.sigma < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("pair", [0, 1, 3, 5, 6])
def test_distances_from_axes_err_as_stated(pair: int) -> None:
    one, other, T, apart, _ = OFF[pair]
    random, errors = np.random.default_rng(9), []
    for _ in range(60):
        at = pose(random)
        found = relate_fits(exact(one, at, random, SIGMA_M), exact(other, at @ T, random, SIGMA_M))[
            0
        ]
        errors.append((found.value - (apart or 0.0)) / found.sigma)
    assert np.mean(np.abs(errors) < 1.96) >= 0.85
    assert 0.75 < np.std(errors) < 1.3
    assert abs(np.mean(errors)) < 0.4


def test_spheres_are_as_far_apart_as_their_centres() -> None:
    random = np.random.default_rng(12)
    two = [
        Cloud(drawn(FitShape.SPHERE, random) + np.array([place, 0.0, 0.0]), np.full(200, 1e-6))
        for place in (0.0, 0.05)
    ]
    one, other = (fit_measured_shape(FitShape.SPHERE, each) for each in two)
    assert isinstance(one, Fit)
    assert isinstance(other, Fit)
    (distance,) = relate_fits(one, other)
    assert distance.what == "distance"
    assert distance.value == pytest.approx(0.05, abs=1e-9)
