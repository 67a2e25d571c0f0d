"""Objects that are alike come in the order in which the user names them, and nothing else about the plan changes."""

import dataclasses

import pytest

from engine.model.outcome import Found
from engine.pipelines.gate import PlanGate
from engine.pipelines.planning import plan, problem_of
from engine.pipelines.renaming import in_the_order_said
from kb.model.plan import Plan
from kb.model.problem import Problem
from kb.terms import Number

HEAT = "process {} in the furnace for 15 min"


def found(problem: Problem) -> Plan:
    """The plan of a problem that has one."""
    outcome = plan(problem)
    assert isinstance(outcome, Found)
    return outcome.plan


def heated(made: Plan) -> list[str]:
    """The probes in the order in which they are heated."""
    return [str(s.operator.arguments[0]) for s in made.steps if s.operator.name == "heat"]


@pytest.mark.parametrize("said", [("probe_1", "probe_2"), ("probe_2", "probe_1"), ("probe_4", "probe_1")])
def test_probes_are_heated_in_the_order_in_which_they_are_said(said: tuple[str, str]) -> None:
    made = found(problem_of("themse", "", HEAT.format(" and ".join(said))))
    assert heated(made) == list(said)
    assert made.cost == 13


def test_what_differs_in_more_than_its_name_keeps_its_turn() -> None:
    problem = problem_of("themse", "", f"{HEAT.format('probe 1')} and probe 2 for 10 min")
    made = found(problem)
    assert in_the_order_said(PlanGate().semantics(problem), made, lambda _: True) == made


def test_numbers_that_a_problem_gives_to_an_object_tell_it_from_others() -> None:
    """Which of two tubes is heavier is no matter of names."""
    problem = problem_of("centrifuge/four")
    chains = {each.subject: each for each in problem.chains}
    one, _, three, _ = chains
    pair = dataclasses.replace(problem, chains=(chains[three], chains[one]))
    tried: list[Plan] = []
    made = found(problem)
    in_the_order_said(PlanGate().semantics(pair), made, lambda other: bool(tried.append(other)))
    assert [fact.arguments[1] for fact in problem.statics if fact.name == "weight"][::2] == [
        Number(12),
        Number(14),
    ]
    assert tried == []


def test_a_plan_in_another_order_that_the_checker_refuses_is_left() -> None:
    problem = problem_of("themse", "", HEAT.format("probe 2 and probe 1"))
    other = problem_of("themse", "", HEAT.format("probe 1 and probe 2"))
    made, asked = found(problem), list[Plan]()
    kept = in_the_order_said(PlanGate().semantics(other), made, lambda each: bool(asked.append(each)))
    assert kept == made
    assert [heated(each) for each in asked] == [["probe_1", "probe_2"]]
    assert PlanGate().findings(other, asked[0]) == []
