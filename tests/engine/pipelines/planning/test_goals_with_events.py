"""What can still be reached, where goals need events that only chains ask for."""

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, event, given, settings

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning.goal_selection import (
    IN_ANY_CASE,
    NO_EVENT,
    GoalSelection,
    select_goals,
)
from cellwright.engine.pipelines.planning.quantifiers import expand_forall
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_problem
from cellwright.kb.model.conditions import And, goal_parts
from cellwright.kb.model.planning_problem import Problem
from tests.engine.pipelines.explanation.test_parts_with_events import DOMAIN
from tests.properties.test_allowed_chains import reachable
from tests.properties.test_parts_of_goals import chained

Reach = Callable[[str], GoalSelection]


@pytest.fixture
def reach(tmp_path: Path) -> Reach:
    """What can be reached of the goals and the workflow of a text, in a small cell."""

    def reached(rest: str) -> GoalSelection:
        (tmp_path / "problems").mkdir()
        (tmp_path / "domain.yaml").write_text(DOMAIN)
        (tmp_path / "problems" / "p.yaml").write_text(f"problem: p\ndomain: filling\n{rest}")
        return select_goals(load_problem(str(tmp_path / "problems" / "p.yaml")))

    return reached


def steps(found: GoalSelection) -> list[str]:
    assert isinstance(found.outcome, Found)
    return [str(step.operator) for step in found.outcome.plan.steps]


def lost(found: GoalSelection) -> list[tuple[str, str]]:
    return [(each.goal, each.why) for each in found.given_up]


def test_a_goal_is_kept_with_the_stage_whose_event_it_needs(reach: Reach) -> None:
    found = reach("goals: ['closed(one)']\nworkflow: [{stages: 'filled(one), shaken(one)'}]\n")
    assert steps(found) == ["fill(one)", "close(one)"]
    assert lost(found) == [("shaken(one) of 1", IN_ANY_CASE)]


def test_a_goal_is_kept_where_its_chain_waits_for_another_one(reach: Reach) -> None:
    first = "{name: b, stages: 'filled(two)'}"
    found = reach(
        f"goals: [closed(one)]\nworkflow: [{first}, {{after: [b], stages: 'filled(one), cold'}}]\n"
    )
    assert steps(found) == ["fill(two)", "fill(one)", "close(one)"]
    assert lost(found) == [("cold of 2", IN_ANY_CASE)]


def test_a_goal_whose_event_comes_after_what_is_lost_is_given_up(reach: Reach) -> None:
    found = reach("goals: ['closed(one)']\nworkflow: [{stages: 'shaken(one), filled(one)'}]\n")
    assert isinstance(found.outcome, Infeasible)
    assert ("closed(one)", IN_ANY_CASE) in lost(found)


def test_the_workflow_is_named_if_a_goal_needs_an_event_that_is_given_up_with_it(
    reach: Reach,
) -> None:
    """The second chain would allow the event, but waits for a fluent; the third waits for what
    is lost.
    """
    text = (
        "workflow: [{name: a, stages: cold}, {name: b, after: [a], stages: 'broken & cold, "
        "filled(one)'}]\n"
    )
    found = reach(f"goals: ['closed(one)']\n{text}")
    assert ("closed(one)", NO_EVENT) in lost(found)


@given(chained())
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
def test_nothing_that_is_given_up_could_be_kept_beside_the_rest(problem: Problem) -> None:
    try:
        found = select_goals(problem)
    except InvalidInput:
        assume(False)
    event(type(found.outcome).__name__)
    if not isinstance(found.outcome, Found):
        return
    kept = list(goal_parts(expand_forall(found.problem).goal))
    assert reachable(found.problem)
    for part in goal_parts(expand_forall(problem).goal):
        if part not in kept:
            event("a goal is given up")
            more = Problem(
                problem.name,
                problem.domain,
                initial=problem.initial,
                goal=And((*kept, part)),
                chains=found.problem.chains,
                complete=True,
            )
            assert not reachable(more)
