"""Plans of the laboratory cell, scheduled: the furnace's critical path, proved, and always also a valid plan."""

from dataclasses import replace
from pathlib import Path

import pytest

from engine import pipeline
from engine.model.jobs import Timetable
from engine.model.outcome import Infeasible
from engine.model.schedule import makespan
from engine.scheduling import check_schedule
from engine.timetable import timetable
from engine.validation import validate
from kb.loader import load_problem
from kb.model.problem import Problem


def timed(problem: Problem) -> Timetable:
    made = timetable(problem)
    assert isinstance(made, Timetable)
    assert validate(problem, made.plan) == []
    assert check_schedule(made.shop, made.schedule) == ()
    ends = {step.id: made.starts[step.id] + step.duration for step in made.plan.steps}
    assert all(ends[a] <= made.starts[step.id] for step in made.plan.steps for a in step.after)
    assert max(ends.values(), default=0) == made.schedule.makespan
    assert makespan(made.plan) <= made.schedule.makespan
    return made


@pytest.mark.parametrize(
    ("target", "least"),
    [("themse/one", 1305), ("themse/two", 2243), ("themse/four", 4119), ("themse/furnace_of_two", 979)],
)
def test_the_laboratory_takes_no_longer_than_its_critical_path(target: str, least: int) -> None:
    made = timed(pipeline.problem_of(target)).schedule
    assert made.makespan == made.lower_bound == least
    assert made.proved


def test_a_stored_plan_is_scheduled_as_well() -> None:
    problem = pipeline.problem_of("themse/two")
    made = timed(problem)
    again = timetable(problem, made.plan)
    assert isinstance(again, Timetable)
    assert again.schedule.makespan == made.schedule.makespan


def test_what_has_no_plan_has_no_timetable() -> None:
    assert isinstance(timetable(pipeline.problem_of("themse/unsolvable")), Infeasible)


def test_a_plan_without_structure_keeps_its_own_order() -> None:
    made = timed(pipeline.problem_of("bulkhead/one_point"))
    assert made.note
    assert made.schedule.makespan == makespan(made.plan)


def test_two_places_of_the_freezer_are_used_at_once(tmp_path: Path) -> None:
    """When cooling takes longer than heating, capacity of the freezer is what counts; its slots are interchangeable."""
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
        made.append(timed(load_problem(file)))
    assert [each.schedule.proved for each in made] == [True, True]
    assert made[1].schedule.makespan < made[0].schedule.makespan
    used = {str(step.operator.arguments[1]) for step in made[1].plan.steps if step.operator.name == "cool"}
    assert used == {"slot(freezer, 1)", "slot(freezer, 2)"}


def test_chains_after_others_stay_after_them() -> None:
    problem = pipeline.problem_of("themse/two")
    second = replace(problem.chains[1], after=(problem.chains[0].name,))
    made = timed(replace(problem, chains=(problem.chains[0], second)))
    starts = {
        (each.operator.name, str(each.operator.arguments[0])): made.starts[each.id]
        for each in made.plan.steps
        if each.operator.arguments
    }
    assert starts["heat", "probe_2"] >= starts["cool", "probe_1"] + 300
