"""Grasps, placements and regrasps: what a hand can take, how parts lie, and the shortest way
between the two.
"""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.rigid import apply, rotation_by_vector, transform
from cellwright.engine.model.manipulation_values import (
    HandApproach,
    NoApproach,
    ParallelJaws,
    Regrasps,
    Unplaceable,
)
from cellwright.engine.stages.grasping.grasp_approach import (
    GraspPlane,
    approach_by_potential,
    plan_approach,
)
from cellwright.engine.stages.grasping.grasp_synthesis import blocks_meet, jaw_grasps
from cellwright.engine.stages.grasping.stable_placements import (
    shortest_regrasps,
    stable_placements,
    volume_and_centre,
)
from tests.engine.stages.solids import block, ell, prism

JAWS = ParallelJaws(0.08, 0.016, 0.06, 0.012, (0.14, 0.04, 0.03), (0.06, 0.06, 0.03))
MIDDLE = np.zeros(3)


def test_a_block_is_taken_by_the_two_pairs_of_sides_that_the_jaws_open_for() -> None:
    found = jaw_grasps(block(0.04, 0.06, 0.12), JAWS, 0.02, 0.3, MIDDLE)
    assert {frozenset(each.facets) for each in found} == {
        frozenset(("side_2", "side_4")),
        frozenset(("side_1", "side_3")),
    }
    assert all(each.width_m <= JAWS.opening_m for each in found)


def test_a_part_wider_than_the_jaws_cannot_be_taken() -> None:
    assert not jaw_grasps(block(0.09, 0.1, 0.12), JAWS, 0.02, 0.3, MIDDLE)


def test_a_grasp_far_from_the_centre_of_mass_of_a_heavy_part_slips() -> None:
    light = jaw_grasps(block(0.04, 0.09, 0.3), JAWS, 0.012, 0.2, MIDDLE)
    heavy = jaw_grasps(block(0.04, 0.09, 0.3), JAWS, 0.012, 2.0, MIDDLE)
    assert len(heavy) < len(light)


def test_a_channel_is_not_taken_across_its_gap() -> None:
    """Its outer faces are parallel, but above the base there is air between them.

    The faces of the gap look inwards.
    """
    outline = [
        (0.0, 0.0),
        (0.07, 0.0),
        (0.07, 0.12),
        (0.05, 0.12),
        (0.05, 0.02),
        (0.02, 0.02),
        (0.02, 0.12),
        (0.0, 0.12),
    ]
    found = jaw_grasps(
        prism("channel", outline, 0.09), JAWS, 0.012, 0.1, np.array([0.035, 0.05, 0.0])
    )
    across = [each for each in found if each.width_m == pytest.approx(0.07)]
    assert found
    assert all(each.T_part_hand[0, 1, 3] < 0.02 for each in across)


def test_a_lying_block_has_six_placements_and_loses_those_that_its_weight_tips() -> None:
    assert len(stable_placements(block(0.04, 0.06, 0.12), MIDDLE)) == 6
    far = stable_placements(block(0.04, 0.06, 0.12), np.array([0.03, 0.0, 0.0]))
    assert {each.facet for each in far} == {"side_2", "side_4"}


def test_placed_parts_lie_on_the_table_with_their_middle_above_the_origin() -> None:
    solid = ell(0.1, 0.08, 0.03, 0.05)
    _, centre = volume_and_centre(solid)
    for each in stable_placements(solid, centre):
        points = apply(each.T_table_part, solid.vertices)
        assert points[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        assert apply(each.T_table_part, centre[None])[0, :2] == pytest.approx((0, 0), abs=1e-9)


def test_volume_and_centre_of_an_angle_are_those_of_its_two_blocks() -> None:
    volume, centre = volume_and_centre(ell(0.1, 0.08, 0.03, 0.05))
    first, second = 0.1 * 0.03 * 0.05, 0.03 * 0.05 * 0.05
    assert volume == pytest.approx(first + second)
    assert centre[0] == pytest.approx((first * 0.05 + second * 0.015) / (first + second))


def brute_force(start: Truths, goal: Truths, possible: Truths) -> int | None:
    """The least number of regrasps, by trying all sequences of rests up to their number."""
    holds, rests = possible.shape
    for count in range(rests + 1):
        for sequence in product(range(rests), repeat=count):
            held = start.copy()
            for rest in sequence:
                held = (
                    possible[:, rest]
                    if (held & possible[:, rest]).any()
                    else np.zeros(holds, dtype=bool)
                )
            if (held & goal).any():
                return count
    return None


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    holds=st.integers(1, 6),
    rests=st.integers(0, 4),
    share=st.floats(0.1, 0.6),
)
def test_the_shortest_sequence_is_that_of_brute_force(
    seed: int, holds: int, rests: int, share: float
) -> None:
    random = np.random.default_rng(seed)
    start, goal = random.random((2, holds)) < share
    possible = random.random((holds, rests)) < share
    found, least = shortest_regrasps(start, goal, possible), brute_force(start, goal, possible)
    if isinstance(found, Unplaceable):
        assert least is None
        return
    assert len(found.then) == least
    hold = found.first
    assert start[hold]
    for rest, after in found.then:
        assert possible[hold, rest]
        assert possible[after, rest]
        hold = after
    assert goal[hold]


