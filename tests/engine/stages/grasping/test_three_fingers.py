"""Grasps by three fingers: closed by force, on the surface, and strong enough whichever way the
part is turned.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.manipulation_values import Grasp, ThreeFingers
from cellwright.engine.stages.geometry.shapes.facet_solids import make_solid, triangulate_polygon
from cellwright.engine.stages.grasping.grasp_synthesis import (
    GRAVITY_M_S2,
    blocks_meet,
    closes_by_force,
    contact_wrenches,
    three_finger_grasps,
)
from cellwright.engine.stages.grasping.stable_placements import volume_and_centre

HAND = ThreeFingers(0.1, 0.016, 0.06, 0.012, (0.08, 0.08, 0.03), (0.06, 0.06, 0.03))
INSET_M, MASS_KG = 0.012, 0.3


def prism(corners: Floats, height: float) -> Solid:
    """The prism over a polygon (n, 2), counter-clockwise."""
    low = np.column_stack([corners, np.zeros(len(corners))])
    high = low + np.array([0.0, 0.0, height])
    up = np.array([0.0, 0.0, 1.0])
    surfaces = [
        ("top", triangulate_polygon(high, up)),
        ("bottom", triangulate_polygon(low[::-1], -up)),
    ]
    for n in range(len(corners)):
        m = (n + 1) % len(corners)
        side = np.array([low[n], low[m], high[m], high[n]])
        normal = np.cross(side[1] - side[0], side[2] - side[1])
        surfaces.append(
            (f"side_{n + 1}", triangulate_polygon(side, normal / np.linalg.norm(normal)))
        )
    return make_solid("prism", surfaces)


def regular(count: int, radius: float = 0.03) -> Solid:
    angles = np.arange(count) * 2 * np.pi / count
    return prism(radius * np.column_stack([np.cos(angles), np.sin(angles)]), 0.05)


def grasps(part: Solid) -> list[Grasp]:
    return three_finger_grasps(part, HAND, INSET_M, MASS_KG, volume_and_centre(part)[1], 24)


def contacts_of(part: Solid, grasp: Grasp) -> Floats:
    """The contacts that the fingers' ways lead to: three points in the part's frame, and the
    normals of their facets.
    """
    begins, outwards = HAND.ways(grasp.fingers[3])
    T = grasp.T_part_hand[0]
    points = T[:3, 3] + (begins + outwards * np.array(grasp.fingers[:3])[:, None]) @ T[:3, :2].T
    named = {each.name: each for each in part.facets}
    return np.array([*points, *(named[name].normal for name in grasp.facets)])


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, 4, 6, 8])
def test_fingers_meet_the_facets_that_are_named_and_the_hand_meets_nothing(count: int) -> None:
    part = regular(count)
    named = {each.name: each for each in part.facets}
    found = grasps(part)
    assert found
    for grasp in found:
        contacts = contacts_of(part, grasp)
        for point, name in zip(contacts[:3], grasp.facets, strict=True):
            assert abs(named[name].normal @ point - named[name].offset) < 1e-9
        assert not blocks_meet(grasp.T_part_hand, *HAND.blocks(grasp.opening), part.corners)[0]
        assert grasp.width_m <= HAND.opening_m


def test_a_triangle_is_held_at_its_three_sides() -> None:
    sides = {"side_1", "side_2", "side_3"}
    assert any(set(each.facets) == sides for each in grasps(regular(3)))


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(st.integers(3, 8), st.integers(0, 2**31))
def test_the_weight_is_held_whichever_way_it_pulls(count: int, seed: int) -> None:
    """What is held along the axes is held in all directions by convexity, a third of the root
    less.
    """
    part = regular(count)
    centre = volume_and_centre(part)[1]
    grasp = grasps(part)[0]
    W = contact_wrenches(contacts_of(part, grasp), centre, HAND.friction)
    pull = np.random.default_rng(seed).normal(size=3)
    pull *= grasp.torque_margin * MASS_KG * GRAVITY_M_S2 / math.sqrt(3) / np.linalg.norm(pull)
    presses = np.kron(np.eye(3), np.ones(W.shape[1] // 3))
    balance = np.concatenate([-pull, np.zeros(3)])
    found = linprog(
        np.zeros(W.shape[1]),
        A_ub=presses,
        b_ub=np.full(3, HAND.force_n),
        A_eq=W,
        b_eq=balance,
        method="highs",
    )
    assert found.status == 0


def around(*degrees: float) -> Floats:
    """Contacts on a disc at some angles."""
    angles = np.radians(degrees)
    out = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(3)])
    return np.concatenate([0.03 * out, out])


def test_contacts_all_around_close_by_force_and_contacts_on_one_side_do_not() -> None:
    assert closes_by_force(around(0, 120, 240), np.zeros(3), 0.4)
    assert closes_by_force(around(0, 170, 190), np.zeros(3), 0.4)
    assert not closes_by_force(around(0, 60, 90), np.zeros(3), 0.4)
    assert not closes_by_force(around(0, 120, 240), np.zeros(3), 0.0)
