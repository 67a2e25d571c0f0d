"""The compiled distances against the difference written out corner by corner."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.reference_distances import signed_distance
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry.distance import Separations
from cellwright.engine.kernels.geometry.room import Room
from cellwright.engine.kernels.geometry.segments import segment_block_gap, segment_gap
from cellwright.engine.kernels.rigid import rotation
from cellwright.engine.model.geometry import ConvexPiece
from cellwright.engine.stages.geometry.shapes.convex_pieces import pack_pieces
from cellwright.engine.stages.geometry.shapes.hulls import FlatError, hull_planes, hull_triangles

kinds = st.sampled_from(["point", "segment", "block", "cloud", "plate"])
seeds = st.integers(0, 2**32 - 1)


def body(kind: str, rng: np.random.Generator) -> Floats:
    vertices = {
        "point": np.zeros((1, 3)),
        "segment": np.array([[0, 0, -0.5], [0, 0, 0.5]]),
        "block": np.array(list(product((-0.5, 0.5), repeat=3))) * rng.uniform(0.1, 1, 3),
        "cloud": rng.normal(size=(int(rng.integers(4, 12)), 3)) * 0.4,
        "plate": rng.normal(size=(4, 3)) * (0.5, 0.5, 0.0),
    }[kind]
    axis = rng.normal(size=3)
    turned = (
        rotation(axis / np.linalg.norm(axis), float(rng.uniform(0, 6)))
        if rng.random() < 0.6
        else np.eye(3)
    )
    shift = rng.normal(size=3) * rng.choice([0.0, 0.3, 1.0])
    return vertices @ turned.T + (np.round(shift * 2) / 2 if rng.random() < 0.4 else shift)


def compiled(
    first: Floats, second: Floats, radii: tuple[float, float] = (0.0, 0.0)
) -> tuple[float, Floats]:
    rows, split = np.vstack([first, second]), len(first)
    separations = Separations(rows, max(split, len(second)))
    found = separations.separation(0, split, radii[0], split, len(second), radii[1])
    return found, separations.found


def standing(*pieces: ConvexPiece) -> Room:
    return Room(pack_pieces(pieces), np.empty((0, 1, 3, 4)))


@settings(max_examples=150, deadline=None)
@given(kinds, kinds, seeds)
def test_compiled_distances_agree_with_the_plain_ones(one: str, other: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = body(one, rng), body(other, rng)
    assert math.isclose(compiled(first, second)[0], signed_distance(first, second), abs_tol=1e-9)


@settings(max_examples=80, deadline=None)
@given(kinds, kinds, seeds)
def test_distances_are_symmetric_and_the_normal_turns_round(
    one: str, other: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    first, second = body(one, rng), body(other, rng)
    there, back = compiled(first, second), compiled(second, first)
    assert math.isclose(there[0], back[0], abs_tol=1e-9)
    if there[0] > 1e-6:
        assert np.abs(there[1][6:] + back[1][6:]).max() < 1e-5


@settings(max_examples=80, deadline=None)
@given(kinds, kinds, seeds, st.floats(0, 0.3), st.floats(0, 0.3))
def test_witness_points_stand_as_far_apart_as_is_said_along_the_normal(
    one: str, other: str, seed: int, ra: float, rb: float
) -> None:
    rng = np.random.default_rng(seed)
    first, second = body(one, rng), body(other, rng)
    distance, out = compiled(first, second, (ra, rb))
    assert math.isclose(float(np.linalg.norm(out[6:])), 1.0, abs_tol=1e-9)
    assert np.abs(out[3:6] - out[:3] - distance * out[6:]).max() < 1e-7
    assert math.isclose(distance, compiled(first, second)[0] - ra - rb, abs_tol=1e-9)


@settings(max_examples=80, deadline=None)
@given(kinds, kinds, seeds)
def test_moving_by_the_depth_along_the_normal_parts_two_bodies(
    one: str, other: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    first, second = body(one, rng), body(other, rng)
    distance, out = compiled(first, second)
    if distance < 0:
        parted = compiled(first, second - (distance - 1e-9) * out[6:])[0]
        assert -1e-9 <= parted < 1e-6


@settings(max_examples=80, deadline=None)
@given(st.sampled_from(["point", "segment"]), st.sampled_from(["point", "segment"]), seeds)
def test_segments_have_a_formula_of_their_own(one: str, other: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = body(one, rng), body(other, rng)
    pieces = [ConvexPiece("", 0, np.eye(4), vertices, 0.0) for vertices in (first, second)]
    gap = segment_gap(standing(*pieces), 0, 1)
    assert math.isclose(math.sqrt(gap), max(0.0, compiled(first, second)[0]), abs_tol=1e-7)


@settings(max_examples=120, deadline=None)
@given(st.sampled_from(["point", "segment"]), seeds)
def test_segments_and_blocks_have_a_formula_of_their_own(one: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    segment, half = body(one, rng), rng.uniform(0.05, 0.5, 3)
    axis = rng.normal(size=3)
    pose = np.eye(4)
    pose[:3, :3] = rotation(axis / np.linalg.norm(axis), 1.0)
    corners = np.array(list(product((-1, 1), repeat=3))) * half
    middle = rng.normal(size=3) * 0.2
    block = ConvexPiece("", 0, pose, corners + middle, 0.0, box=True)
    gap = segment_block_gap(standing(ConvexPiece("", 0, np.eye(4), segment, 0.0), block), 0, 1)
    plain = signed_distance(segment, (corners + middle) @ pose[:3, :3].T)
    assert math.isclose(math.sqrt(gap), max(0.0, plain), abs_tol=1e-7)


@settings(max_examples=100, deadline=None)
@given(seeds, st.integers(4, 30))
def test_all_points_are_within_their_hull_and_its_surface_is_closed(seed: int, count: int) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    triangles = hull_triangles(points)
    normals, offsets = hull_planes(points, triangles)
    assert (points @ normals.T - offsets).max() < 1e-9
    edges = {(int(t[i]), int(t[(i + 1) % 3])) for t in triangles for i in range(3)}
    assert len(edges) == 3 * len(triangles)
    assert all((b, a) in edges for a, b in edges)
    assert len(triangles) == 2 * len(np.unique(triangles)) - 4


def test_a_hull_of_points_in_a_plane_is_refused() -> None:
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 0.5, 0]])
    for points in (flat, flat[:3], flat[[0, 1, 1, 1]], np.zeros((6, 3))):
        with pytest.raises(FlatError):
            hull_triangles(points)
