"""Many objects are scheduled on their own ways: quantities do not put them in a row, and every
machine and arm is used.
"""

import shutil
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.formats.report.plans.gantt_chart import schedule_summary
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.plan_objective import plan_for_objective
from cellwright.engine.pipelines.planning.timetable.flow_steps import plan_of_steps, steps_of
from cellwright.engine.pipelines.planning.timetable.flowing import by_flow
from cellwright.engine.pipelines.planning.timetable.flows import cell_flow
from cellwright.engine.pipelines.planning.timetable.step_order import SCOPE_ALL_PLANS
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.engine.stages.scheduling.checker import check_schedule
from cellwright.engine.stages.scheduling.flow.board import Board
from cellwright.kb.model.planning_problem import Problem
from tests.places import BUNDLED

DOMAIN = """domain: bakes
units: {time: s}
types: {place: object, tray: object, arm: place}
objects: {arm: ARMS, place: [filler, quick, slow]}
statics: {"longest_stay(place, time)": {}, "home(tray, place)": {}, "due(tray, time)": {}, "bakes(place, time)": {}}
fluents: {"at(tray, place)": {}, "free(place)": {}}
events: {"filled(tray)": {}, "baked(tray)": {}, "kept(tray)": {}}
quantities: {"batter": 0..100}
operators:
  pick(Arm, Tray, From):
    types: {Arm: arm}
    where: not arm(From)
    preconditions: at(Tray, From), free(Arm)
    adds: at(Tray, Arm)
    resources: Arm, Tray
    duration: 5 s
  put(Arm, Tray, To):
    types: {Arm: arm}
    where: not arm(To)
    preconditions: at(Tray, Arm), free(To)
    adds: at(Tray, To)
    resources: Arm, Tray
    duration: 5 s
  fill(Tray):
    preconditions: at(Tray, filler), batter >= 10
    adds: filled(Tray)
    decrease: {batter: 10}
    resources: filler, Tray
    duration: 20 s
  bake(Tray, Oven, Time):
    where: bakes(Oven, Time)
    preconditions: at(Tray, Oven)
    adds: baked(Tray)
    resources: Oven, Tray
    duration: Time
  keep(Tray, Place):
    where: home(Tray, Place)
    preconditions: at(Tray, Place)
    adds: kept(Tray)
    resources: Tray
    duration: 1 s
deductive_operators:
  - {when: "at(Tray, Place)", denies: "at(Tray, Other), Other != Place"}
  - {when: "at(Tray, Place)", denies: free(Place)}
  - {when: "not at(Tray, Place)", implies: free(Place)}
defaults:
  - at(Tray, Place), home(Tray, Place)
  - free(Place)
"""


def trays(
    folder: Path,
    count: int,
    arms: str = "[left]",
    batter: int = 100,
    more: str = "",
    domain: str = DOMAIN,
    times: tuple[int, int] = (100, 150),
    glazed: bool = False,
) -> Problem:
    """So many trays at shelves of their own, which are filled and baked in one of two ovens."""
    (folder / "domain.yaml").write_text(domain.replace("ARMS", arms), "utf-8")
    names = [f"tray_{n}" for n in range(1, count + 1)]
    homes = "".join(f"  - home({name}, shelf_{name})\n" for name in names)
    shelves = ", ".join(f"shelf_{name}" for name in names)
    (folder / "problem.yaml").write_text(
        f"problem: many\ndomain: bakes\nobjects: {{tray: [{', '.join(names)}], place: "
        f"[{shelves}]}}\n"
        f"initial: [batter({batter})]\nstatics:\n{homes}  - bakes(quick, {times[0]}), "
        f"bakes(slow, {times[1]})\n{more}"
        f"workflow:\n  - for: {{T: [{', '.join(names)}]}}\n    stages: filled(T), baked(T), "
        f"{'glazed(T), ' if glazed else ''}kept(T)\n",
        "utf-8",
    )
    return problem_of(str(folder / "problem.yaml"))


def flowing(problem: Problem, work: float = 0.3) -> Timetable:
    made = by_flow(problem, ScheduleLimits(work=work))
    assert isinstance(made, Timetable), made
    assert not check_schedule(made.shop, made.schedule)
    assert not PlanGate().findings(problem, made.plan)
    ends = {step.id: made.starts[step.id] + step.duration for step in made.plan.steps}
    assert all(
        ends[before] <= made.starts[step.id] for step in made.plan.steps for before in step.after
    )
    return made


def used(made: Timetable) -> set[str]:
    return {str(resource) for step in made.plan.steps for resource in step.resources}


def test_both_ovens_are_used_where_that_is_sooner(tmp_path: Path) -> None:
    made = flowing(trays(tmp_path, 4))
    assert {"quick", "slow"} <= used(made)
    assert made.floor <= made.schedule.lower_bound <= made.schedule.makespan < 4 * 100


def test_three_ovens_of_which_one_is_slower_are_all_used(tmp_path: Path) -> None:
    domain = DOMAIN.replace("quick, slow]", "quick, slow, third]")
    two = flowing(trays(tmp_path, 8), 0.05)
    three = flowing(trays(tmp_path, 8, more="  - bakes(third, 100)\n", domain=domain), 0.05)
    assert {"quick", "slow", "third"} <= used(three)
    assert three.schedule.makespan < two.schedule.makespan


def test_one_tray_goes_to_the_quick_oven(tmp_path: Path) -> None:
    made = flowing(trays(tmp_path, 1))
    assert "slow" not in used(made)
    assert (made.schedule.makespan, made.scope) == (10 + 20 + 10 + 100 + 10 + 1, SCOPE_ALL_PLANS)


