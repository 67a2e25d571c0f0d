"""A part of the goals is planned with the events that the other chains ask for: only what is
out of reach with them is named.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.explanation import explain_infeasibility
from cellwright.engine.pipelines.explanation.unreachable_goals import GoalOrStage, with_goals_only
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.loader import load_problem
from cellwright.kb.model.conditions import goal_parts
from cellwright.kb.model.planning_problem import Problem

DOMAIN = """
domain: filling
types: {tube: object}
objects: {tube: [one, two]}
fluents:
  full(tube): {}
  closed(tube): {}
  broken: {}
  cold: {}
events:
  filled(tube): {}
  shaken(tube): {}
operators:
  fill(T):
    types: {T: tube}
    preconditions: not full(T)
    adds: full(T), filled(T)
  shake(T):
    types: {T: tube}
    preconditions: full(T), broken
    adds: shaken(T)
  close(T):
    types: {T: tube}
    preconditions: full(T)
    adds: closed(T)
"""
Write = Callable[[str], Problem]


@pytest.fixture
def cell(tmp_path: Path) -> Write:
    """Makes the problem of a text, in a small cell."""

    def write(rest: str) -> Problem:
        (tmp_path / "problems").mkdir()
        (tmp_path / "domain.yaml").write_text(DOMAIN)
        (tmp_path / "problems" / "p.yaml").write_text(f"problem: p\ndomain: filling\n{rest}")
        return load_problem(str(tmp_path / "problems" / "p.yaml"))

    return write


def test_a_goal_that_an_event_of_a_chain_reaches_is_not_named_as_out_of_reach(cell: Write) -> None:
    problem = cell("goals: ['closed(one)']\nworkflow: [{stages: 'filled(one), shaken(one)'}]\n")
    found = explain_infeasibility(problem)
    assert found.goals == ("filled(one), shaken(one) (workflow 1)",)
    assert "closed(one)" not in str(found.changes)


def test_goals_that_need_more_events_than_the_chains_ask_for_are_named(cell: Write) -> None:
    """Nobody asks to fill the second tube: its goal is out of reach by itself."""
    found = explain_infeasibility(
        cell("goals: ['closed(one)', 'closed(two)']\nworkflow: [{stages: 'filled(one)'}]\n")
    )
    assert found.goals == ("closed(two)",)


def test_a_fluent_stage_of_another_chain_keeps_nothing_back(cell: Write) -> None:
    """The chain that waits for cold is out of reach, and the others do not wait for it."""
    text = "workflow: [{name: a, stages: 'cold'}, {name: b, after: [a], stages: 'filled(one)'}]\n"
    found = explain_infeasibility(cell(f"goals: ['closed(one)']\n{text}"))
    assert found.goals == ("cold (workflow a)",)


def test_an_allowed_chain_is_in_no_goal_and_its_events_are_accepted_by_the_checker(
    cell: Write,
) -> None:
    problem = cell("goals: ['closed(one)']\nworkflow: [{stages: 'filled(one), filled(two)'}]\n")
    goal = str(next(iter(goal_parts(problem.goal))))
    part = with_goals_only(
        problem, [GoalOrStage(next(iter(goal_parts(problem.goal))), text=goal, whole=goal)]
    )
    outcome = checked_plan.plan_problem(part)
    assert isinstance(outcome, Found)
    assert [str(step.operator) for step in outcome.plan.steps] == ["fill(one)", "close(one)"]
    assert isinstance(
        checked_plan.plan_problem(with_goals_only(problem, [GoalOrStage(chain="1", stages=2)])),
        Found,
    )


def test_an_allowed_chain_keeps_its_order(cell: Write) -> None:
    problem = cell("goals: ['closed(two)']\nworkflow: [{stages: 'shaken(one), filled(two)'}]\n")
    goal = next(iter(goal_parts(problem.goal)))
    assert isinstance(
        checked_plan.plan_problem(with_goals_only(problem, [GoalOrStage(goal, text=str(goal))])),
        Infeasible,
    )
