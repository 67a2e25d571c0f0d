"""Plans of the laboratory cell, scheduled: the furnace's critical path, proved, and always also
a valid plan.
"""

import functools
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from cellwright.engine.formats.report.plans.gantt_chart import gantt_rows
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.plan_times import plan_makespan
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.timetable import make_timetable
from cellwright.engine.stages.scheduling import check_schedule
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import bundled_domains, load_problem
from cellwright.kb.model.plan_model import Plan, Step, StepId, full_order
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Number


def timed(problem: Problem) -> Timetable:
    made = make_timetable(problem)
    assert isinstance(made, Timetable)
    assert validate_plan(problem, made.plan) == []
    assert check_schedule(made.shop, made.schedule) == ()
    ends = {step.id: made.starts[step.id] + step.duration for step in made.plan.steps}
    assert all(ends[a] <= made.starts[step.id] for step in made.plan.steps for a in step.after)
    assert max(ends.values(), default=0) == made.schedule.makespan
    assert plan_makespan(made.plan) <= made.schedule.makespan
    return made


@functools.cache
def bundled_timetable(target: str) -> Timetable:
    """The timetable of a bundled problem, made once for all tests that ask for it."""
    return timed(checked_plan.problem_of(target))


@pytest.mark.parametrize("target", ["themse/two", "themse/furnace_of_two"])
def test_the_chart_shows_each_object_where_the_plan_puts_it(target: str) -> None:
    made = bundled_timetable(target)
    charted = {row.name: row.bars for row in gantt_rows(made.shop, made.schedule)}
    heats = [step for step in made.plan.steps if step.operator.name in ("heat", "cool")]
    assert heats
    for step in heats:
        probe, place, _ = map(str, step.operator.arguments)
        start = made.starts[step.id]
        within = [bar for bar in charted[place] if bar.start <= start < bar.end]
        assert [bar.label for bar in within] == [probe]


@pytest.mark.parametrize(
    ("target", "least"),
    [
        ("themse/one", 1305),
        ("themse/two", 2243),
        pytest.param("themse/four", 4119, marks=pytest.mark.slow),
        ("themse/furnace_of_two", 979),
    ],
)
def test_the_laboratory_takes_no_longer_than_its_critical_path(target: str, least: int) -> None:
    made = bundled_timetable(target).schedule
    assert made.makespan == made.lower_bound == least
    assert made.proved


def test_a_stored_plan_is_scheduled_as_well() -> None:
    problem = checked_plan.problem_of("themse/two")
    made = bundled_timetable("themse/two")
    again = make_timetable(problem, made.plan)
    assert isinstance(again, Timetable)
    assert again.schedule.makespan == made.schedule.makespan


def test_what_has_no_plan_has_no_timetable() -> None:
    assert isinstance(make_timetable(checked_plan.problem_of("themse/unsolvable")), Infeasible)


def test_a_plan_without_structure_keeps_its_own_order() -> None:
    made = timed(checked_plan.problem_of("bulkhead/one_point"))
    assert made.note
    assert made.schedule.makespan == plan_makespan(made.plan)


@pytest.mark.slow
def test_two_places_of_the_freezer_are_used_at_once(tmp_path: Path) -> None:
    """When cooling takes longer than heating, capacity of the freezer is what counts; its slots
    are interchangeable.
    """
    text = """problem: cold
domain: themse
statics: [{statics}]
workflow:
  - for: {{P: [probe_1, probe_2, probe_3]}}
    stages: heated(P, 60 s), cooled(P, 30 min), stored(P)
"""
    made = []
    for statics in ("", "'capacity(freezer, 2)'"):
        file = tmp_path / "cold.yaml"
        file.write_text(text.format(statics=statics))
        made.append(timed(load_problem(str(file))))
    assert [each.schedule.proved for each in made] == [True, True]
    assert made[1].schedule.makespan < made[0].schedule.makespan
    used = {
        str(step.operator.arguments[1])
        for step in made[1].plan.steps
        if step.operator.name == "cool"
    }
    assert used == {"slot(freezer, 1)", "slot(freezer, 2)"}


def test_chains_after_others_stay_after_them() -> None:
    problem = checked_plan.problem_of("themse/two")
    second = replace(problem.chains[1], after=(problem.chains[0].name,))
    made = timed(replace(problem, chains=(problem.chains[0], second)))
    starts = {
        (each.operator.name, str(each.operator.arguments[0])): made.starts[each.id]
        for each in made.plan.steps
        if each.operator.arguments
    }
    assert starts["heat", "probe_2"] >= starts["cool", "probe_1"] + 300


