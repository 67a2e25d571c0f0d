"""Inspections that several arms share: who makes what, who waits for whom, and plans in which
all work at once.
"""

import itertools
from dataclasses import replace
from pathlib import Path

import pytest

from cellwright.engine.formats.interop.inspection_files import import_file
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.time_limits import measured_steps
from cellwright.engine.pipelines.inspection.tour_demands import TourDemands, as_facts
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.decomposition import SharedMeasurements, shares_of
from cellwright.engine.pipelines.planning.plan_objective import Run, plan_for_objective
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Number

WEST, EAST = Function("west"), Function("east")


def six(*facts: Function) -> Problem:
    """Six points on a line from west to east; facts say who reaches them, else everybody does."""
    problem = problem_of("halves/six", "", "")
    reach = facts or tuple(within(arm, f"m{n}") for n in range(1, 7) for arm in ("west", "east"))
    return replace(problem, statics=(*problem.statics, *reach))


def within(arm: str, name: str) -> Function:
    return Function("within_reach", (Function(arm), Function(name)))


def shares(problem: Problem, demands: TourDemands = TourDemands()) -> SharedMeasurements:
    found = shares_of(problem, demands)
    assert isinstance(found, SharedMeasurements)
    return found


def begins(run: Run, problem: Problem) -> dict[str, int]:
    """When each measurement of a plan begins."""
    assert isinstance(run.outcome, Found)
    assert run.starts is not None
    return {
        name: run.starts[step] for step, name in measured_steps(problem, run.outcome.plan).items()
    }


def test_each_arm_begins_on_its_side_and_both_are_done_at_once() -> None:
    found = shares(six())
    assert found.shares.orders == {"west": ("m1", "m2", "m3"), "east": ("m6", "m5", "m4")}
    assert found.shares.busy["west"] == pytest.approx(found.shares.busy["east"], rel=0.01)
    assert found.tools["m1"] == "west_probe"


@pytest.mark.slow
def test_shares_are_the_best_of_all_ways_to_share() -> None:
    problem = six()
    asked, best = shares(problem), None
    names = [f"m{n}" for n in range(1, 7)]
    for way in itertools.product(("west", "east"), repeat=6):
        told = six(*(within(arm, name) for arm, name in zip(way, names, strict=True)))
        one = shares(told).shares.makespan
        best = one if best is None else min(best, one)
    assert asked.shares.makespan == best == asked.shares.lower_bound


def test_the_schedule_of_the_plan_lasts_as_long_as_the_shares_say() -> None:
    problem = six()
    run, found = plan_for_objective(problem), shares(problem)
    assert isinstance(run.outcome, Found)
    assert run.timetable is not None
    assert abs(run.timetable.schedule.makespan - found.lasts(found.shares.makespan)) <= 3
    alone = plan_for_objective(six(*(within("west", f"m{n}") for n in range(1, 7))))
    assert alone.timetable is not None
    assert alone.timetable.schedule.makespan >= 1.7 * run.timetable.schedule.makespan


def test_what_one_arm_alone_reaches_is_its_own() -> None:
    facts = [within("west", f"m{n}") for n in (1, 2, 3, 5, 6)] + [within("east", "m4")]
    found = shares(six(*facts))
    assert found.shares.orders["east"] == ("m4",)
    assert found.shares.common == 0


def test_arms_keep_the_order_of_measurements_of_both() -> None:
    demands = TourDemands(before=(("m6", "m1"), ("m2", "m5")))
    problem = as_facts(six(), demands)
    found = shares(problem)
    assert set(found.waits) == {
        pair for pair in demands.before if found.arms[pair[0]] != found.arms[pair[1]]
    }
    run = plan_for_objective(problem)
    at = begins(run, problem)
    assert all(at[first] < at[second] for first, second in demands.before)


def test_arms_do_not_wait_for_each_other_in_a_circle() -> None:
    facts = [within("west", f"m{n}") for n in (1, 2)] + [
        within("east", f"m{n}") for n in (3, 4, 5, 6)
    ]
    pairs = (("m2", "m3"), ("m4", "m1"), ("m1", "m2"), ("m3", "m5"))
    problem = as_facts(six(*facts), TourDemands(before=pairs))
    at = begins(plan_for_objective(problem), problem)
    assert all(at[first] < at[second] for first, second in pairs)


def test_all_arms_wait_for_the_alignment() -> None:
    problem = six()
    facts = tuple(Function("alignment", (Function(name), Number(1))) for name in ("m3", "m4"))
    problem = replace(problem, statics=(*problem.statics, *facts))
    at = begins(plan_for_objective(problem), problem)
    assert max(at["m3"], at["m4"]) < min(at[f"m{n}"] for n in (1, 2, 5, 6))


def test_a_goal_that_names_an_arm_is_for_that_arm() -> None:
    problem = six()
    asked = problem_of("halves/six", "measured(_, west, meas(m6)), measured(_, _, meas(m5))", "")
    found = shares(replace(asked, statics=problem.statics))
    assert found.arms["m6"] == "west"


def test_a_tool_that_is_for_no_arm_is_held_by_one_of_them() -> None:
    problem = six()
    rules = tuple(each for each in problem.statics if each.name != "equips")
    run = plan_for_objective(replace(problem, statics=rules))
    assert isinstance(run.outcome, Found)


def test_what_no_arm_reaches_is_told_with_the_reason() -> None:
    problem = problem_of("halves/six", "", "")
    far = [
        replace(fact, arguments=(fact.arguments[0], Number(0), Number(4_000_000), Number(0)))
        if fact.name == "position" and str(fact.arguments[0]) == "m6"
        else fact
        for fact in problem.statics
    ]
    found = shares(replace(problem, statics=tuple(far)))
    assert "m6" not in found.arms
    assert "west: " in found.partition.impossible["m6"]
    assert "east: " in found.partition.impossible["m6"]


def test_one_measurement_is_made_by_an_arm_that_reaches_it() -> None:
    asked = problem_of("halves/six", "measured(_, _, meas(m6))", "")
    for arm in ("west", "east"):
        run = plan_for_objective(replace(asked, statics=(*asked.statics, within(arm, "m6"))))
        assert isinstance(run.outcome, Found)
        assert {str(step.resources[-1]) for step in run.outcome.plan.steps} == {arm}


def test_an_import_says_which_arms_can_make_each_point_and_leaves_out_what_none_reaches(
    tmp_path: Path,
) -> None:
    rows = [
        f"{name},{x},{y},0,0,0,-1,thickness"
        for name, x, y in (("a", 0, -900), ("b", 0, 900), ("c", 0, 4000))
    ]
    (tmp_path / "points.csv").write_text("\n".join(["name,x,y,z,nx,ny,nz,kind", *rows]) + "\n")
    _, parts, text = import_file(tmp_path / "points.csv", "halves")
    assert parts.groups == {"east_probe or west_probe": ("a", "b")}
    assert parts.impossible["c"].startswith("west: ")
    assert "meas(b)" in text
    assert "meas(c)" not in text
