"""Motions in the bundled cells: straight lines, touches, upright paths, zones, and why a line
breaks.
"""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cellwright.engine.model.motion_values import Blocked, Moved, Strategy
from cellwright.engine.pipelines.motion.arm_motion import (
    ArmMotion,
    MotionSite,
    MotionWish,
    _search_starts,
    plan_named_motion,
)
from cellwright.engine.pipelines.motion.leg_timing import zones_of
from cellwright.engine.pipelines.motion.motion_legs import (
    APPROACH,
    FREE,
    LegDepartures,
    MotionEnd,
    MotionLeg,
    leg_of,
    lines_out,
)
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.reach.arm_hand import (
    STRAY_M,
    ArmHand,
    BrokenLine,
    straight_line,
)
from cellwright.engine.stages.geometry.reach.place_reachability import ReachedPlace
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.body_shapes import Box, Pose
from cellwright.kb.model.cell_model import Placement, Zone
from tests.engine.stages.motion.conftest import arm_among, block


@pytest.fixture(scope="module")
def bulkhead() -> MotionSite:
    return MotionSite.of("bulkhead")


@pytest.fixture(scope="module")
def themse() -> MotionSite:
    return MotionSite.of("themse")


def tool_points(motion: ArmMotion) -> np.ndarray:
    times = np.linspace(0.0, motion.times.duration_s, 2000)
    whole = np.repeat(motion.whole()[:1], len(times), axis=0)
    whole[:, motion.own] = motion.times.at(times)[0]
    return motion.hand.poses(whole)


def test_the_tool_goes_straight_into_a_place_and_straight_out(bulkhead: MotionSite) -> None:
    found = plan_named_motion(bulkhead, "meas(m1)", ["meas(m2)"])
    assert [leg.kind for leg in found.legs] == ["retract", "free", "approach"]
    assert found.proved
    for leg in (found.legs[0], found.legs[-1]):
        points = found.hand.poses(leg.path)[:, :3, 3]
        way = points[-1] - points[0]
        off = np.linalg.norm(np.cross(points - points[0], way / np.linalg.norm(way)), axis=1)
        assert off.max() < 1e-6
        assert np.linalg.norm(way) == pytest.approx(0.12, abs=1e-6)


def test_between_its_configurations_the_tool_stays_near_the_line(bulkhead: MotionSite) -> None:
    found = plan_named_motion(bulkhead, "home", ["meas(m2)"])
    line = found.legs[-1].path
    fine = np.concatenate([a + np.linspace(0, 1, 50)[:, None] * (b - a) for a, b in pairwise(line)])
    points = found.hand.poses(fine)[:, :3, 3]
    way = points[-1] - points[0]
    off = np.linalg.norm(np.cross(points - points[0], way / np.linalg.norm(way)), axis=1)
    assert off.max() < 2 * STRAY_M


def test_a_line_that_breaks_says_at_which_joint_and_limit(bulkhead: MotionSite) -> None:
    found = plan_named_motion(bulkhead, "home", ["meas(m2)"])
    q = found.whole()[-1]
    far = found.hand.poses(q[None])[0] @ transforms.translation(0.0, 0.0, -1.5)
    broken = straight_line(found.hand, q, far)
    assert isinstance(broken, BrokenLine)
    assert 0.0 < broken.share <= 1.0
    assert any(said in broken.why for said in ("limit", "singularity", "branch", "out of reach"))


def pressing(site: MotionSite, depth_m: float) -> MotionLeg:
    """The line into a point 4 mm below the surface of the web, of which `depth_m` are declared."""
    place = site.world.cell.places["meas(m2)"]
    x, y, _ = place.placement.pose.position_m
    lower = replace(place.placement, pose=replace(place.placement.pose, position_m=(x, y, 0.004)))
    place = replace(place, placement=lower)
    answer = site.reach.at(place)
    assert isinstance(answer, ReachedPlace)
    checker = site.reach.checker(place)
    hand = ArmHand(site.world, checker.scene, place.arm, site.reach.flange_to_end(place))
    q = answer.q[0]
    line = straight_line(
        hand, q, hand.poses(q[None])[0] @ transforms.translation(0.0, 0.0, -place.approach_m)
    )
    assert not isinstance(line, BrokenLine)
    assert isinstance(site.reach.at(replace(place, depth_m=depth_m)), ReachedPlace) == (
        depth_m > 0.004
    )
    return leg_of(APPROACH, line, replace(place, depth_m=depth_m), site.reach)


