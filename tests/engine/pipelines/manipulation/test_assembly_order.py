"""Assemblies: what geometry refutes changes the plan of the tasks."""

from collections.abc import Collection
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.pipelines.manipulation.assembly_moves import (
    MoveKind,
    MoveObstacle,
    PartMove,
    PartSpot,
    least_failing_set,
)
from cellwright.engine.pipelines.manipulation.assembly_order import (
    Built,
    NotBuilt,
    assemble_scene,
    problem_with,
)
from cellwright.engine.pipelines.planning.plan_files import check_plan
from cellwright.kb.loader import load_domain
from cellwright.kb.loader.scene_file import load_scene
from cellwright.kb.model.body_shapes import Pose
from cellwright.kb.model.cell_model import Placement
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.targets import BUNDLED_DOMAINS

DOMAIN = load_domain("handey")
FIVE = load_scene(BUNDLED_DOMAINS / "handey" / "scenes" / "five.yaml")


def moved(scene: Scene, part: str, at: tuple[float, float, float], turn: float = 0.0) -> Scene:
    """The scene with a part that lies elsewhere, at millimetres and degrees."""
    x, y, z = (value / 1000 for value in at)
    body = replace(
        scene.cell.bodies[part],
        placement=Placement("world", Pose((x, y, z), (0.0, 0.0, float(np.radians(turn))))),
    )
    return replace(scene, cell=replace(scene.cell, bodies={**scene.cell.bodies, part: body}))


def related(scene: Scene, *parts: str) -> Scene:
    """The scene with the relations of some parts only."""
    keep = [each for each in scene.relations if {each.first[0], each.second[0]} <= {*parts, "base"}]
    return replace(scene, relations=tuple(keep))


@given(
    st.frozensets(st.sampled_from("abcdef")),
    st.sets(st.frozensets(st.sampled_from("abcdef")), max_size=4),
)
def test_what_is_left_of_the_culprits_fails_and_nothing_less_does(
    present: frozenset[str], culprits: set[frozenset[str]]
) -> None:
    def fails(names: Collection[str]) -> bool:
        return any(each <= frozenset(names) for each in culprits)

    if fails(present):
        found = least_failing_set(sorted(present), fails)
        assert fails(found)
        assert not found or not any(map(fails, combinations(found, len(found) - 1)))


@pytest.fixture(scope="module")
def five() -> Built:
    """The bundled assembly of five parts."""
    made, _ = assemble_scene(FIVE, DOMAIN, "base")
    assert isinstance(made, Built)
    return made


@pytest.mark.slow
def test_two_parts_are_built_one_upon_the_other() -> None:
    made, _ = assemble_scene(related(FIVE, "floor_plate", "wall_1"), DOMAIN, "base")
    assert isinstance(made, Built)
    assert [move.part for move, _ in made.moves] == ["floor_plate", "wall_1"]
    legs = [leg for _, carries in made.moves for each in carries for leg in each.legs]
    assert all(leg.proved for leg in legs)
    assert all(np.array_equal(a.path[-1], b.path[0]) for a, b in pairwise(legs))
    assert check_plan(made.problem, made.plan) == []


@pytest.mark.slow
def test_five_parts_are_built_in_an_order_that_geometry_allows(five: Built) -> None:
    order = [move.part for move, _ in five.moves]
    assert sorted(order) == ["floor_plate", "knob", "lid", "wall_1", "wall_2"]
    assert order.index("lid") > max(order.index("wall_1"), order.index("wall_2"))
    assert order.index("knob") > order.index("lid")
    assert all(leg.proved for _, carries in five.moves for each in carries for leg in each.legs)


@pytest.mark.slow
def test_each_move_begins_where_the_one_before_it_ended(five: Built) -> None:
    legs = [leg for _, carries in five.moves for each in carries for leg in each.legs]
    assert all(np.array_equal(a.path[-1], b.path[0]) for a, b in pairwise(legs))


@pytest.mark.slow
def test_the_plan_stands_with_all_that_was_learned(five: Built) -> None:
    assert five.obstacles
    assert check_plan(five.problem, five.plan) == []
    parts = sorted(five.goal.poses.keys() - {"base"})
    naive = problem_with(DOMAIN, parts, (), dict.fromkeys(parts, PartSpot.FOUND))
    assert len(naive.statics) == 0


@pytest.mark.slow
def test_a_lid_waits_for_what_carries_it(five: Built) -> None:
    yard, lid = five.yard, PartMove("lid", MoveKind.DIRECT, PartSpot.FOUND, PartSpot.GOAL)
    answer = yard.moved(
        lid, dict.fromkeys(yard.goals, PartSpot.FOUND), yard.site.world.configuration
    )
    assert isinstance(answer, MoveObstacle)
    assert answer.until in (("wall_1",), ("wall_2",))


@pytest.mark.slow
def test_what_stands_in_the_way_is_set_aside() -> None:
    """The lid lies so near to a wall that the wall cannot be taken, and belongs on the walls."""
    scene = moved(moved(FIVE, "lid", (340, 250, 15), 90), "wall_1", (395, 215, 30))
    scene = moved(moved(scene, "wall_2", (480, 60, 30)), "knob", (600, 320, 20))
    made, _ = assemble_scene(
        replace(related(scene, "wall_1", "wall_2", "lid"), inset_m=0.025), DOMAIN, "base"
    )
    assert isinstance(made, Built)
    aside = PartMove("lid", MoveKind.DIRECT, PartSpot.FOUND, PartSpot.ASIDE)
    order = [move for move, _ in made.moves]
    assert order.index(aside) < [move.part for move in order].index("wall_1")
    assert order[-1] == PartMove("lid", MoveKind.DIRECT, PartSpot.ASIDE, PartSpot.GOAL)
    refuted = [each for each in made.obstacles if each.move.part == "wall_1"]
    assert any(each.during == (("lid", PartSpot.FOUND),) for each in refuted)


@pytest.mark.slow
def test_where_no_grasp_serves_both_ends_the_plan_regrasps() -> None:
    scene = load_scene(BUNDLED_DOMAINS / "handey" / "scenes" / "turning.yaml")
    made, _ = assemble_scene(scene, DOMAIN, "base")
    assert isinstance(made, Built)
    ((move, carries),) = made.moves
    assert move == PartMove("wheel", MoveKind.REGRASPED, PartSpot.FOUND, PartSpot.GOAL)
    assert len(carries) == 4
    assert made.obstacles
    assert all(each.move.way is MoveKind.DIRECT for each in made.obstacles)


@pytest.mark.slow
def test_without_an_order_the_obstacles_are_told() -> None:
    """The gap for the plate is too narrow for the fingers on both sides, whatever comes first:
    it is wider than the jaws.
    """
    scene = replace(FIVE, hand=replace(FIVE.hand, opening_m=0.05))
    made, _ = assemble_scene(related(scene, "floor_plate", "wall_1"), DOMAIN, "base")
    assert isinstance(made, NotBuilt)
    assert made.why.step == "order"
    assert any(each.move.part == "floor_plate" for each in made.obstacles)
