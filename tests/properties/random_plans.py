"""Random plans for random problems: executable sequences in which orders, resources and links
are drawn.
"""

import dataclasses

from hypothesis import strategies as st

from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.conditions import And, Literal
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, CausalLink, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Term, substitute_term
from tests.properties.problems import CONSTANTS, problems, successors

FAMILIES = st.one_of(problems(), problems(conditional=True), problems(deductive=True))
MORE: tuple[Term, ...] = (Function("arm"), Function("cloth"))
ATOMS = (*(Function(name, (each,)) for name in ("p", "q") for each in CONSTANTS), Function("r"))


@st.composite
def posed(draw: st.DrawFn) -> tuple[Problem, Plan]:
    """A problem with a plan for it: an executable sequence in which orders, resources and links
    are drawn.
    """
    problem = draw(FAMILIES)
    semantics = Semantics(problem)
    state = semantics.initial()
    steps: list[Step] = []
    for number in range(draw(st.integers(1, 4))):
        following = list(successors(semantics, problem, state))
        if not following:
            break
        operator, state = draw(st.sampled_from(following))
        steps.append(_step(draw, semantics, number + 1, operator))
    links = draw(st.lists(_links(len(steps)), max_size=2, unique=True))
    goal = And(
        tuple(
            Literal(each, each in state)
            for each in draw(st.lists(st.sampled_from(ATOMS), max_size=2))
        )
    )
    return dataclasses.replace(problem, goal=goal), Plan(tuple(steps), tuple(links))


def _step(draw: st.DrawFn, semantics: Semantics, number: int, operator: Function) -> Step:
    """After some of those before it; it holds what it needs, seldom less, sometimes more."""
    before = [StepId(each) for each in range(1, number) if draw(st.integers(0, 2))]
    schema = semantics.operators[operator.name]
    bindings = dict(zip(schema.variables, operator.arguments, strict=True))
    held = [substitute_term(each, bindings) for each in schema.resources]
    if held and not draw(st.integers(0, 9)):
        held.pop()
    held += draw(st.lists(st.sampled_from(MORE), max_size=1)) if not draw(st.integers(0, 3)) else []
    return Step(StepId(number), operator, tuple(before), tuple(dict.fromkeys(held)))


def _links(count: int) -> st.SearchStrategy[CausalLink]:
    producer = st.integers(INITIAL_STEP, count).map(StepId)
    consumer = st.sampled_from([GOAL_STEP, *(StepId(each) for each in range(1, count + 1))])
    negated = st.sampled_from(ATOMS).map(lambda each: Function("not", (each,)))
    return st.builds(CausalLink, producer, st.sampled_from(ATOMS) | negated, consumer)
