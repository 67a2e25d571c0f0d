"""Excerpts of large problems: clingo says of the objects that stay what it says of them in the
whole problem.
"""

from dataclasses import replace

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from cellwright.kb.asp.excerpt import excerpt_problem
from cellwright.kb.asp.statements import ParsedStatement, read_statements
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.diagnostics import Source
from cellwright.kb.model.conditions import Comparison, Literal, Parameter
from cellwright.kb.model.domain_model import (
    Default,
    Domain,
    Effect,
    Kind,
    Operator,
    Predicate,
    Type,
)
from cellwright.kb.model.object_likeness import constant_names
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number, Variable

X, Y = Variable("X"), Variable("Y")
STATICS = {
    "wide": ("point",),
    "deep": ("point", "int"),
    "near": ("point", "point"),
    "good": ("point",),
    "lonely": ("point",),
    "pair": ("point", "point"),
    "many": (),
    "apart": ("point", "point"),
}
RULES = (
    "good(X) :- wide(X), not lonely(X).",
    "good(X) :- deep(X,W), W < 3.",
    "lonely(X) :- point(X), not near(X,_), not near(_,X).",
    "pair(X,Y) :- wide(X), wide(Y), X != Y.",
    "pair(X,Y) :- near(X,Z), near(Z,Y).",
    "many :- point(X), point(Y), point(Z), X != Y, Y != Z, X != Z, not wide(X), not wide(Y), "
    "not wide(Z).",
    "many :- pair(X,Y), deep(X,V), deep(Y,W), V < W.",
    "apart(X,Y) :- point(X), point(Y), not pair(X,Y), not pair(Y,X).",
    "apart(X,Y) :- apart(X,Z), apart(Z,Y), good(Y).",
    "good(p3) :- many.",
    ":- lonely(X), wide(X), many.",
)


def domain(rules: list[str], body: tuple[Literal | Comparison, ...]) -> Domain:
    predicates = {name: Predicate(name, types, Kind.STATIC) for name, types in STATICS.items()}
    predicates["done"] = Predicate("done", ("point",), Kind.FLUENT)
    parsed = read_statements("\n".join(rules), lambda _line, _column: Source("rules.lp"))
    go = Operator(
        "go",
        (Parameter(X, "point"), Parameter(Y, "point")),
        Literal(Function("done", (Y,))),
        (Effect(Function("done", (X,))),),
        body,
    )
    return Domain(
        "random",
        {"point": Type("point")},
        predicates=predicates,
        operators=(go,),
        asp=tuple(each.statement for each in parsed if isinstance(each, ParsedStatement)),
    )


def atom(name: str, *arguments: str | int) -> Atom:
    return Function(
        name, tuple(Number(a) if isinstance(a, int) else Function(a) for a in arguments)
    )


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    """Twenty points, many of which are alike; some are tied to each other."""
    rules = draw(st.lists(st.sampled_from(RULES), unique=True, min_size=1))
    heads = {rule.split("(")[0].split(" ")[0] for rule in rules}
    read = tuple(Literal(Function(each, (X,))) for each in ("good", "lonely") if each in heads)
    both = tuple(
        Literal(Function(each, (X, Y)), draw(st.booleans()))
        for each in ("pair", "apart")
        if each in heads
    )
    points = [f"p{number}" for number in range(1, 21)]
    facts = [atom("wide", each) for each in points if draw(st.integers(0, 3)) == 0]
    facts += [atom("deep", each, draw(st.integers(1, 4))) for each in points[::2]]
    facts += [
        atom("near", *draw(st.tuples(st.sampled_from(points), st.sampled_from(points))))
        for _ in range(draw(st.integers(0, 3)))
    ]
    initial = (atom("done", draw(st.sampled_from(points))),)
    goal = Literal(atom("done", draw(st.sampled_from(points))))
    return Problem(
        "random",
        domain(rules, read + both),
        dict.fromkeys(points, "point"),
        tuple(dict.fromkeys(facts)),
        initial,
        goal,
    )


def about(problem: Problem, kept: set[str]) -> set[str]:
    """What is true of some objects, as clingo says, as far as operators ask for it."""
    asked = {
        part.atom.name
        for each in problem.domain.operators
        for part in each.body
        if isinstance(part, Literal)
    }
    found = (each for each in evaluate_statics(problem).everything() if each.name in asked)
    return {str(each) for each in found if kept.issuperset(constant_names(each))}


@settings(deadline=None)
@given(problems())
def test_an_excerpt_says_of_its_objects_what_the_whole_says(problem: Problem) -> None:
    few = excerpt_problem(problem)
    event(f"left out: {len(few.objects) < len(problem.objects)}")
    assert about(few, set(few.objects)) == about(problem, set(few.objects))


def test_of_many_alike_few_stay_and_those_that_are_named() -> None:
    points = [f"p{number}" for number in range(1, 301)]
    problem = Problem(
        "many",
        domain(list(RULES[:4]), (Literal(Function("good", (X,))),)),
        dict.fromkeys(points, "point"),
        (atom("wide", "p7"),),
        (),
        Literal(atom("done", "p200")),
    )
    few = excerpt_problem(problem, {"p100"})
    assert {"p7", "p100", "p200"} <= set(few.objects)
    assert len(few.objects) < 20
    assert (
        len(excerpt_problem(replace(problem, objects={**problem.objects, "q": "point"})).objects)
        < 20
    )


COUNTING = "many :- 7 <= #count { X : wide(X) }."
ORDERING = "pair(X,Y) :- wide(X), wide(Y), X < Y."


@pytest.mark.parametrize("rule", [COUNTING, ORDERING])
def test_a_problem_whose_rules_can_tell_objects_apart_stays_whole(rule: str) -> None:
    points = [f"p{number}" for number in range(1, 301)]
    facts = tuple(atom("wide", each) for each in points)
    problem = Problem(
        "many",
        domain([rule], ()),
        dict.fromkeys(points, "point"),
        facts,
        (),
        Literal(atom("done", "p2")),
    )
    assert excerpt_problem(problem) is problem


def test_objects_that_operators_order_stay() -> None:
    points = [f"p{number}" for number in range(1, 301)]
    problem = Problem(
        "many",
        domain([], (Comparison(X, "<", Y),)),
        dict.fromkeys(points, "point"),
        (),
        (),
        Literal(atom("done", "p2")),
    )
    assert excerpt_problem(problem) is problem


def test_objects_over_which_defaults_range_stay() -> None:
    points = [f"p{number}" for number in range(1, 301)]
    given = domain([], ())
    default = Default(Function("done", (X,)), (Parameter(X, "point"),))
    problem = Problem(
        "many", given, dict.fromkeys(points, "point"), (), (), Literal(atom("done", "p2"))
    )
    assert excerpt_problem(problem) is not problem
    assert (
        excerpt_problem(replace(problem, domain=replace(given, defaults=(default,)))).objects
        == problem.objects
    )
