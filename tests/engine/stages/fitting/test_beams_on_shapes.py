"""Where beams meet shapes, and fits along beams: agreement with closed forms, and no bias by
the square of the noise.
"""

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import rotation_by_vector, transform
from cellwright.engine.model.shape_fits import Cloud, Fit, FitShape
from cellwright.engine.stages.fitting.shape_distances import beam_hits, shape_distances
from cellwright.engine.stages.fitting.shape_fit import fit_measured_shape, narrow_beams
from cellwright.engine.stages.fitting.shape_guesses import ShapeGuess

CENTRE = np.array([0.0, 0.0, 0.16])
RADIUS = 0.01


def beams(most: float) -> Floats:
    """Unit vectors (n, 3) about z, those that meet the ball off its middle by at most `most` of
    its radius.
    """
    u, v = np.meshgrid(np.linspace(-0.07, 0.07, 41), np.linspace(-0.07, 0.07, 41))
    rays = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    found: Floats = rays[np.linalg.norm(np.cross(rays, CENTRE), axis=1) <= most * RADIUS]
    return found


def ranges(rays: Floats) -> Floats:
    """Where beams from the origin meet the ball."""
    along = rays @ CENTRE
    found: Floats = along - np.sqrt(along**2 - CENTRE @ CENTRE + RADIUS**2)
    return found


def test_beams_meet_a_ball_where_the_closed_form_says() -> None:
    rays = beams(0.95)
    exact, off = ranges(rays), np.random.default_rng(1).normal(0.0, 1e-4, len(rays))
    there = beam_hits(FitShape.SPHERE, rays * (exact + off)[:, None] - CENTRE, rays, RADIUS, 0.0)
    assert there.hit.all()
    assert np.allclose(there.behind_m, off, atol=1e-8)
    assert np.allclose(there.feet + CENTRE, rays * exact[:, None], atol=1e-8)


@pytest.mark.parametrize(
    ("shape", "angle"),
    [(FitShape.PLANE, 0.0), (FitShape.CYLINDER, 0.0), (FitShape.CONE, 0.3), (FitShape.SPHERE, 0.0)],
)
def test_feet_lie_on_the_shape(shape: FitShape, angle: float) -> None:
    random = np.random.default_rng(2)
    points = random.normal(size=(200, 3)) * 0.001 + [RADIUS, 0.0, 0.0]
    rays = random.normal(size=(200, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    there = beam_hits(shape, points, rays, RADIUS, angle)
    off = shape_distances(shape, there.feet, np.asarray(RADIUS), np.asarray(angle))[:, 0]
    assert there.hit.mean() > 0.6  # some of these beams miss the round ones
    assert np.abs(off[there.hit]).max() < 1e-7


def test_a_beam_that_misses_has_not_hit() -> None:
    there = beam_hits(
        FitShape.SPHERE,
        np.array([[0.0, 2 * RADIUS, 0.0]]),
        np.array([[0.0, 0.0, 1.0]]),
        RADIUS,
        0.0,
    )
    assert not there.hit.any()
    assert np.isfinite(there.behind_m).all()


def test_which_points_are_known_does_not_depend_on_their_ranges() -> None:
    rays = beams(0.999)
    at = ShapeGuess(transform(np.eye(3), CENTRE), np.asarray(RADIUS), np.asarray(0.0))
    random, known = np.random.default_rng(3), []
    for sigma in (0.0, 5e-5):
        points = rays * (ranges(rays) + random.normal(0.0, 1.0, len(rays)) * sigma)[:, None]
        each = np.full(len(rays), 1e-4)
        known.append(
            narrow_beams(FitShape.SPHERE, Cloud(points, each, rays, each, 0.4 * each), at)[1]
        )
    assert (
        known[0] == known[1]
    ).mean() > 0.99  # close to the rim of the ball, a noisy point may lead to no foot
    assert 0.5 < known[0].mean() < 1.0


@pytest.mark.slow
def test_balls_seen_along_beams_are_as_wide_as_they_are() -> None:
    """The mean of many fits is off by less than its own uncertainty."""
    rays, off = beams(0.95), list[float]()
    exact = ranges(rays)
    facing = np.abs(((rays * exact[:, None] - CENTRE) * rays).sum(axis=1)) / RADIUS
    for seed in range(30):
        random = np.random.default_rng(seed)
        noise = 5e-5 / facing
        points = rays * (exact + random.normal(0.0, 1.0, len(rays)) * noise)[:, None]
        turn = rotation_by_vector(random.normal(size=3))
        fit = fit_measured_shape(FitShape.SPHERE, Cloud(points @ turn.T, noise, rays @ turn.T))
        assert isinstance(fit, Fit)
        off.append((fit.radius_m - RADIUS) / fit.deviation("radius"))
    assert abs(float(np.mean(off))) < 0.55  # three standard errors of 30
    assert 0.6 < float(np.std(off)) < 1.4
