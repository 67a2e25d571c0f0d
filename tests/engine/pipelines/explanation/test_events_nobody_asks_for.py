"""Where a goal needs an event and no workflow asks for it, the explanation proposes to ask for
it.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.plan_explanation import Explanation
from cellwright.engine.pipelines.explanation import apply_amendment, explain_infeasibility
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.loader import load_problem
from cellwright.kb.model.conditions import And, goal_parts
from cellwright.kb.model.planning_problem import Problem
from tests.engine.pipelines.explanation.test_parts_with_events import DOMAIN

Write = Callable[[str], Problem]


@pytest.fixture
def cell(tmp_path: Path) -> Write:
    """Makes the problem of a text, in a small cell of five tubes."""

    def write(rest: str) -> Problem:
        (tmp_path / "problems").mkdir()
        (tmp_path / "domain.yaml").write_text(
            DOMAIN.replace("[one, two]", "[one, two, three, four, five]")
        )
        (tmp_path / "problems" / "p.yaml").write_text(f"problem: p\ndomain: filling\n{rest}")
        return load_problem(str(tmp_path / "problems" / "p.yaml"))

    return write


def asked(problem: Problem, found: Explanation) -> list[str]:
    """The changes that ask for events. The proof of each is repeated."""
    stages = [each for each in found.changes if each.stages]
    for each in stages:
        outcome = checked_plan.plan_problem(apply_amendment(problem, each))
        assert isinstance(outcome, Found)
        assert len(outcome.plan.steps) == each.proof
    return [str(each) for each in stages]


def test_an_event_is_proposed_where_no_workflow_is(cell: Write) -> None:
    problem = cell("goals: ['closed(one)']\n")
    found = explain_infeasibility(problem)
    assert asked(problem, found) == ["add stage filled(one)"]
    assert found.changes[0].stages, "it comes first"


def test_a_stage_of_a_fluent_that_needs_an_event_is_explained_by_it(cell: Write) -> None:
    problem = cell("workflow: [{stages: 'closed(two)'}]\n")
    assert asked(problem, explain_infeasibility(problem)) == ["add stage filled(two)"]


def test_all_events_that_the_goals_need_are_proposed_together(cell: Write) -> None:
    problem = cell("goals: ['closed(one), closed(two), closed(three), closed(five)']\n")
    assert asked(problem, explain_infeasibility(problem)) == [
        "add stage filled(one), filled(two), filled(three), filled(five)"
    ]


def test_no_event_is_proposed_that_would_not_do(cell: Write) -> None:
    problem = cell("goals: ['closed(one), cold']\n")
    assert asked(problem, explain_infeasibility(problem)) == []


POURING = """
domain: pouring
types: {tube: object}
objects: {tube: [one, two]}
quantities:
  content(tube): 0..9
events:
  filled(tube, int): {}
operators:
  fill(T, N):
    types: {T: tube}
    adds: filled(T, N)
    increase: {content(T): N}
"""


@pytest.mark.parametrize(("before", "amount"), [(0, 5), (3, 2)])
def test_an_amount_is_what_the_goal_names_or_what_is_missing(
    before: int, amount: int, tmp_path: Path
) -> None:
    (tmp_path / "domain.yaml").write_text(POURING)
    rest = f"initial: ['content(one, {before}), content(two, 1)']\ngoals: ['content(one) = 5']\n"
    (tmp_path / "p.yaml").write_text(f"problem: p\ndomain: pouring\n{rest}")
    problem = load_problem(str(tmp_path / "p.yaml"))
    assert asked(problem, explain_infeasibility(problem)) == [f"add stage filled(one, {amount})"]


@pytest.mark.slow
def test_an_amount_is_proposed_in_a_bundled_cell() -> None:
    problem = load_problem("centrifuge/four")
    wanted = [part for part in goal_parts(problem.goal) if str(part) == "content(tube_1) = 5"]
    problem = replace(problem, goal=And(tuple(wanted)), chains=())
    assert asked(problem, explain_infeasibility(problem)) == ["add stage filled(tube_1, 5)"]