STATICS = """
  travel(object, object, time): {}
  near(object, unit): {}
  way(unit, unit, time): {}
  longest_stay(unit, time): {}
  release(probe, time): {}
  due(probe, time): {}
"""
RULES = """
near(D, U) :- part_of(D, U).  near(drawer, drawer).  near(flap, furnace).  near(lid, freezer).
way(drawer, furnace, 4).  way(furnace, freezer, 3).  way(drawer, freezer, 5).  way(V, U, T) :- way(U, V, T).
travel(A, B, T) :- near(A, U), near(B, V), way(U, V, T).
"""


@pytest.fixture
def laboratory(tmp_path: Path) -> Path:
    """The laboratory with empty travel, and predicates for what else can be said about time."""
    home = tmp_path / "lab"
    shutil.copytree(
        bundled_domains()["themse"], home, ignore=shutil.ignore_patterns("golden", "problems")
    )
    rules, domain = home / "rules.lp", home / "domain.yaml"
    rules.write_text(rules.read_text("utf-8") + RULES, "utf-8")
    text = domain.read_text("utf-8").replace("\nstatics:", f"\nstatics:{STATICS.rstrip()}", 1)
    domain.write_text(text, "utf-8")
    (home / "problems").mkdir()
    return home


def of_two(home: Path, *statics: str) -> Problem:
    facts = "".join(f"  - {fact}\n" for fact in statics)
    text = "problem: two\ndomain: ..\n" + (f"statics:\n{facts}" if facts else "")
    text += (
        "workflow:\n  - for: {P: [probe_1, probe_2]}\n    stages: heated(P, 15 min), cooled(P, "
        "5 min), stored(P)\n"
    )
    (home / "problems" / "two.yaml").write_text(text, "utf-8")
    return load_problem(str(home / "problems" / "two.yaml"))


def test_empty_travel_counts(laboratory: Path) -> None:
    made = timed(of_two(laboratory))
    # from the flap to the drawer, and from the freezer to it
    assert made.schedule.makespan == 2243 + 4 + 5
    assert made.schedule.proved


@pytest.mark.slow
def test_nothing_stays_in_the_heat_longer_than_allowed(laboratory: Path) -> None:
    free = timed(of_two(laboratory)).schedule
    made = timed(of_two(laboratory, "longest_stay(furnace, 906)"))
    steps = {(s.operator.name, *map(str, s.operator.arguments[:2])): s for s in made.plan.steps}
    for probe in ("probe_1", "probe_2"):
        put, pick = (
            steps["put", probe, "slot(furnace, 1)"],
            steps["pick", probe, "slot(furnace, 1)"],
        )
        assert made.starts[pick.id] - made.starts[put.id] - put.duration <= 906
    assert made.schedule.makespan >= free.makespan
    tight = timed(of_two(laboratory, "longest_stay(furnace, 905)"))
    assert {each.thing: each.lasts >= 906 for each in tight.overstays} == {
        "probe_1": True,
        "probe_2": True,
    }
    assert tight.note == "in no order of the steps is everything taken away in time (longest_stay)"


def test_release_and_due_times_are_kept_in_mind(laboratory: Path) -> None:
    made = timed(of_two(laboratory, "release(probe_1, 100)", "due(probe_1, 1500)")).schedule
    assert min(start for name, start in made.starts.items() if name.startswith("probe_1")) >= 100
    first = min(made.starts, key=lambda name: made.starts[name])
    assert first.startswith("probe_1")
    assert made.tardiness == 0


def test_a_given_plan_that_is_none_gets_no_timetable_in_its_own_order() -> None:
    problem = checked_plan.problem_of("themse/one")
    plan = timed(problem).plan
    with pytest.raises(InvalidInput, match="K501"):
        make_timetable(problem, Plan(tuple(replace(step, after=()) for step in plan.steps[1:])))


def test_what_a_plan_does_to_no_purpose_is_left_out() -> None:
    problem = checked_plan.problem_of("themse/two")
    plan = timed(problem).plan
    place = 1 + next(n for n, step in enumerate(plan.steps) if step.operator.name == "open_drawer")
    where = Function("slot", (Function("drawer"), Number(4)))
    bystander = [
        Step(StepId(900 + n), Function(name, (Function("probe_4"), where)), duration=8)
        for n, name in enumerate(("pick", "put"))
    ]
    longer = full_order(Plan((*plan.steps[:place], *bystander, *plan.steps[place:])))
    made = make_timetable(problem, longer)
    assert isinstance(made, Timetable)
    assert made.schedule.makespan == 2243
    assert not any("probe_4" in str(step.operator) for step in made.plan.steps)