def test_three_regrasps_where_each_rest_changes_the_hold_once() -> None:
    chain = np.array([[1, 0, 0], [1, 1, 0], [0, 1, 1], [0, 0, 1]], dtype=bool)
    start, goal = np.array([1, 0, 0, 0], dtype=bool), np.array([0, 0, 0, 1], dtype=bool)
    assert shortest_regrasps(start, goal, chain) == Regrasps(0, ((0, 1), (1, 2), (2, 3)))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_block_and_a_triangle_meet_when_points_of_both_do(seed: int) -> None:
    random = np.random.default_rng(seed)
    T = transform(rotation_by_vector(random.normal(size=3)), random.normal(size=3) * 0.3)
    triangle = random.normal(size=(1, 3, 3)) * 0.6
    half = random.uniform(0.1, 0.6, (1, 3))
    weights = random.dirichlet((0.7, 0.7, 0.7), 3000)
    points = (weights @ triangle[0] - T[:3, 3]) @ T[:3, :3]
    hit = bool((np.abs(points) < half[0] * 0.999).all(axis=1).any())
    near = bool((np.abs(points) < half[0] + 0.05).all(axis=1).any())
    met = bool(blocks_meet(T[None], np.zeros((1, 3)), half, triangle)[0])
    assert met >= hit
    assert met <= near


def _meets_plainly(corners: Floats, half: Floats) -> Truths:
    """Whether triangles (..., 3, 3) meet a block about the origin (...)."""
    low, high = corners.min(axis=-2), corners.max(axis=-2)
    near = ((low < half) & (high > -half)).all(axis=-1)
    found: Truths = near
    if near.any():
        found[near] = ~_separated_plainly(corners[near], half)
    return found


def _separated_plainly(corners: Floats, half: Floats) -> Truths:
    """Whether the triangle's plane, or a plane along an edge of it and one of the block,
    separates them (n,).
    """
    edges = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(edges[:, 0], edges[:, 1])
    apart = np.abs((normal * corners[:, 0]).sum(axis=1)) > np.abs(normal) @ half
    axes = np.cross(edges[:, :, None], np.eye(3)).reshape(len(corners), 9, 3)
    heights = np.einsum("nai,nci->nac", axes, corners)
    reach = np.abs(axes) @ half
    long = np.linalg.norm(axes, axis=2) > 1e-12
    beyond = (heights.min(axis=2) >= reach) | (heights.max(axis=2) <= -reach)
    found: Truths = apart | (beyond & long).any(axis=1)
    return found


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_compiled_loops_say_what_the_plain_computation_says(seed: int) -> None:
    """Also on whole numbers, where sides just touch, and for triangles that are lines."""
    random = np.random.default_rng(seed)
    T = np.array(
        [
            transform(
                rotation_by_vector(random.normal(size=3) * (seed % 3)), random.uniform(-2, 2, 3)
            )
            for _ in range(4)
        ]
    )
    triangles = random.uniform(-3, 3, (20, 1, 3)) + random.uniform(-1, 1, (20, 3, 3))
    middles, halves = random.uniform(-1, 1, (2, 3)), random.uniform(0.1, 0.5, (2, 3))
    if seed % 2:
        triangles[:, 2] = triangles[:, 1]
    if seed % 3 == 0:
        T[:, :3, 3], triangles = np.round(T[:, :3, 3]), np.round(triangles)
        middles, halves = np.round(middles), np.full((2, 3), 0.5)
    local = (triangles[None] - T[:, None, None, :3, 3]) @ T[:, None, :3, :3]
    plainly = np.zeros(4, dtype=bool)
    for middle, half in zip(middles, halves, strict=True):
        plainly |= _meets_plainly(local - middle, half).any(axis=1)
    np.testing.assert_array_equal(blocks_meet(T, middles, halves, triangles), plainly)


def plane(*points: tuple[float, float, float]) -> GraspPlane:
    """A grasp of 40 mm among some points."""
    return GraspPlane(np.array(points).reshape(-1, 3), JAWS, (0.04,))


def test_a_hand_comes_straight_down_where_nothing_stands() -> None:
    found = plan_approach(plane(), np.array([0.0, -0.15, 0.0]))
    assert isinstance(found, HandApproach)
    assert (found.poses[0] == [0.0, -0.15, 0.0]).all()
    assert (found.poses[-1] == 0.0).all()


def trap() -> GraspPlane:
    """A wall across the straight way, bent towards the hand: the pull leads into it."""
    y = np.linspace(-0.06, 0.06, 25)
    wall = [(x, each, -0.1) for each in y for x in (-0.03, 0.03)]
    sides = [
        (x, side, z)
        for z in np.linspace(-0.16, -0.1, 13)
        for side in (-0.06, 0.06)
        for x in (-0.03, 0.03)
    ]
    return plane(*wall, *sides)


def test_the_complete_planner_gets_round_a_trap_in_which_potentials_are_stuck() -> None:
    outside = np.array([0.0, -0.25, 0.0])
    ways = plan_approach(trap(), outside), approach_by_potential(trap(), outside)
    assert isinstance(ways[0], HandApproach)
    assert trap().free(ways[0].poses).all()
    assert isinstance(ways[1], NoApproach)


def test_potentials_lead_down_where_the_way_is_open() -> None:
    found = approach_by_potential(plane((0.0, 0.2, 0.0)), np.array([0.02, -0.15, 0.2]))
    assert isinstance(found, HandApproach)


def test_a_closed_ring_is_told() -> None:
    angle = np.linspace(0, 2 * np.pi, 400)
    ring = [(x, 0.14 * np.cos(a), 0.14 * np.sin(a)) for a in angle for x in (-0.03, 0.0, 0.03)]
    found = plan_approach(plane(*ring), np.array([0.0, -0.29, 0.0]))
    assert isinstance(found, NoApproach)


def test_the_layers_of_the_hand_have_obstacles_of_their_own() -> None:
    """What stands between the fingers stops the cross-piece, and not the fingers."""
    between = plane((0.0, 0.0, -0.045))
    assert not between.free(np.array([[0.0, 0.02, 0.0]]))[0]
    assert between.free(np.array([[0.0, 0.0, 0.0]]))[0]
