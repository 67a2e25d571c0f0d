"""A domain that contradicts itself only in a state to which a plan leads is at fault, not the
engine.
"""

import pytest

from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.conditions import ALWAYS_TRUE, Literal, Parameter
from cellwright.kb.model.domain_model import (
    Consequence,
    DeductiveOperator,
    Domain,
    Effect,
    Operator,
)
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function
from tests.properties.problems import CONSTANTS, PREDICATES, TYPES, X

A, B = (Function("p", (each,)) for each in CONSTANTS)
R = Function("r")


def test_a_step_that_contradicts_itself_where_it_stands_is_told_as_a_fault_of_the_domain() -> None:
    """`p` of anything denies `r`; the step adds `p(b)`, and `r` where `p(a)` does not hold."""
    step = Operator("o", (), ALWAYS_TRUE, (Effect(B), Effect(R, True, (), Literal(A, False))))
    denial = Consequence(R, False, (), ())
    rule = DeductiveOperator(
        Literal(Function("p", (X,)), True), (Parameter(X, "thing"),), (), (denial,)
    )
    objects = dict.fromkeys(map(str, CONSTANTS), "thing")
    domain = Domain(
        "d",
        TYPES,
        objects=objects,
        predicates=PREDICATES,
        operators=(step,),
        deductive_operators=(rule,),
    )
    problem = Problem("p", domain, goal=Literal(B))
    assert ground(problem).operators
    with pytest.raises(InvalidInput, match="K301: step 1 o both adds and denies r"):
        checked_plan.plan_problem(problem)
