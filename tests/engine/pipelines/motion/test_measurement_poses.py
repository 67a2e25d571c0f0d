"""Poses of measurements: found together as alone, kept as long as nothing near them changes,
and refused with a reason.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from cellwright.engine.model.part_measurements import asked_for
from cellwright.engine.pipelines.inspection.measurement_places import with_measured_places
from cellwright.engine.pipelines.motion import measurement_poses
from cellwright.engine.pipelines.motion.cell_state import BodyRide, CellState
from cellwright.engine.pipelines.motion.measurement_poses import (
    PoseKnowledge,
    known_poses,
    with_stations,
)
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.kinematics.inverse_kinematics import InverseKinematics
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.grounding.pruning import drop_irrelevant_objects
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.body_shapes import Box, PlacedShape, Pose
from cellwright.kb.model.cell_model import TOUCH_DEPTH_M, Body, BodyKind, Cell, Placement
from cellwright.kb.model.conditions import And, goal_parts
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Number

PROBLEM = "bulkhead/three_stations"
STATIONS = ("left", "middle", "right")


@pytest.fixture(scope="module")
def problem() -> Problem:
    return problem_of(PROBLEM)


@pytest.fixture(scope="module")
def cell() -> Cell:
    return cell_of(PROBLEM)


@pytest.fixture(scope="module")
def known(problem: Problem, cell: Cell) -> PoseKnowledge:
    return known_poses(problem, cell, geometry_backend())


def moved_to(problem: Problem, point: str, x: int, y: int) -> Problem:
    """The problem with one point elsewhere on the web, in micrometres."""
    at = Function("position", (Function(point), Number(x), Number(y), Number(0)))
    others = [
        each
        for each in problem.statics
        if each.name != "position" or str(each.arguments[0]) != point
    ]
    return replace(problem, statics=(*others, at))


def depths(cell: Cell, known: PoseKnowledge) -> list[float]:
    """How deep the probe is in what it may touch at the deepest of each way, looked at five
    times on each line.
    """
    found = []
    for each in (each for each in known.poses.values() if each.reached and each.tool == "us_probe"):
        world = GeometricWorld.of(cell).guided(
            "carriage", {"left": -1.6, "middle": 0.0, "right": 1.6}[each.station]
        )
        checker = geometry_backend().checker(collision_scene_of(world.held(each.tool, "t3_746")))
        whole = np.concatenate(
            [
                a + np.linspace(0.0, 1.0, 5)[:, None] * (b - a)
                for path in each.straight
                for a, b in pairwise(path)
            ]
        )
        met = [contact for q in whole for contact in checker.contacts(q)]
        found += [max((contact.depth_m for contact in met), default=0.0)]
    return found


@pytest.mark.slow
def test_a_point_at_the_foot_of_a_rib_is_not_reached_through_the_rib(
    problem: Problem, cell: Cell
) -> None:
    inside = known_poses(moved_to(problem, "a1", -200_000, -1_700_000), cell, geometry_backend())
    assert "us_probe touches ribs by 35 mm" in inside.unreached()["a1"]
    beside = known_poses(moved_to(problem, "a1", -200_000, -1_740_000), cell, geometry_backend())
    assert "a1" not in beside.unreached()


@pytest.mark.slow
@pytest.mark.parametrize(("depth_mm", "reached"), [(2, True), (7, False)])
def test_a_probe_may_lean_into_a_rib_as_deep_as_it_may_touch_and_no_deeper(
    problem: Problem, cell: Cell, depth_mm: int, reached: bool
) -> None:
    y = -1_700_000 - 15_000 - 20_000 + depth_mm * 1000  # half a rib, the radius of the probe
    known = known_poses(moved_to(problem, "a1", -200_000, y), cell, geometry_backend())
    assert ("a1" not in known.unreached()) == reached
    assert max(depths(cell, known)) <= TOUCH_DEPTH_M + 1e-9


@pytest.mark.slow
def test_all_points_keep_poses_that_enter_nothing(cell: Cell, known: PoseKnowledge) -> None:
    assert known.unreached() == {}
    assert max(depths(cell, known)) <= TOUCH_DEPTH_M


def test_poses_are_found_again_where_less_depth_is_allowed(
    problem: Problem, cell: Cell, known: PoseKnowledge
) -> None:
    places = {
        "meas(b1)": replace(
            with_measured_places(cell, problem, {"b1": "us_probe"}).places["meas(b1)"],
            depth_m=0.001,
        )
    }
    shallow = replace(cell, places={**cell.places, **places})
    again = known_poses(problem, shallow, geometry_backend(), known.poses)
    assert {key[0] for key, each in again.poses.items() if each is not known.poses.get(key)} == {
        "b1"
    }


def with_block(cell: Cell, at: tuple[float, float, float], size: float = 0.1) -> Cell:
    """The cell with one block more, in the frame of the bulkhead."""
    body = Body(
        "block",
        BodyKind.FIXTURE,
        Placement("bulkhead", Pose(at, (0.0, 0.0, 0.0))),
        (PlacedShape(Box((size, size, size))),),
    )
    return replace(cell, bodies={**cell.bodies, "block": body})


def test_poses_that_are_found_together_are_those_that_are_found_alone(
    problem: Problem, cell: Cell, known: PoseKnowledge, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measurement_poses, "POSES_AT_A_TIME", 1)
    alone = known_poses(problem, cell, geometry_backend())
    assert alone.poses.keys() == known.poses.keys()
    for key, each in alone.poses.items():
        other = known.poses[key]
        assert (each.reason, each.boxes, each.own, each.near) == (
            other.reason,
            other.boxes,
            other.own,
            other.near,
        )
        for one, same in zip(each.straight, other.straight, strict=True):
            assert np.array_equal(one, same)


def test_nothing_is_found_again_where_nothing_has_changed(
    problem: Problem, cell: Cell, known: PoseKnowledge
) -> None:
    again = known_poses(problem, cell, geometry_backend(), known.poses)
    assert (again.kept, again.made) == (len(known.poses), 0)
    far = known_poses(problem, with_block(cell, (0.0, 0.0, 3.0)), geometry_backend(), known.poses)
    assert far.made == 0


def test_only_what_is_asked_for_is_looked_at_and_the_rest_may_be_reached_from_anywhere(
    cell: Cell,
) -> None:
    some = problem_of(PROBLEM, "measured(_, _, meas(b1))")
    assert asked_for(some) == {"b1"}
    found = known_poses(some, cell, geometry_backend(), only=asked_for(some))
    assert {each.measurement for each in found.poses.values()} == {"b1"}
    assert found.unasked == {"a1", "a2", "c1", "c2"}
    bare = replace(some, statics=tuple(each for each in some.statics if each.name != "serves"))
    facts = {str(each) for each in with_stations(bare, found).statics if each.name == "serves"}
    assert facts - {f"serves({s}, b1)" for s in STATIONS} == {
        f"serves({s}, {n})" for s in STATIONS for n in found.unasked
    }


@pytest.mark.parametrize(
    "goals", ["", "measured(us_probe, _, _)", "measured(_, _, meas(b1)), hand_empty(t3_746)"]
)
def test_where_a_goal_names_no_measurement_all_are_looked_at(goals: str) -> None:
    assert asked_for(problem_of(PROBLEM, goals)) is None


def test_a_block_before_one_point_touches_only_the_poses_near_it_and_takes_the_point_away(
    problem: Problem, cell: Cell, known: PoseKnowledge
) -> None:
    x, y = next(
        (float(fact.arguments[1].value) * 1e-6, float(fact.arguments[2].value) * 1e-6)  # type: ignore[union-attr]
        for fact in problem.statics
        if fact.name == "position" and str(fact.arguments[0]) == "a1"
    )
    changed = with_block(cell, (x, y, -0.1))
    again = known_poses(problem, changed, geometry_backend(), known.poses)
    assert 0 < again.made < len(known.poses)
    fresh = known_poses(problem, changed, geometry_backend())
    assert again.unreached() == fresh.unreached()
    assert set(again.unreached()) == {"a1"}
    assert "block" in again.unreached()["a1"]
    told = with_stations(problem, again)
    assert any(
        fact.name == "impossible" and str(fact.arguments[0]) == "a1" for fact in told.statics
    )


def test_one_rib_that_moves_leaves_the_poses_near_other_ribs_as_they_are(
    problem: Problem, cell: Cell, known: PoseKnowledge
) -> None:
    ribs = cell.bodies["ribs"]
    x, _, z = ribs.shapes[5].pose.position_m
    moved = replace(ribs.shapes[5], pose=Pose((x, 0.08, z)))  # beside the point b1
    other = replace(ribs, shapes=(*ribs.shapes[:5], moved, *ribs.shapes[6:]))
    changed = replace(cell, bodies={**cell.bodies, "ribs": other})
    again = known_poses(problem, changed, geometry_backend(), known.poses)
    fresh = known_poses(problem, changed, geometry_backend())
    made = {key for key in again.poses if again.poses[key] is not known.poses[key]}
    assert 0 < len(made) == again.made < len(known.poses) / 2
    assert "b1" in {measurement for measurement, _, _ in made}
    assert again.unreached() == fresh.unreached()
    assert again.stations() == fresh.stations()
    assert all(repr(again.poses[key]) == repr(fresh.poses[key]) for key in again.poses)


@pytest.mark.slow
def test_a_scanner_looks_past_what_stands_beside_its_way_and_is_told_what_hides_a_point(
    problem: Problem, cell: Cell, known: PoseKnowledge
) -> None:
    """The block is where no pose of the arm touches it: only the eyes of the scanner meet it."""
    hidden = known_poses(
        problem, with_block(cell, (0.2, -1.25, -0.05), 0.06), geometry_backend(), known.poses
    )
    assert "block is between it and the laser and camera of slra" in hidden.unreached()["a2"]
    assert {key[0] for key, each in hidden.poses.items() if each is not known.poses.get(key)} == {
        "a2"
    }
    beside = known_poses(
        problem, with_block(cell, (0.2, -1.20, -0.1), 0.06), geometry_backend(), known.poses
    )
    assert "a2" not in beside.unreached()
    again = known_poses(problem, cell, geometry_backend(), hidden.poses)
    assert again.unreached() == {}
    for key, each in again.poses.items():
        assert all(map(np.array_equal, each.straight, known.poses[key].straight))


def test_a_patch_is_as_large_as_what_stands_around_lets_see(
    problem: Problem, cell: Cell, known: PoseKnowledge
) -> None:
    """A ring of four blocks leaves a window of 4 cm."""
    walls = [(0.2 + x, -1.25 + y, -0.01) for x, y in ((0.04, 0), (-0.04, 0), (0, 0.04), (0, -0.04))]
    boxes = tuple(
        PlacedShape(
            Box((0.03 if n < 2 else 0.12, 0.12 if n < 2 else 0.03, 0.01)), Pose(at, (0.0, 0.0, 0.0))
        )
        for n, at in enumerate(walls)
    )
    frame = Body("frame", BodyKind.FIXTURE, Placement("bulkhead"), boxes)
    narrow = known_poses(
        problem,
        replace(cell, bodies={**cell.bodies, "frame": frame}),
        geometry_backend(),
        known.poses,
    )
    for key, each in narrow.poses.items():
        if key[0] == "a2" and each.reached:
            assert each.patch is not None
            assert 0.02 <= each.patch.size_m[0] <= 0.05
    assert "a2" not in narrow.unreached()
    sides = [each.patch.size_m[0] for each in known.poses.values() if each.patch]
    assert sides
    assert all(0.058 < side <= 0.06 for side in sides), (
        "whole pixels, of 1.3 mm, of the greatest patch"
    )
    assert all(each.sigma_m > 0 for each in known.poses.values() if each.patch)


def at_value(
    world: GeometricWorld, value: float, q: np.ndarray, kinematics: dict[str, InverseKinematics]
) -> bool:
    """Whether the arm touches something while it stands there."""
    room = CellState(world.guided("carriage", value), geometry_backend(), kinematics)
    return bool(room.free("t3_746").collides(q[None])[0])


def test_a_ride_looks_at_what_the_world_at_each_place_of_it_looks_like(cell: Cell) -> None:
    world = GeometricWorld.of(with_block(cell, (-0.8, 1.2, -0.5), 0.3))
    kinematics = {name: InverseKinematics(model) for name, model in world.models.items()}
    ride = BodyRide.of(CellState(world, geometry_backend(), kinematics), "carriage", -1.6, 1.6)
    q = world.configurations["t3_746"]
    values = np.linspace(-1.6, 1.6, 9)
    alone = [at_value(world, float(value), q, kinematics) for value in values]
    along = np.hstack([values[:, None], np.repeat(q[None], len(values), axis=0)])
    assert ride.ground.collides(along).tolist() == alone
    assert any(alone)
    assert not all(alone)
    assert ride.touched(q)
    assert not ride.proved(q)


def test_stations_do_not_keep_measurements_from_being_left_out() -> None:
    problem = problem_of("bulkhead/twelve_points")
    serves = tuple(
        Function("serves", (Function(station), Function(f"m{n}")))
        for n, station in zip(range(1, 13), ["left", "right", "middle"] * 4, strict=True)
    )
    asked = replace(problem, statics=(*problem.statics, *serves))
    one = replace(asked, goal=And((goal_parts(asked.goal)[0],)), chains=())
    many = {f"n{n}": "measurement" for n in range(20)}
    more = tuple(
        fact
        for name in many
        for fact in (
            Function("serves", (Function("left"), Function(name))),
            Function("needs", (Function(name), Function("thickness"))),
        )
    )
    wide = replace(one, objects={**one.objects, **many}, statics=(*one.statics, *more))
    assert len(drop_irrelevant_objects(wide).left_out) >= 15