def test_what_touches_by_intention_is_proved_pair_by_pair(bulkhead: MotionSite) -> None:
    leg = pressing(bulkhead, 0.005)
    (touch,) = leg.touches
    assert {touch.first, touch.second} == {"us_probe", "web"}
    assert leg.proved
    assert touch.deepest_m == pytest.approx(0.004, abs=1e-6)


def test_a_touch_deeper_than_declared_is_not_proved(bulkhead: MotionSite) -> None:
    leg = pressing(bulkhead, 0.003)
    assert not leg.proved
    (touch,) = leg.touches
    assert touch.deepest_m > touch.allowed_m


def test_a_line_on_which_something_goes_too_deep_is_left_out_where_another_does_not(
    bulkhead: MotionSite,
) -> None:
    place = replace(bulkhead.world.cell.places["meas(m2)"], depth_m=0.002)
    x, y, _ = place.placement.pose.position_m
    found = []
    for depth in (0.004, 0.001):
        pose = replace(place.placement.pose, position_m=(x, y, depth))
        there = bulkhead.reach.at(
            replace(place, depth_m=0.005, placement=replace(place.placement, pose=pose))
        )
        assert isinstance(there, ReachedPlace)
        found.append(there.q[0])
    hand = ArmHand(
        bulkhead.world,
        bulkhead.reach.checker(place).scene,
        place.arm,
        bulkhead.reach.flange_to_end(place),
    )
    end = MotionEnd("meas(m2)", place.arm, np.array(found), place)
    both = lines_out(end, np.array(found), bulkhead.reach, hand, "--to")
    assert [line[0].tolist() for line in both.lines if line is not None] == [found[1].tolist()]
    deep = lines_out(end, np.array(found[:1]), bulkhead.reach, hand, "--to")
    assert len(deep.lines) == 1  # it is told later that this one is not proved


@pytest.mark.parametrize("goal", ["meas(m2)", pytest.param("meas(m11)", marks=pytest.mark.slow)])
def test_without_straight_lines_what_may_touch_goes_no_deeper_than_it_may(
    bulkhead: MotionSite, goal: str
) -> None:
    found = plan_named_motion(bulkhead, "meas(m1)", [goal], MotionWish(direct=True))
    assert [leg.kind for leg in found.legs] == [FREE]
    assert found.proved
    assert all(each.deepest_m <= each.allowed_m for each in found.legs[0].touches)
    whole = np.repeat(found.whole()[:1], 3000, axis=0)
    whole[:, found.own] = found.times.at(np.linspace(0.0, found.times.duration_s, 3000))[0]
    place = bulkhead.world.cell.places["meas(m1)"]
    assert bulkhead.reach.meeting(place).clearance(whole).min() >= -place.depth_m


def test_a_start_that_is_walled_in_gives_way_to_the_next_one() -> None:
    posts = [block("post", (0.8 * np.cos(a), 0.8 * np.sin(a)), (0.1, 0.1)) for a in (1.0, -2.0)]
    ground, goal = PlanningScene(BuiltinChecker(arm_among(posts))), np.array([[2.0, 0.5]])
    starts = np.array([[0.0, 0.0], [0.1, 0.0], [2.4, 0.0]])
    ways = [LegDepartures(each, (None,) * len(each), None) for each in (starts, starts[:2], goal)]
    hand: Any = SimpleNamespace(own=slice(0, 2))
    first, _, answer = _search_starts(ground, hand, ways[0], ways[2:], MotionWish(budget=5000))
    assert isinstance(answer, Moved)
    assert first == 2
    assert answer.proved
    assert np.array_equal(answer.path[0], starts[2])
    first, _, answer = _search_starts(ground, hand, ways[1], ways[2:], MotionWish(budget=5000))
    assert isinstance(answer, Blocked)
    assert first == 0
    assert answer.severed is not None  # from each of them


