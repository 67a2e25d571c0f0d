"""Grounding by need against grounding the whole: the same solvability, and shortest plans of
the same length.
"""

from collections import deque

import pytest
from hypothesis import HealthCheck, assume, event, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.ground_task import GroundTask, progress_state
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning.checked_plan import plan_and_ground
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.grounding.pruning import (
    drop_irrelevant_objects,
    drop_irrelevant_operators,
    preserves_optimality,
)
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.conditions import And, Comparison, Exists, ForAll, Literal, Not, Parameter
from cellwright.kb.model.domain_model import (
    Consequence,
    DeductiveOperator,
    Domain,
    Effect,
    Kind,
    Operator,
    Predicate,
    Type,
)
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number, Term, Variable

DILIGENT = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
MOST = 6_000  # states that are looked at
X, Y, Z = Variable("X"), Variable("Y"), Variable("Z")
PLACES = tuple(Function(f"c{number}") for number in range(7))
GOAL, HOME = PLACES[0], PLACES[-1]
TYPES = {"place": Type("place"), "spot": Type("spot")}
PREDICATES = {
    "at": Predicate("at", ("place",), Kind.FLUENT),
    "lit": Predicate("lit", ("place",), Kind.FLUENT),
    "near": Predicate("near", ("place", "place"), Kind.FLUENT),
    "free": Predicate("free", (), Kind.FLUENT),
    "old": Predicate("old", ("place",), Kind.STATIC),
    "tied": Predicate("tied", ("place", "place"), Kind.STATIC),
}


def atoms(terms: tuple[Term, ...]) -> st.SearchStrategy[Atom]:
    pairs = [Function("near", (one, other)) for one in terms for other in terms]
    return st.sampled_from(
        [
            Function("free"),
            *(Function(name, (t,)) for name in ("at", "at", "lit") for t in terms),
            *pairs,
        ]
    )


@st.composite
def operators(draw: st.DrawFn, name: str) -> Operator:
    variables = draw(st.sampled_from([(X,), (X, Y), (X, Y), (X, GOAL)]))
    own = tuple(each for each in variables if isinstance(each, Variable))
    signs = st.sampled_from([True, True, True, False])
    parts = [Literal(a, draw(signs)) for a in draw(st.lists(atoms(variables), max_size=2))]
    parts += draw(
        st.sampled_from(
            [
                [],
                [],
                [],
                [Exists((Parameter(Z, "place"),), Literal(Function("lit", (Z,))))],
                [Not(Exists((Parameter(Z, "place"),), Literal(Function("lit", (Z,)))))],
                [ForAll((Parameter(Z, "place"),), Literal(Function("at", (Z,)), False))],
            ]
        )
    )
    effects = [Effect(a) for a in draw(st.lists(atoms(variables), min_size=1, max_size=2))]
    effects += [Effect(a, adds=False) for a in draw(st.lists(atoms(variables), max_size=2))]
    if draw(st.integers(0, 9)) == 0:
        effects.append(Effect(Function("lit", (Z,)), draw(st.booleans()), (Parameter(Z, "place"),)))
    if draw(st.integers(0, 9)) == 0:
        effects.append(Effect(Function("free"), condition=Literal(Function("lit", (X,)))))
    statics = [Literal(Function("old", (X,)), draw(st.booleans()))] if draw(st.booleans()) else []
    if len(own) > 1:
        statics += draw(
            st.sampled_from([[], [Comparison(X, "!=", Y)], [Literal(Function("tied", (X, Y)))]])
        )
    return Operator(
        name,
        tuple(Parameter(each, "place") for each in own),
        And(tuple(parts)),
        tuple(effects),
        tuple(statics),
        cost=Number(draw(st.integers(1, 2))),
    )


