"""Monitoring and portions: what an operator does is followed, and one relation alone can be
planned for.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwright.engine.formats.interop.operator_events import read_acts
from cellwright.engine.kernels.rigid import rotation, transform
from cellwright.engine.pipelines.manipulation.arm_monitoring import (
    BodyShifted,
    Event,
    GoalOutlook,
    JawsAct,
    OperatorAct,
    WatchedWorld,
    begin_watching,
    watch_events,
)
from cellwright.engine.pipelines.manipulation.part_grasps import ArmReach, with_hand
from cellwright.engine.pipelines.manipulation.place_answers import NotPlaced, Placed
from cellwright.engine.pipelines.manipulation.place_operation import (
    BroughtPart,
    bring_to_relation,
    place_part,
)
from cellwright.engine.pipelines.manipulation.regrasp_paths import possible_holds
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.facet_solids import solid_of
from cellwright.engine.stages.grasping.stable_placements import stable_placements, volume_and_centre
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.scene_file import load_scene, relation_of
from cellwright.kb.model.cell_model import Placement
from cellwright.kb.targets import BUNDLED_DOMAINS

ANGLE = load_scene(BUNDLED_DOMAINS / "handey" / "scene.yaml")
TURNING = load_scene(BUNDLED_DOMAINS / "handey" / "scenes" / "turning.yaml")
WHEEL = solid_of(TURNING.cell.bodies["wheel"])
RESTS = {
    each.facet: each.T_table_part for each in stable_placements(WHEEL, volume_and_centre(WHEEL)[1])
}
TABLE = transform(rotation((0, 0, 1), 0.3), np.array([0.43, 0.15, 0.0]))
BODIES = TURNING.cell.bodies
LYING = replace(
    BODIES["wheel"], placement=Placement("world", transforms.to_pose(TABLE @ RESTS["south_east"]))
)
SCENE = replace(TURNING, cell=replace(TURNING.cell, bodies={**BODIES, "wheel": LYING}))


@pytest.fixture(scope="module")
def run() -> tuple[WatchedWorld, tuple[OperatorAct, OperatorAct]]:
    """The wheel before it is taken, and the acts that take it and let it go at its goal."""
    state = begin_watching(SCENE, "wheel", "base")
    assert isinstance(state, WatchedWorld)
    found, _ = place_part(SCENE, "wheel", "base")
    assert isinstance(found, Placed)
    legs = found.carries[0].legs
    return state, (
        OperatorAct(legs[1].path[-1], JawsAct.CLOSE),
        OperatorAct(legs[4].path[-1], JawsAct.OPEN),
    )


def warnings(state: WatchedWorld, *events: Event) -> list[GoalOutlook]:
    """The outlooks that were warned of."""
    return [said.outlook for _, said in watch_events(state, events) if said is not None]


@pytest.mark.slow
def test_an_operator_who_does_well_hears_nothing(
    run: tuple[WatchedWorld, tuple[OperatorAct, OperatorAct]],
) -> None:
    state, acts = run
    told = list(watch_events(state, acts))
    assert [said for _, said in told] == [None, None]
    assert told[0][0].T_part_hand is not None
    assert told[-1][0].forecast.outlook is GoalOutlook.DONE


def test_a_grasp_that_cannot_place_is_told_at_once(
    run: tuple[WatchedWorld, tuple[OperatorAct, OperatorAct]],
) -> None:
    state, _ = run
    task = state.site.task("wheel", (state.T_world_part, state.T_goal))
    useless = possible_holds(task, state.T_world_part) & ~possible_holds(task, state.T_goal)
    hold = int(np.argmax(useless))
    width = task.holds.grasps[task.holds.grasp_of[hold]].opening
    reach = ArmReach(with_hand(task.world, task.scene, task.holds.jaws, width), "arm")
    q = reach.configurations(state.T_world_part @ task.holds.poses[hold], task.world.configuration)[
        0
    ]
    (outlook,) = warnings(state, OperatorAct(q, JawsAct.CLOSE))
    assert outlook in (GoalOutlook.HARD, GoalOutlook.IMPOSSIBLE)


def test_what_is_put_on_the_goal_closes_it(
    run: tuple[WatchedWorld, tuple[OperatorAct, OperatorAct]],
) -> None:
    state, (taken, _) = run
    T = state.T_goal.copy()
    T[2, 3] += 0.04
    assert warnings(state, taken, BodyShifted("brick", T)) == [GoalOutlook.IMPOSSIBLE]


def test_jaws_that_close_on_nothing_hold_nothing(
    run: tuple[WatchedWorld, tuple[OperatorAct, OperatorAct]],
) -> None:
    state, _ = run
    home = state.site.world.configuration
    assert state.after(OperatorAct(home, JawsAct.CLOSE)).T_part_hand is None


@pytest.mark.parametrize(
    ("acts", "message"),
    [
        ("{}", "no list"),
        ("[", "no JSON"),
        ("[{}]", "neither `joints` nor a `body`"),
        ('[{"joints": [0, 1]}]', "has to be 6 numbers"),
        ('[{"body": "moon", "at": [0, 0, 0]}]', "no body 'moon'"),
        ('[{"body": "brick", "at": [0, 0, 1e999]}]', "has to be 3 numbers"),
        ('[{"joints": [0, 0, 0, 0, 0, 0], "jaws": "shut"}]', "one of close, open, stay"),
        ('[{"joints": [0, 0, 0, 0, 0, 0], "jaw": "open"}]', "unknown key 'jaw'"),
    ],
)
def test_acts_that_cannot_be_read_are_told(acts: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "acts.json"
    file.write_text(acts, "utf-8")
    with pytest.raises(InvalidInput, match=message):
        read_acts(file, TURNING)


def test_acts_are_read_in_degrees_and_millimetres(tmp_path: Path) -> None:
    file = tmp_path / "acts.json"
    written = [
        {"joints": [90, 0, 0, 0, 0, 0]},
        {"body": "brick", "at": [100, 0, 0], "rpy": [0, 0, 90]},
    ]
    file.write_text(json.dumps(written), "utf-8")
    act, shifted = read_acts(file, TURNING)
    assert isinstance(act, OperatorAct)
    assert isinstance(shifted, BodyShifted)
    assert act.q[0] == pytest.approx(np.pi / 2)
    np.testing.assert_allclose(
        shifted.T_world_body[:3, [0, 3]], [[0, 0.1], [1, 0], [0, 0]], atol=1e-12
    )


def test_one_relation_alone_is_reached_and_the_part_stays_in_the_hand() -> None:
    found = bring_to_relation(
        ANGLE, relation_of(ANGLE.cell, "angle.heel", "parallel", "base.front")
    )
    assert isinstance(found, BroughtPart)
    assert found.goal.degrees == 4
    assert abs(found.T_world_part[1, 1]) == pytest.approx(1.0, abs=1e-6)  # the heel looks along y
    assert all(leg.proved for leg in found.legs)
    assert [leg.carries for leg in found.legs] == [False, False, True, True]


def test_relations_on_the_command_line_are_refused_where_they_are_wrong() -> None:
    with pytest.raises(InvalidInput, match="unknown relation 'paralel'"):
        relation_of(ANGLE.cell, "angle.heel", "paralel", "base.front")
    with pytest.raises(InvalidInput, match="is no feature"):
        relation_of(ANGLE.cell, "angle", "parallel", "base.front")
    with pytest.raises(InvalidInput, match="unknown body"):
        relation_of(ANGLE.cell, "angel.heel", "parallel", "base.front")


def test_a_part_is_not_put_where_something_else_is() -> None:
    brick = replace(ANGLE.cell.bodies["brick"], placement=ANGLE.cell.bodies["base"].placement)
    up = replace(
        brick.placement, pose=replace(brick.placement.pose, position_m=(0.42, -0.31, 0.06))
    )
    bodies = {**ANGLE.cell.bodies, "brick": replace(brick, placement=up)}
    scene = replace(ANGLE, cell=replace(ANGLE.cell, bodies=bodies), clutter=("slab",))
    found, _ = place_part(scene, "angle", "base")
    assert isinstance(found, NotPlaced)
    assert found.step in ("room", "grasp")
