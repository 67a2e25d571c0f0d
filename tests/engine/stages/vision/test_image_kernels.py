"""The compiled loops over depth images say what plain readings of the same words say."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.rigid import apply, rotation_by_vector, transform
from cellwright.engine.stages.vision.kernels.rims import border, ends
from cellwright.engine.stages.vision.kernels.samples import Samples, seen


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_border_is_where_a_mask_ends_and_points_away_from_what_is_near(seed: int) -> None:
    random = np.random.default_rng(seed)
    mask = random.random((9, 11)) < random.uniform(0.3, 1.0)
    at, outward = border(mask)
    expected = {
        (u, v): way for v, u in np.argwhere(mask) if (way := plain_way(mask, v, u)) is not None
    }
    assert {(int(u), int(v)) for u, v in at} == set(expected)
    for (u, v), way in zip(at, outward, strict=True):
        assert np.allclose(way, expected[int(u), int(v)])


def plain_way(mask: Truths, v: int, u: int) -> Floats | None:
    """The direction out of a mask at one of its pixels; None if it is not on the border."""
    beside = [(v - 1, u), (v + 1, u), (v, u - 1), (v, u + 1)]
    height, width = mask.shape
    if all(mask[y, x] for y, x in beside if 0 <= y < height and 0 <= x < width):
        return None
    near = [(u - x, v - y) for y, x in np.argwhere(mask) if (x - u) ** 2 + (y - v) ** 2 <= 18]
    near = [(x, y) for x, y in near if abs(x) <= 4 and abs(y) <= 4]
    way = np.sum(near, axis=0).astype(float)
    length = float(np.linalg.norm(way))
    return way / length if length else None


def test_a_surface_ends_where_the_image_becomes_deeper_and_goes_on_where_it_does_not() -> None:
    inverse = np.full((20, 40), 1.0)
    inverse[:, 23:] = 0.5
    planes, outward = (
        np.tile([0.0, 0.0, 1.0], (3, 1)),
        np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
    )
    at = np.array([[20.0, 5.0], [10.0, 5.0], [10.0, 10.0]])
    picture = np.zeros((20, 21)), np.zeros((20, 21), dtype=np.int64)
    shift, goes_on = ends(inverse, planes, at, outward, 5, 0.003, *picture, (0, 0))
    assert shift[0] == 2.0
    assert np.isnan(shift[1:]).all()
    assert goes_on.tolist() == [False, True, True]


def test_other_facets_of_the_part_that_lie_deeper_are_no_end_of_this_one() -> None:
    """A narrow facet: what is crossed on the way to it lies elsewhere, and is seen where it is."""
    inverse = np.full((20, 40), 0.5)
    inverse[:, 10:19], inverse[:, 19:21] = 1 / 1.05, 1.0
    planes, outward, at = (
        np.array([[0.0, 0.0, 1.0]]),
        np.array([[1.0, 0.0]]),
        np.array([[20.0, 5.0]]),
    )
    depth, owner = np.full((20, 11), 1.05), np.zeros((20, 11), dtype=np.int64)
    depth[:, 9:], owner[:, 9:] = 1.0, 1
    shift, _ = ends(inverse, planes, at, outward, 5, 0.003, depth, owner, (10, 0))
    assert shift.tolist() == [0.0]
    inverse[:, 16:18] = 0.8
    assert ends(inverse, planes, at, outward, 5, 0.003, depth, owner, (10, 0))[0].tolist() == [0.0]


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_points_of_a_surface_are_counted_as_their_pixels_say(seed: int) -> None:
    random = np.random.default_rng(seed)
    depth = np.where(random.random((12, 16)) < 0.2, 0.0, random.uniform(0.8, 1.2, (12, 16)))
    points, normals = random.uniform(-0.3, 0.3, (20, 3)), random.normal(size=(20, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    poses = np.array(
        [transform(rotation_by_vector(random.normal(size=3)), (0, 0, 1.0)) for _ in range(4)]
    )
    optics = np.array([16.0, 7.5, 5.5])
    agree, through = seen(Samples(depth, optics, points, normals, 0.3), poses, 0.1)
    for n, T in enumerate(poses):
        apart = [
            plain_apart(depth, optics, p, T[:3, :3] @ normal)
            for p, normal in zip(apply(T, points), normals, strict=True)
        ]
        assert agree[n] == sum(each is not None and abs(each) <= 0.1 for each in apart)
        assert through[n] == sum(each is not None and each > 0.1 for each in apart)


def plain_apart(depth: Floats, optics: Floats, point: Floats, normal: Floats) -> float | None:
    """How much deeper the image is than a point; None if the point is not asked for, or not in
    the image.
    """
    if point @ normal >= -0.3 * np.linalg.norm(point):
        return None
    u, v = (math.floor(optics[0] * point[k] / point[2] + optics[k + 1] + 0.5) for k in (0, 1))
    if not (0 <= v < depth.shape[0] and 0 <= u < depth.shape[1] and depth[v, u] > 0):
        return None
    return float(depth[v, u] - point[2])