@pytest.mark.parametrize("strategy", list(Strategy))
def test_every_strategy_finds_a_proved_way_in_both_cells(
    bulkhead: MotionSite, themse: MotionSite, strategy: Strategy
) -> None:
    wish = MotionWish(strategy=strategy)
    assert plan_named_motion(bulkhead, "home", ["meas(m9)"], wish).proved
    assert plan_named_motion(themse, "slot(drawer, 1)", ["slot(freezer, 1)"], wish).proved


def test_of_several_places_one_is_reached(themse: MotionSite) -> None:
    found = plan_named_motion(themse, "home", ["slot(freezer, 1)", "flap"])
    assert found.goal in ("slot(freezer, 1)", "flap")
    assert found.proved


def test_an_upright_vessel_tilts_no_more_than_it_may(themse: MotionSite) -> None:
    found = plan_named_motion(
        themse, "slot(drawer, 1)", ["slot(freezer, 1)"], MotionWish(upright_rad=np.radians(5))
    )
    assert isinstance(found.answer, Moved)
    poses = tool_points(found)
    up = poses[0, :3, :3].T @ [0, 0, 1]
    tilts = np.arccos(np.clip((poses[:, :3, :3] @ up)[:, 2], -1, 1))
    assert tilts.max() <= np.radians(5) + 1e-6


def test_in_a_zone_no_point_of_the_arm_is_faster_than_it_may_be(themse: MotionSite) -> None:
    zone = Zone(
        "people", Box((0.7, 0.5, 0.6)), Placement("world", Pose((0.6, -0.4, 1.2), (0, 0, 0))), 0.2
    )
    world = replace(themse.world, cell=replace(themse.world.cell, zones={"people": zone}))
    free = plan_named_motion(themse, "slot(drawer, 1)", ["slot(freezer, 1)"])
    slow = plan_named_motion(replace(themse, world=world), "slot(drawer, 1)", ["slot(freezer, 1)"])
    assert slow.times.slow == ("people",)
    corners = slow.times.corners_s()
    assert len(corners) == len(slow.whole())
    assert corners[-1] == pytest.approx(slow.times.duration_s)
    assert slow.times.duration_s > free.times.duration_s
    times = np.linspace(0.0, slow.times.duration_s, 4000)
    whole = np.repeat(slow.whole()[:1], len(times), axis=0)
    whole[:, slow.own] = slow.times.at(times)[0]
    points = slow.hand.poses(whole)[:, :3, 3]
    speeds = np.linalg.norm(np.diff(points, axis=0), axis=1) / np.diff(times)
    (people,) = zones_of(world, slow.ground)
    inside = people.ground.collides(whole)[:-1]
    assert inside.any()
    assert speeds[inside].max() <= 0.2 + 1e-3
    assert speeds[~inside].max() > 0.2


def test_a_point_may_leave_the_turn_about_its_axis_open(bulkhead: MotionSite) -> None:
    fixed = plan_named_motion(
        bulkhead, "home", ["point 1.2, 0.3, 1.5"], MotionWish(tool="us_probe")
    )
    open_ = plan_named_motion(
        bulkhead, "home", ["point 1.2, 0.3, 1.5 turns"], MotionWish(tool="us_probe")
    )
    assert isinstance(fixed.answer, Moved)
    assert isinstance(open_.answer, Moved)
    assert np.allclose(open_.hand.poses(open_.whole()[-1:])[0, :3, 3], [1.2, 0.3, 1.5], atol=1e-6)
    assert open_.times.duration_s <= fixed.times.duration_s + 1e-9


def test_ends_of_two_tools_are_refused(bulkhead: MotionSite) -> None:
    with pytest.raises(InvalidInput, match="two tools"):
        plan_named_motion(bulkhead, "meas(m1)", ["meas(m4)"])
