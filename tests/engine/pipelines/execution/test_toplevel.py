"""The top level is a planner over the tools that a domain declares."""

from dataclasses import replace
from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found, GaveUp, Infeasible
from cellwright.engine.pipelines.execution.planned import Ready, first
from cellwright.engine.pipelines.execution.toplevel import made
from cellwright.engine.pipelines.planning import problem_of
from cellwright.engine.stages.planning import Limits
from cellwright.kb.loader import load_problem
from cellwright.kb.model.domain import TOOLS
from cellwright.kb.model.problem import Problem


def with_tools(problem: Problem, *tools: str) -> Problem:
    return replace(problem, domain=replace(problem.domain, tools=tools))


@pytest.mark.parametrize(
    ("target", "tools", "used"),
    [
        ("themse/one", TOOLS, ("planner: a plan", "scheduler: a timetable")),
        ("themse/one", ("planner",), ("planner: a plan",)),
        ("themse/one", ("scheduler", "planner"), ("planner: a plan", "scheduler: a timetable")),
        ("bulkhead/twelve_points", TOOLS, ("sequencer: a plan and a timetable",)),
    ],
)
def test_the_first_declared_tool_that_serves_is_used_after_those_that_it_needs(
    target: str, tools: tuple[str, ...], used: tuple[str, ...]
) -> None:
    found = made(with_tools(problem_of(target), *tools), Limits())
    assert isinstance(found.outcome, Found)
    assert found.notes == used
    assert (found.starts is None) == (tools == ("planner",))


@pytest.mark.slow
def test_what_was_learned_is_used_by_the_next_run(tmp_path: Path) -> None:
    problem, store = problem_of("themse/one"), str(tmp_path / "l.db")
    assert made(problem, Limits(), store).notes == ("library: a plan", "scheduler: a timetable")
    found = made(problem, Limits(), store)
    assert found.notes[0].startswith("from library")
    assert isinstance(first(problem, store=store), Ready)


@pytest.mark.parametrize("tools", [("scheduler",), ("diagnosis",), ("library", "scheduler")])
def test_tools_that_make_no_plan_are_told(tools: tuple[str, ...]) -> None:
    found = made(with_tools(problem_of("themse/one"), *tools), Limits()).outcome
    assert isinstance(found, GaveUp)
    assert ", ".join(tools) in found.reason


def test_that_there_is_no_plan_is_asked_of_one_tool_only() -> None:
    assert isinstance(made(problem_of("themse/unsolvable"), Limits()).outcome, Infeasible)


def test_a_domain_declares_its_tools(tmp_path: Path) -> None:
    text = "domain: lamps\ntypes: {lamp: object}\nobjects: {lamp: [lamp_1]}\nfluents:\n  lit(lamp): {}\n"
    text += "operators:\n  on(Lamp):\n    types: {Lamp: lamp}\n    adds: lit(Lamp)\n"
    (tmp_path / "problem.yaml").write_text("problem: p\ndomain: .\ngoals:\n  - lit(lamp_1)\n", "utf-8")
    (tmp_path / "domain.yaml").write_text(text, "utf-8")
    assert load_problem(str(tmp_path / "problem.yaml")).domain.tools == TOOLS
    (tmp_path / "domain.yaml").write_text(text + "tools: [planner, diagnosis]\n", "utf-8")
    assert load_problem(str(tmp_path / "problem.yaml")).domain.tools == ("planner", "diagnosis")
