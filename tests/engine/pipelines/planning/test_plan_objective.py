"""`plan` gives the plan that one would run: never longer than `schedule`, with arms and
machines sharing the work.
"""

import itertools
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.plan_times import plan_makespan
from cellwright.engine.model.planning_choices import PlanningObjective, SequenceChoice
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.pipelines.planning import checked_plan, plan_objective
from cellwright.engine.pipelines.planning import makespan_plans as makespans
from cellwright.engine.pipelines.planning.timetable import make_timetable
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.scheduling import check_schedule
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.loader import load_problem
from cellwright.kb.model.planning_problem import Problem

PORTERS = """domain: porters
include: [rules.lp]
units: {time: s}
types:
  item: object
  place: object
  arm: object
objects:
  arm: [left, right]
  place: [table, shelf]
  item: [i1..4]
statics:
  takes(arm, time): {}
fluents:
  at(item, place): {}
  holding(arm, item): {}
  empty(arm): {}
operators:
  pick(Arm, Item, Place, Time):
    where: takes(Arm, Time)
    preconditions: at(Item, Place), empty(Arm)
    adds: holding(Arm, Item)
    resources: Arm, Item
    duration: Time
  put(Arm, Item, Place, Time):
    where: takes(Arm, Time)
    preconditions: holding(Arm, Item)
    adds: at(Item, Place)
    resources: Arm, Item
    duration: Time
  swap(One, Other, From, To):
    types: {One: item, Other: item}
    where: One != Other, From != To
    preconditions: at(One, From), at(Other, To)
    adds: at(One, To), at(Other, From)
    resources: left, right, One, Other
    duration: 4 s
deductive_operators:
  - when: at(Item, Place)
    denies: at(Item, Other), Other != Place; holding(_, Item)
  - when: holding(Arm, Item)
    denies: empty(Arm); at(Item, _)
  - when: not holding(Arm, _)
    implies: empty(Arm)
defaults:
  - empty(Arm)
"""


def porters(
    folder: Path, left: int, right: int, goals: str, initial: tuple[str, ...] = ()
) -> Problem:
    (folder / "domain.yaml").write_text(PORTERS)
    (folder / "rules.lp").write_text(f"takes(left, {left}). takes(right, {right}).")
    given_ = initial or tuple(f"at(i{n}, table)" for n in range(1, 5))
    listed = "".join(f"  - {fact}\n" for fact in given_)
    (folder / "p.yaml").write_text(
        f"problem: p\ndomain: domain.yaml\ninitial:\n{listed}goals: ['{goals}']\n"
    )
    return load_problem(str(folder / "p.yaml"))


def made(problem: Problem) -> Timetable:
    run = plan_objective.plan_for_objective(problem)
    assert isinstance(run.outcome, Found)
    assert run.timetable is not None
    assert validate_plan(problem, run.outcome.plan) == []
    assert check_schedule(run.timetable.shop, run.timetable.schedule) == ()
    assert plan_makespan(run.outcome.plan) <= plan_makespan(run.outcome.plan, run.starts)
    assert plan_makespan(run.outcome.plan, run.starts) == run.timetable.schedule.makespan
    return run.timetable


def least(left: int, right: int, number: int) -> int:
    """Each item takes an arm two steps: the best share of the items among the arms."""
    shares = itertools.product((True, False), repeat=number)
    return min(max(2 * left * sum(share), 2 * right * (number - sum(share))) for share in shares)


@pytest.mark.parametrize(
    ("target", "most", "steps"),
    [
        ("themse/one", 1305, 21),
        ("themse/two", 2243, 37),
        ("themse/in_furnace", 619, 5),
        ("bulkhead/both_tools", 60, 12),
        ("bulkhead/one_point", 13, 5),
    ],
)
def test_the_default_answer_is_good_in_makespan(target: str, most: int, steps: int) -> None:
    found = made(checked_plan.problem_of(target))
    assert found.schedule.makespan <= most
    assert len(found.plan.steps) <= steps


