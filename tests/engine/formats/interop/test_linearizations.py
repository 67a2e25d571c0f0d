"""Partially ordered plans judged by their orders alone."""

from dataclasses import replace

import pytest

pytest.importorskip("unified_planning")

from cellwright.engine.formats.interop.up.state_space_proofs import check_every_order
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.model.conditions import And, Exists, Literal, Not, Parameter
from cellwright.kb.model.domain_model import Domain, Effect, Kind, Operator, Predicate, Type
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Variable


def flipped(count: int) -> tuple[Problem, Plan]:
    """Steps without any order that each turn a switch over: the checker sees that they
    interfere.
    """
    off, one = Function("off"), Function("done", (Variable("X"),))
    flip = Operator(
        "flip",
        (Parameter(Variable("X"), "thing"),),
        And(()),
        (
            Effect(one),
            Effect(off, True, (), Literal(off, False)),
            Effect(off, False, (), Literal(off)),
        ),
    )
    things = {f"t{number}": "thing" for number in range(count)}
    domain = Domain(
        "switches",
        {"thing": Type("thing")},
        objects=things,
        predicates={
            "off": Predicate("off", (), Kind.FLUENT),
            "done": Predicate("done", ("thing",), Kind.FLUENT),
        },
        operators=(flip,),
    )
    undone = Exists((Parameter(Variable("X"), "thing"),), Literal(one, False))
    problem = Problem(
        "even", domain, goal=And((Not(undone), Literal(off, count % 2 == 1))), complete=True
    )
    steps = (Step(StepId(n), Function("flip", (Function(t),))) for n, t in enumerate(things, 1))
    return problem, Plan(tuple(steps))


def test_what_the_checker_cannot_show_is_found_by_trying_every_order() -> None:
    problem, plan = flipped(4)
    assert {each.code for each in validate_plan(problem, plan)} == {"K503"}
    assert check_every_order(problem, plan).valid is True


def test_a_question_that_takes_too_long_is_left_open() -> None:
    problem, plan = flipped(8)
    assert check_every_order(problem, plan, most=20).valid is None
    assert check_every_order(problem, plan, most=500).valid is True  # 2^8 sets of steps done


def test_an_order_that_fails_is_shown() -> None:
    problem, plan = flipped(3)
    once = Operator("once", (), Literal(Function("off"), False), (Effect(Function("off")),))
    domain = replace(problem.domain, operators=(*problem.domain.operators, once))
    problem = replace(problem, domain=domain, goal=And(()))
    plan = Plan((Step(StepId(9), Function("once")), *plan.steps))
    found = check_every_order(problem, plan).counterexample
    assert found is not None
    assert found.order[-1] == 9
    assert len(found.order) % 2 == 0
    assert not found.at_the_goal


@pytest.mark.parametrize("target", ["bulkhead/one_point", "bulkhead/both_tools"])
def test_plans_of_a_cell_hold_in_every_order(target: str) -> None:
    problem = checked_plan.problem_of(target)
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    assert check_every_order(problem, outcome.plan).valid is True
