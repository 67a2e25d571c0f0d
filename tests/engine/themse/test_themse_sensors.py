"""The gripper's sensors are part of the model: every state of a plan says what each of them
shows.
"""

import dataclasses

import pytest

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.step_changes import State
from cellwright.kb.loader import load_domain, load_problem, with_goals
from cellwright.kb.model.conditions import And, Literal
from cellwright.kb.model.domain_model import Operator
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function

READINGS = {
    "": {"wrist_force": "unloaded", "distance": "clear", "grip_width": "wide_open", "grip_force": "slack"},
    "probe": {"wrist_force": "loaded", "distance": "obstructed", "grip_width": "on_probe", "grip_force": "tight"},
    "lid": {"wrist_force": "loaded", "distance": "obstructed", "grip_width": "on_lid", "grip_force": "tight"},
}  # fmt: skip


def states(problem: Problem) -> list[tuple[Semantics, State]]:
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    semantics = Semantics(problem)
    state = semantics.initial()
    found = [(semantics, state)]
    for step in outcome.plan.steps:
        bound = semantics.binding(step.operator)
        assert not isinstance(bound, str)
        change = semantics.change(*bound, semantics.facts(state), state)
        state = (state - change.ends) | change.adds
        found.append((semantics, state))
    return found


def test_every_sensor_shows_what_is_in_the_hand() -> None:
    for semantics, state in states(load_problem("themse/one")):
        held = next(
            (
                str(a.arguments[0])
                for a in state
                if a.name == "at" and str(a.arguments[1]) == "mars_gripper"
            ),
            "",
        )
        expected = dict(READINGS[held.partition("_")[0]])
        if held:
            expected["slippage"] = "still"
        facts = semantics.facts(state)
        shown = {str(a.arguments[0]): str(a.arguments[1]) for a in facts.named("shows")}
        assert shown == expected


def test_a_sensor_shows_only_what_it_can_tell_apart() -> None:
    semantics, _ = states(load_problem("themse/one"))[0]
    gives = {atom.arguments for atom in semantics.statics.named("gives")}
    assert {
        (Function(s), Function(r)) for shown in READINGS.values() for s, r in shown.items()
    } <= gives
    assert (Function("slippage"), Function("slipping")) in gives


@pytest.mark.parametrize(
    "reading", ["grip_width, on_probe", "grip_width, on_lid", "slippage, still"]
)
def test_a_goal_may_ask_for_a_reading(reading: str) -> None:
    assert isinstance(
        checked_plan.plan_problem(with_goals(load_domain("themse"), f"shows({reading})")), Found
    )


def test_an_operator_may_depend_on_a_reading() -> None:
    """A careful gripper: the lid is put down only while nothing slips."""
    problem = load_problem("themse/one")
    operators = tuple(map(careful, problem.domain.operators))
    domain = dataclasses.replace(problem.domain, operators=operators)
    assert isinstance(checked_plan.plan_problem(dataclasses.replace(problem, domain=domain)), Found)


def careful(operator: Operator) -> Operator:
    if operator.name != "put":
        return operator
    still = Literal(Function("shows", (Function("slippage"), Function("still"))))
    assert isinstance(operator.precondition, And)
    return dataclasses.replace(operator, precondition=And((*operator.precondition.parts, still)))