@st.composite
def deductive_operators(draw: st.DrawFn) -> tuple[DeductiveOperator, ...]:
    found = []
    if draw(st.booleans()):
        other = Consequence(
            Function("at", (Y,)),
            False,
            (Comparison(X, "!=", Y),),
            (Parameter(X, "place"), Parameter(Y, "place")),
        )
        found.append(
            DeductiveOperator(Literal(Function("at", (X,))), (Parameter(X, "place"),), (), (other,))
        )
    if draw(st.integers(0, 3)) == 0:
        freed = Consequence(Function("free"), True, (), (Parameter(X, "place"),))
        found.append(
            DeductiveOperator(
                Literal(Function("lit", (X,)), draw(st.booleans())),
                (Parameter(X, "place"),),
                (),
                (freed,),
            )
        )
    return tuple(found)


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    """Seven places, of which goals and state name few; one to three operators."""
    count = draw(st.integers(1, 3))
    domain = Domain(
        "random",
        TYPES,
        predicates=PREDICATES,
        operators=tuple(draw(operators(f"o{number}")) for number in range(count)),
        deductive_operators=draw(deductive_operators()),
    )
    statics = [Function("old", (each,)) for each in PLACES if draw(st.integers(0, 5))]
    statics += draw(st.sampled_from([[], [], [Function("tied", (PLACES[1], PLACES[2]))]]))
    start = draw(st.lists(atoms((HOME,)), min_size=1, max_size=4))
    start += [Function("lit", (each,)) for each in PLACES] if draw(st.integers(0, 3)) == 0 else []
    goal = draw(st.lists(atoms((GOAL,)), min_size=1, max_size=2))
    wide = Exists((Parameter(X, "place"),), Literal(Function("lit", (X,))))
    conditions = [Literal(each) for each in goal] + draw(st.sampled_from([[], [], [wide]]))
    return Problem(
        "random",
        domain,
        {each.name: "place" for each in PLACES},
        tuple(dict.fromkeys(statics)),
        tuple(dict.fromkeys(start)),
        And(tuple(conditions)),
        complete=True,
    )


def whole(problem: Problem) -> GroundTask:
    """The task of the whole problem, if its operators do not contradict themselves."""
    try:
        return ground(problem)
    except InvalidInput:
        assume(False)
        raise


def shortest(task: GroundTask) -> int | None:
    """The number of steps of a shortest plan by breadth-first search; None if there is no plan."""
    seen, waiting = {task.initial: 0}, deque([task.initial])
    while waiting:
        state = waiting.popleft()
        if any(goal & ~state == 0 for goal in task.goals):
            return seen[state]
        assume(len(seen) < MOST)
        for operator in task.operators:
            if operator.preconditions & ~state == 0:
                after = progress_state(state, operator)
                if after not in seen:
                    seen[after] = seen[state] + 1
                    waiting.append(after)
    return None


@pytest.mark.slow
@DILIGENT
@given(problems())
def test_a_faithful_thinned_task_has_shortest_plans_as_short_as_those_of_the_whole(
    problem: Problem,
) -> None:
    every, small = whole(problem), drop_irrelevant_objects(problem)
    assume(small.left_out)
    task = drop_irrelevant_operators(ground(small.problem))
    proved = preserves_optimality(task, small.spares)
    event(f"faithful: {proved}")
    assume(proved)
    assert shortest(task) == shortest(every)


@DILIGENT
@given(problems())
def test_operators_that_contribute_to_no_goal_shorten_no_plan(problem: Problem) -> None:
    task = whole(problem)
    assert shortest(drop_irrelevant_operators(task)) == shortest(task)


@DILIGENT
@given(problems())
def test_planning_by_need_and_planning_the_whole_agree_on_solvability(problem: Problem) -> None:
    length = shortest(whole(problem))
    outcome, _ = plan_and_ground(problem)
    event(f"solvable: {length is not None}")
    assert isinstance(outcome, Found) == (length is not None)
    assert isinstance(outcome, Found | Infeasible)
    if isinstance(outcome, Found):
        assert len(outcome.plan.steps) >= (length or 0)
