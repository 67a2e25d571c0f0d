"""What a wide beam tells on a shape, beside the mean over very many thin beams, weighed by what
each returns.
"""

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import rotation_by_vector, transform
from cellwright.engine.model.shape_fits import Cloud, FitShape
from cellwright.engine.stages.fitting.shape_distances import beam_hits
from cellwright.engine.stages.fitting.shape_fit import FAN_NODES, FAN_WEIGHTS, narrow_beams
from cellwright.engine.stages.fitting.shape_guesses import ShapeGuess

RADIUS, ANGLE = 0.01, 0.3
BEAM_RAD = 0.0007  # standard deviation across


def test_the_rule_is_exact_to_the_fifth_order() -> None:
    moments = {
        (0, 0): 1,
        (1, 0): 0,
        (2, 0): 1,
        (1, 1): 0,
        (0, 2): 1,
        (3, 0): 0,
        (2, 1): 0,
        (4, 0): 3,
        (2, 2): 1,
        (5, 0): 0,
    }
    for (p, q), exact in moments.items():
        assert FAN_WEIGHTS @ (FAN_NODES[:, 0] ** p * FAN_NODES[:, 1] ** q) == pytest.approx(
            exact, abs=1e-12
        )


def posed(shape: FitShape) -> ShapeGuess:
    """A shape 0.15 m before the eye, leaning."""
    lean = rotation_by_vector(np.array([0.2, 0.3, 0.0]))
    sideways = (
        rotation_by_vector(np.array([0.0, np.pi / 2, 0.0]))
        if shape in (FitShape.CYLINDER, FitShape.CONE)
        else np.eye(3)
    )
    T = transform(lean @ sideways, (0.0, 0.0, 0.15 if shape is FitShape.PLANE else 0.15 + RADIUS))
    return ShapeGuess(T, np.asarray(RADIUS), np.asarray(ANGLE if shape is FitShape.CONE else 0.0))


def ranges(shape: FitShape, at: ShapeGuess, rays: Floats) -> tuple[Floats, Floats]:
    """Where beams (n, 3) from the eye meet the shape, and what comes back."""
    back = np.linalg.inv(at.T)
    about = rays * 0.149
    local, own = about @ back[:3, :3].T + back[:3, 3], rays @ back[:3, :3].T
    there = beam_hits(shape, local, own, float(at.radius_m), float(at.angle_rad))
    assert there.hit.all()
    found = 0.149 - there.behind_m
    return found, np.abs(there.facing) / found**2


@pytest.mark.parametrize(
    "shape", [FitShape.PLANE, FitShape.SPHERE, FitShape.CYLINDER, FitShape.CONE]
)
def test_ranges_of_wide_beams_become_those_of_thin_ones(shape: FitShape) -> None:
    at, random = posed(shape), np.random.default_rng(1)
    places = random.uniform(-0.02, 0.02, (12, 2))
    rays = np.concatenate([places, np.ones((12, 1))], axis=1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    thin, _ = ranges(shape, at, rays)
    grid = np.stack(np.meshgrid(*[np.linspace(-4.5, 4.5, 61)] * 2), axis=-1).reshape(-1, 2)
    weights = np.exp(-0.5 * (grid**2).sum(axis=1))
    wide = np.empty(12)
    for number, ray in enumerate(rays):
        one = np.cross(ray, [1.0, 0.0, 0.0])
        one /= np.linalg.norm(one)
        fan = ray + BEAM_RAD * (grid[:, :1] * one + grid[:, 1:] * np.cross(ray, one))
        there, strength = ranges(shape, at, fan / np.linalg.norm(fan, axis=1, keepdims=True))
        wide[number] = (weights * strength) @ there / (weights @ strength)
    cloud = Cloud(rays * wide[:, None], np.full(12, 5e-5), rays, BEAM_RAD * wide, None, wide)
    made, known = narrow_beams(shape, cloud, at)
    assert known.sum() >= 6
    off, before = np.linalg.norm(made.points, axis=1) - thin, wide - thin
    assert np.abs(off[known]).max() < 2e-8 + 0.02 * np.abs(before[known]).max()
    assert np.abs(before[known]).max() > 4e-8