def test_two_arms_share_the_work(tmp_path: Path) -> None:
    one, two = flowing(trays(tmp_path, 6)), flowing(trays(tmp_path, 6, "[left, right]"))
    assert {"left", "right"} <= used(two)
    assert two.schedule.makespan <= one.schedule.makespan


def test_quantities_do_not_put_trays_in_a_row(tmp_path: Path) -> None:
    run = plan_for_objective(trays(tmp_path, 2))
    assert run.timetable is not None
    alone = 151
    assert run.timetable.schedule.makespan < 2 * alone - 50


def test_too_little_for_all_is_no_plan(tmp_path: Path) -> None:
    made = by_flow(trays(tmp_path, 3, batter=25), ScheduleLimits(work=0.1))
    assert isinstance(made, Infeasible)


def test_what_runs_out_is_counted_before_any_search(tmp_path: Path) -> None:
    run = plan_for_objective(trays(tmp_path, 14))
    assert isinstance(run.outcome, Infeasible)
    assert (
        run.outcome.reason
        == "batter is 100 at the start and only falls, but all objects together draw 140 at least"
    )


def test_longest_stays_are_kept(tmp_path: Path) -> None:
    made = flowing(
        trays(tmp_path, 5, more="  - longest_stay(quick, 100), longest_stay(slow, 150)\n")
    )
    ends = {step.id: made.starts[step.id] + step.duration for step in made.plan.steps}
    baked = {
        str(s.operator.arguments[0]): ends[s.id]
        for s in made.plan.steps
        if s.operator.name == "bake"
    }
    for step in made.plan.steps:
        if step.operator.name == "pick" and str(step.operator.arguments[2]) in ("quick", "slow"):
            assert made.starts[step.id] == baked[str(step.operator.arguments[1])]


def test_trays_of_one_kind_are_grounded_once(tmp_path: Path) -> None:
    problem = trays(tmp_path, 10)
    cell = cell_flow(problem, PlanGate().semantics(problem))
    assert len(cell.kinds) == 1
    assert len(cell.kinds[0].members) == 10


def test_the_bound_of_all_plans_is_said_beside_that_of_these_ways(tmp_path: Path) -> None:
    made = flowing(trays(tmp_path, 4))
    said = schedule_summary(made.schedule, "s", made.scope, made.floor)
    assert said.startswith(f"makespan {made.schedule.makespan} s")
    assert made.floor == made.schedule.makespan or f"no plan ends before {made.floor} s" in said


def test_a_tray_may_wait_on_its_shelf_between_filler_and_oven(tmp_path: Path) -> None:
    problem = trays(tmp_path, 3)
    cell = cell_flow(problem, PlanGate().semantics(problem))
    (route,) = cell.flow.routes
    (wait,) = route.waits
    layers = list(route.layers)
    homeward = {act.before for act in layers[wait + 1] if not act.is_nothing}
    layers[wait] = tuple(act for act in layers[wait] if act.after in homeward)
    layers[wait + 1] = tuple(act for act in layers[wait + 1] if not act.is_nothing)
    board = Board(replace(cell.flow, routes=(replace(route, layers=tuple(layers)),)))
    for item in range(3):
        course = board.earliest(item)
        assert course is not None
        board.settle(item, course)
    plan = plan_of_steps(cell, steps_of(cell, [board.courses[n] for n in range(3)]), cell.levels)
    assert not PlanGate().findings(problem, plan)
    shelved = [str(step.operator) for step in plan.steps if "shelf_tray_1" in str(step.operator)]
    assert len(shelved) == 5  # picked, put, picked, put and kept there


@settings(max_examples=8, deadline=None)
@given(
    count=st.integers(1, 5),
    quick=st.integers(1, 30),
    slow=st.integers(1, 30),
    fill=st.integers(1, 40),
    again=st.integers(1, 40),
)
def test_no_schedule_ends_before_the_bound_of_all_plans(
    count: int, quick: int, slow: int, fill: int, again: int
) -> None:
    glaze = f"""  glaze(Tray):
    preconditions: at(Tray, filler)
    adds: glazed(Tray)
    resources: filler, Tray
    duration: {again} s
  keep"""
    domain = DOMAIN.replace("  keep", glaze, 1).replace("duration: 20 s", f"duration: {fill} s")
    domain = domain.replace('"kept(tray)": {}', '"kept(tray)": {}, "glazed(tray)": {}')
    with TemporaryDirectory() as folder:
        problem = trays(Path(folder), count, domain=domain, times=(quick, slow), glazed=True)
    made = flowing(problem, 0.05)
    assert 0 < made.floor <= made.schedule.makespan


@pytest.mark.slow
def test_windows_bind_plates_that_may_wait_at_home(tmp_path: Path) -> None:
    """Ways that wait have more acts than straight ones; the windows are between the same two."""
    home = tmp_path / "screening"
    shutil.copytree(BUNDLED / "screening", home)
    rules = (home / "rules.lp").read_text()
    (home / "rules.lp").write_text(rules.replace("longest_stay(hotel, 60).", ""))
    said = "windows: ['at most 6 min from incubated(P, _) to washed(P, _)']\n"
    (home / "domain.yaml").write_text(said + (home / "domain.yaml").read_text())
    problem = problem_of(str(home / "problems" / "two.yaml"))
    (route,) = cell_flow(problem, PlanGate().semantics(problem)).flow.routes
    (window,) = route.lags
    assert (window.least, window.most) == (0, 360)
    assert route.waits
    assert isinstance(by_flow(problem, ScheduleLimits()), Timetable)


def test_many_trays_have_no_cliff(tmp_path: Path) -> None:
    times = [
        flowing(trays(tmp_path, count, batter=100), 1.0).schedule.makespan for count in (8, 10)
    ]
    assert times[1] < times[0] * 1.6
