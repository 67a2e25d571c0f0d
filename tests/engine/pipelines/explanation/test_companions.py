"""Events that nobody asks for: where they are all that is missing, the explanation says so, and
which needs never hold together.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from cellwright.engine.formats.report.plans.explanation_report import explanation_text as text
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.explanation import apply_amendment, explain_infeasibility
from cellwright.engine.pipelines.explanation.companion_events import find_companions
from cellwright.engine.pipelines.explanation.possible_facts import ProblemSpace
from cellwright.engine.pipelines.explanation.unreachable_goals import minimal_goals
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.loader import load_problem
from cellwright.kb.model.planning_problem import Problem

DOMAIN = """
domain: spinning
types: {tube: object, tray: object}
objects: {tube: [a, b, c], tray: [one, two]}
derived:
  balanced: {}
fluents:
  inside(tube): {}
  filled(tube): {}
events:
  spun(tube): {}
  baked(tray): {}
  shaken(tray): {}
operators:
  load(T):
    preconditions: filled(T)
    adds: inside(T)
  unload(T):
    preconditions: inside(T)
    deletes: inside(T)
  spin:
    preconditions: balanced
    effects:
      - when: inside(T)
        adds: spun(T)
  bake(One, Two):
    types: {One: tray, Two: tray}
    where: One != Two
    adds: baked(One), baked(Two)
  shake(T):
    types: {T: tray}
    adds: shaken(T)
include: [rules.lp]
"""
RULES = "balanced :- #count { T : inside(T) } != 1.\n"
Write = Callable[[str], Problem]


@pytest.fixture
def cell(tmp_path: Path) -> Write:
    """Makes the problem of a text, in a small cell."""

    def write(rest: str) -> Problem:
        (tmp_path / "problems").mkdir()
        (tmp_path / "domain.yaml").write_text(DOMAIN)
        (tmp_path / "rules.lp").write_text(RULES)
        (tmp_path / "problems" / "p.yaml").write_text(f"problem: p\ndomain: spinning\n{rest}")
        return load_problem(str(tmp_path / "problems" / "p.yaml"))

    return write


def test_a_rotor_that_is_not_balanced_with_one_tube_is_told_to_take_another_one(
    cell: Write,
) -> None:
    problem = cell("initial: ['filled(a), filled(b)']\nworkflow: [{stages: 'spun(a)'}]\n")
    found = explain_infeasibility(problem)
    assert found.exclusions == (
        "spin needs balanced, inside(a) and not inside(b), which never hold together: no "
        "workflow asks for spun(b)",
    )
    first = found.changes[0]
    assert (first.kind, list(map(str, first.facts))) == ("add stage", ["spun(b)"])
    outcome = checked_plan.plan_problem(apply_amendment(problem, first))
    assert isinstance(outcome, Found)
    assert len(outcome.plan.steps) == first.proof == 3
    assert "There would be a plan of 3 steps if spun(b) were asked for as well" in str(text(found))
    assert not any("spun(c)" in str(each) for each in found.changes), "nothing fills the third one"


def test_facts_that_would_help_are_found_beside_it(cell: Write) -> None:
    """Nobody fills the second tube: so the first advice is a fact, and none says what is not
    enough.
    """
    problem = cell("initial: ['filled(a)']\nworkflow: [{stages: 'spun(a)'}]\n")
    found = explain_infeasibility(problem)
    assert all(
        isinstance(checked_plan.plan_problem(apply_amendment(problem, each)), Found)
        for each in found.changes
    )
    assert not [each for each in found.changes if each.stages]


def test_a_step_of_two_events_is_told_by_the_second_one(cell: Write) -> None:
    found = explain_infeasibility(cell("workflow: [{stages: 'shaken(one), baked(one)'}]\n"))
    assert [str(each) for each in found.changes] == ["add stage baked(two)"]


@pytest.mark.slow
def test_one_tube_alone_needs_another_one_in_the_bundled_rotor() -> None:
    problem = checked_plan.problem_of("centrifuge/four", command="spin tube 1 for 5 min")
    goals = minimal_goals(
        problem, lambda each: isinstance(checked_plan.plan_problem(each), Infeasible)
    )
    space = ProblemSpace.of(problem, ())
    change, found = next(find_companions(problem, goals, space, checked_plan.plan_problem))
    assert (change.kind, list(map(str, change.facts))) == ("add stage", ["spun(tube_2, 300)"])
    assert len(found.plan.steps) == 8