@settings(max_examples=5, deadline=None)
@given(st.integers(1, 9), st.integers(1, 9), st.integers(1, 3))
def test_arms_share_the_work_in_the_best_way(
    tmp_path_factory: pytest.TempPathFactory, left: int, right: int, number: int
) -> None:
    goals = ", ".join(f"at(i{n}, shelf)" for n in range(1, number + 1))
    problem = porters(tmp_path_factory.mktemp("cell"), left, right, goals)
    assert made(problem).schedule.makespan == least(left, right, number)


def test_cost_and_makespan_are_different_objectives(tmp_path: Path) -> None:
    goals = ", ".join(f"at(i{n}, shelf)" for n in range(1, 5))
    problem = porters(tmp_path, 5, 5, goals)
    cheap, quick = (
        plan_objective.plan_for_objective(problem, SearchLimits(), each)
        for each in PlanningObjective
    )
    assert isinstance(cheap.outcome, Found)
    assert isinstance(quick.outcome, Found)
    assert cheap.outcome.plan.cost <= quick.outcome.plan.cost
    assert cheap.timetable is not None
    assert quick.timetable is not None
    assert cheap.timetable.schedule.makespan > quick.timetable.schedule.makespan


def test_a_plan_whose_arm_is_busy_at_the_start_is_scheduled(tmp_path: Path) -> None:
    initial = ("holding(left, i1)", "at(i2, table)", "at(i3, table)", "at(i4, table)")
    goals = "at(i1, shelf), at(i2, shelf), at(i3, shelf)"
    found = made(porters(tmp_path, 5, 5, goals, initial))
    assert found.schedule.makespan == 15
    assert found.schedule.proved


def test_a_step_that_moves_two_things_is_scheduled(tmp_path: Path) -> None:
    initial = ("at(i1, table)", "at(i2, shelf)", "at(i3, table)", "at(i4, table)")
    found = made(porters(tmp_path, 5, 5, "at(i1, shelf), at(i2, table), at(i3, shelf)", initial))
    assert found.schedule.makespan == 14  # the swap, then one item by one arm


def test_schedule_is_never_longer_than_plan() -> None:
    problem = checked_plan.problem_of("bulkhead/both_tools")
    fastest = plan_objective.plan_fastest(problem, SearchLimits())
    assert isinstance(fastest, Timetable)
    assert fastest.schedule.makespan <= made(problem).schedule.makespan
    again = make_timetable(problem, fastest.plan)
    assert isinstance(again, Timetable)
    assert again.schedule.makespan == fastest.schedule.makespan


def test_the_plan_that_is_printed_has_its_chart_and_says_what_is_proved() -> None:
    said = CliRunner().invoke(app, ["plan", "themse/in_furnace"], env={"COLUMNS": "150"}).stdout
    assert "█" in said
    assert "makespan 619 s, shortest for these steps, each errand in one piece" in said


def test_an_interrupted_call_still_gives_a_plan() -> None:
    asked = itertools.count()
    limits = SearchLimits(interrupted=lambda: next(asked) > 50)
    run = plan_objective.plan_for_objective(checked_plan.problem_of("themse/one"), limits)
    assert isinstance(run.outcome, Found)
    assert run.timetable is not None


def test_when_the_time_is_over_no_solver_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = checked_plan.problem_of("themse/two")
    outcome, task = checked_plan.plan_and_ground(problem)
    assert isinstance(outcome, Found)
    monkeypatch.setattr(makespans, "time_plan", None)  # would fail
    best, refused = makespans.search_least_makespan(
        problem, task, outcome, SearchLimits(interrupted=lambda: True)
    )
    assert refused is None
    assert not validate_plan(problem, best.plan)


def test_plans_that_are_told_of_have_their_own_cost() -> None:
    """A second plan is looked for with times in the place of costs, and such sums are told to
    nobody.
    """
    problem, heard = load_problem("bulkhead/both_tools"), list[int]()
    limits = SearchLimits(thorough=True, improved=lambda plan: heard.append(plan.cost))
    run = plan_objective.plan_for_objective(problem, limits, order=SequenceChoice.FREE)
    assert isinstance(run.outcome, Found)
    assert heard == sorted(heard, reverse=True)
    assert heard[-1] == run.outcome.plan.cost
