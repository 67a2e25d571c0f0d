"""Libraries on domains where conditions speak of all objects, or where costs depend on the
binding.
"""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.formats.report.plans.library_report import plan_origin
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.macros import LibraryAnswer, LibraryPlanner
from cellwright.engine.stages.lifted.lifted_execution import final_situation
from cellwright.engine.stages.macros.learning.plan_generalisation import generalise_plan
from cellwright.engine.stages.macros.lookup.macro_query import make_query
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.loader import load, with_goals
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library
from cellwright.kb.terms import Function

ALL = """domain: house
types: {place: object}
objects: {place: [table, rack, oven]}
fluents: {"clean(place)": {}, tidy: {}, shiny: {}}
operators:
  wipe(P): {adds: clean(P)}
  tidy_up: {preconditions: "clean(P) : place(P)", adds: tidy}
  polish:
    effects:
      - {when: "clean(P) : place(P)", adds: shiny}
"""
PRICED = """domain: ways
types: {place: object}
objects: {place: [here, there]}
statics: {"toll(place, int)": {}}
fluents: {"at(place)": {}, fresh: {}, ticket: {}}
operators:
  walk(To): {preconditions: at(here), adds: at(To), deletes: at(here), cost: 10}
  ride(To, Price): {where: "toll(To, Price)", preconditions: "at(here), ticket", adds: at(To), deletes: at(here), cost: Price}
"""


def problem_in(folder: Path, domain: str, goals: str, more: str = "") -> Path:
    (folder / "domain.yaml").write_text(domain)
    file = folder / "day.yaml"
    name = domain.partition("\n")[0].removeprefix("domain: ")
    file.write_text(f"problem: day\ndomain: {name}\n{more}goals: [{goals}]\n")
    return file


def read(file: Path) -> Problem:
    problem = load(file).problem
    assert problem is not None
    return problem


@pytest.mark.parametrize("goals", ["tidy", "shiny", "tidy, shiny"])
def test_a_plan_with_a_condition_on_all_objects_is_given_and_not_learned(
    tmp_path: Path, goals: str
) -> None:
    problem = read(problem_in(tmp_path, ALL, goals))
    with Library(str(tmp_path / "store.db")) as library, LibraryPlanner(library) as practice:
        answered = practice.plan(problem)
        here = practice.situation(problem)
    assert isinstance(answered.outcome, Found)
    assert validate_plan(problem, answered.outcome.plan) == []
    assert "all objects" in answered.reason
    end = final_situation(answered.outcome.plan, here)
    assert {str(each) for each in end.state} >= set(goals.split(", "))


def test_plan_prepare_and_revise_end_without_an_internal_error(tmp_path: Path) -> None:
    file, store = problem_in(tmp_path, ALL, "tidy, shiny"), str(tmp_path / "store.db")
    runner = CliRunner()
    made = runner.invoke(app, ["plan", str(file), "--store", store, "--format", "json"])
    assert made.exit_code == 0, made.output
    plan = tmp_path / "plan.json"
    plan.write_text(made.stdout)
    assert (
        runner.invoke(app, ["prepare", str(file), "--store", store, "--jobs", "1"]).exit_code == 0
    )
    revised = runner.invoke(app, ["revise", str(plan), "--done", "1"])
    assert revised.exit_code == 0, revised.output


def test_of_two_macrops_the_cheaper_instance_is_taken(tmp_path: Path) -> None:
    """What a ride costs is known only where it leads; walking costs 10 wherever."""
    file = problem_in(
        tmp_path, PRICED, "at(there)", "statics: ['toll(there, 3)']\ninitial: ['at(here)']\n"
    )
    on_foot = read(file)
    paid = with_goals(on_foot.domain, "at(there)", on_foot)
    paid = paid.replace((Function("at", (Function("here"),)), Function("ticket")))
    with Library(str(tmp_path / "store.db")) as library, LibraryPlanner(library) as practice:
        first, second = practice.plan(on_foot), practice.plan(paid)
        assert [_cost(each) for each in (first, second)] == [10, 3]  # the planner is asked as well
        here = practice.situation(paid)
        ride = _ride(paid)
        learned = generalise_plan(paid, ride, here.world, here.state).macrop
        assert learned.cost is None
        practice.repertoire(paid.domain).learn(learned)
        asked = make_query(paid, here)
        assert asked is not None
        hit = practice.repertoire(paid.domain).find(asked)
    assert hit is not None
    assert hit.plan.cost == 3


def _ride(problem: Problem) -> Plan:
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    assert outcome.plan.cost == 3
    return outcome.plan


def _cost(answered: LibraryAnswer) -> int:
    assert isinstance(answered.outcome, Found)
    return answered.outcome.plan.cost


def test_parts_are_named_only_where_they_are_shown() -> None:
    assert plan_origin("parts", None, "", "").plain == "Composed of MACROPs."
    assert plan_origin("parts", None, "", "", listed=True).plain == "Composed of the parts above."
