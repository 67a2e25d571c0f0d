"""The top level is a planner over the tools that a domain declares."""

from dataclasses import replace
from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found, GaveUp, Infeasible
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, first_plan
from cellwright.engine.pipelines.execution.planner_choice import choose_and_plan
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.loader import load_problem
from cellwright.kb.model.domain_model import RUN_TOOLS
from cellwright.kb.model.planning_problem import Problem


def with_tools(problem: Problem, *tools: str) -> Problem:
    return replace(problem, domain=replace(problem.domain, tools=tools))


@pytest.mark.parametrize(
    ("target", "tools", "used"),
    [
        ("themse/one", RUN_TOOLS, ("planner: a plan", "scheduler: a timetable")),
        ("themse/one", ("planner",), ("planner: a plan",)),
        ("themse/one", ("scheduler", "planner"), ("planner: a plan", "scheduler: a timetable")),
        ("bulkhead/twelve_points", RUN_TOOLS, ("sequencer: a plan and a timetable",)),
    ],
)
def test_the_first_declared_tool_that_serves_is_used_after_those_that_it_needs(
    target: str, tools: tuple[str, ...], used: tuple[str, ...]
) -> None:
    found = choose_and_plan(with_tools(problem_of(target), *tools), SearchLimits())
    assert isinstance(found.outcome, Found)
    assert found.notes == used
    assert (found.starts is None) == (tools == ("planner",))


@pytest.mark.slow
def test_what_was_learned_is_used_by_the_next_run(tmp_path: Path) -> None:
    problem, store = problem_of("themse/one"), str(tmp_path / "l.db")
    assert choose_and_plan(problem, SearchLimits(), store).notes == (
        "library: a plan",
        "scheduler: a timetable",
    )
    found = choose_and_plan(problem, SearchLimits(), store)
    assert found.notes[0].startswith("from library")
    assert isinstance(first_plan(problem, store=store), ReadyPlan)


@pytest.mark.parametrize("tools", [("scheduler",), ("diagnosis",), ("library", "scheduler")])
def test_tools_that_make_no_plan_are_told(tools: tuple[str, ...]) -> None:
    found = choose_and_plan(with_tools(problem_of("themse/one"), *tools), SearchLimits()).outcome
    assert isinstance(found, GaveUp)
    assert ", ".join(tools) in found.reason


def test_that_there_is_no_plan_is_asked_of_one_tool_only() -> None:
    assert isinstance(
        choose_and_plan(problem_of("themse/unsolvable"), SearchLimits()).outcome, Infeasible
    )


def test_a_domain_declares_its_tools(tmp_path: Path) -> None:
    text = (
        "domain: lamps\ntypes: {lamp: object}\nobjects: {lamp: [lamp_1]}\nfluents:\n  "
        "lit(lamp): {}\n"
    )
    text += "operators:\n  on(Lamp):\n    types: {Lamp: lamp}\n    adds: lit(Lamp)\n"
    (tmp_path / "problem.yaml").write_text(
        "problem: p\ndomain: .\ngoals:\n  - lit(lamp_1)\n", "utf-8"
    )
    (tmp_path / "domain.yaml").write_text(text, "utf-8")
    assert load_problem(str(tmp_path / "problem.yaml")).domain.tools == RUN_TOOLS
    (tmp_path / "domain.yaml").write_text(text + "tools: [planner, diagnosis]\n", "utf-8")
    assert load_problem(str(tmp_path / "problem.yaml")).domain.tools == ("planner", "diagnosis")
