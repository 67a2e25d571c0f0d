"""Runs of several arms with motion: what one meets is known, plans made meanwhile keep the arms
apart, and no step goes where another is.
"""

from pathlib import Path

import pytest

pytest.importorskip("numpy")

from cellwright.engine.pipelines.execution.run_motions import ArmInterlock, step_moment
from cellwright.engine.pipelines.motion.moving_plan import MovingRun, plan_moving
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, states_of
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.plugins import geometry_backend
from cellwright.kb.loader.cell import cell_of
from tests.engine.pipelines.execution.test_obstacles import (
    actions,
    corrections,
    crate,
    executed,
    planned,
    wanted,
)

TARGET = "dual/crossing"
CRATE_AT = "0.30, 0.30, 0.30"  # where the left arm passes on its way to the middle


@pytest.fixture(scope="module")
def made() -> MovingRun:
    return plan_moving(problem_of(TARGET), cell_of(TARGET), geometry_backend(), planned)


def test_a_step_is_not_begun_where_another_arm_is_on_its_way(made: MovingRun) -> None:
    walk = PlanWalk(PlanGate().semantics(made.problem), cell_of(TARGET), geometry_backend())
    assert made.sharing is not None
    zone = made.sharing.zones[0].steps
    before, after, moved = {}, {}, {each.step: each for each in made.steps}
    for step, was, now in states_of(walk.semantics, made.run.outcome.plan):  # type: ignore[union-attr]
        before[step.id], after[step.id] = was, now
    one, other = zone["left"][0], zone["right"][0]
    apart, where = ArmInterlock.of(walk.cell), walk.hands.where()
    assert apart is not None
    moments = [step_moment(walk, moved[each], before[each], after[each]) for each in (one, other)]
    assert apart.met(1, moments[0], where) == ""
    assert apart.met(2, moments[1], where) == "right would meet left on its way"
    apart.ended(1)
    assert apart.met(2, moments[1], where) == ""


@pytest.mark.slow
def test_two_arms_find_ways_around_what_one_has_met(tmp_path: Path) -> None:
    free, before = executed(wanted(tmp_path, TARGET))
    assert (free.outcome, free.exceptions) == ("reached", 0)
    again = wanted(tmp_path, TARGET, obstacles=crate(tmp_path, CRATE_AT, "0.06, 0.06, 0.2"))
    ending, records = executed(again)
    assert ending.outcome == "reached", ending.why
    assert ending.exceptions > 0
    assert [list(each["bodies"]) for each in corrections(records)] == [["crate"]]
    puts = ["put(left, rod_2, tray_1)", "put(right, rod_1, shelf_1)"]
    assert [
        sorted(each for each in actions(found) if each in puts) for found in (before, records)
    ] == [
        puts,
        puts,
    ]
