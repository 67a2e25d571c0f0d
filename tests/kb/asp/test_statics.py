"""Static facts: those that are only given are read past clingo, and a program about some
predicates says the same of them.
"""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.kb.asp import Grounder
from cellwright.kb.asp.statements import ParsedStatement, read_statements
from cellwright.kb.asp.static_facts import (
    evaluate_statics,
    ground_statics,
    only_given,
    static_suspects,
)
from cellwright.kb.asp.static_program import VIOLATED, static_program
from cellwright.kb.diagnostics import Source
from cellwright.kb.loader import find_target, load
from cellwright.kb.model.domain_model import Domain, Kind, Predicate, Type
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number

TARGETS = ("bulkhead/twelve_points", "themse/one", "bulkhead/both_tools")
DOMAIN = """domain: shelf
include: [rules.lp]
types: {thing: object, item: thing, place: object, spot: term}
functions: {on(place): spot}
objects: {item: [bolt, nut], place: [table, bin]}
statics: {"weight(item, int)": {}, "heavy(item)": {}, "near(place, place)": {}, "odd(item)": {}}
fluents: {"at(item, spot)": {}}
operators:
  put(Item, Place): {adds: "at(Item, on(Place))"}
"""
RULES = """heavy(I) :- weight(I, W), W > 3.
near(A, B) :- near(B, A).
:- weight(I, W), W < 0.
odd(I) :- item(I), not heavy(I).
"""


def problem_of(target: str) -> Problem:
    problem = load(find_target(target)).problem
    assert problem is not None
    return problem


def shelf(folder: Path, statics: str, rules: str = RULES) -> Problem:
    (folder / "domain.yaml").write_text(DOMAIN)
    (folder / "rules.lp").write_text(rules)
    file = folder / "one.yaml"
    goals = 'goals: ["at(bolt, on(bin))"]'
    file.write_text(f"problem: one\ndomain: domain.yaml\nstatics: [{statics}]\n{goals}\n")
    return problem_of(str(file))


def facts(grounder: Grounder) -> set[Atom]:
    return set(grounder.everything())


def plainly(problem: Problem) -> Grounder:
    grounder = Grounder()
    grounder.ground(static_program(problem))
    return grounder


@pytest.mark.parametrize("target", TARGETS)
def test_what_is_read_past_clingo_is_what_clingo_says(target: str) -> None:
    problem = problem_of(target)
    plain, quick = plainly(problem), evaluate_statics(problem)
    assert only_given(problem)
    for name, arity in only_given(problem):
        assert quick.atoms(name, arity) == plain.atoms(name, arity), name
        assert list(quick.named(name)) == list(plain.named(name))
    assert facts(quick) == facts(plain)
    assert all(quick.holds(each) for each in facts(plain))


def test_predicates_of_which_a_rule_a_type_or_a_constant_speaks_are_left_to_clingo(
    tmp_path: Path,
) -> None:
    problem = shelf(tmp_path, '"weight(bolt, 5)", "near(table, bin)"')
    assert set(only_given(problem)) == {("item", 1), ("place", 1), ("weight", 2)}
    assert ("weight", 2) not in only_given(problem, ["weight(nut, 1)."])
    assert ("weight", 2) not in only_given(problem, ["a(1) :- item(X). weight(X, 1) :- a(X)."])
    assert ("weight", 2) in only_given(problem, ["_far(X) :- weight(X, 9)."])
    named = shelf(tmp_path, '"weight(bolt, 5)"', RULES + "#const most = 7.\n")
    assert not only_given(named)


@settings(max_examples=30, deadline=None)
@given(st.data())
def test_a_program_about_some_predicates_says_of_them_what_the_whole_one_says(
    data: st.DataObject,
) -> None:
    problem = problem_of(data.draw(st.sampled_from(TARGETS)))
    whole = facts(plainly(problem))
    names = sorted({each.name for each in whole} | {VIOLATED, "unheard_of"})
    about = data.draw(st.sets(st.sampled_from(names), max_size=4))
    some = Grounder()
    some.ground(static_program(problem, about))
    assert {each for each in facts(some) if each.name in about} == {
        each for each in whole if each.name in about
    }


def test_problems_with_the_same_facts_share_what_was_evaluated(tmp_path: Path) -> None:
    one = shelf(tmp_path, '"weight(bolt, 5)"')
    assert evaluate_statics(one) is evaluate_statics(one.replace(()))
    assert evaluate_statics(one) is not evaluate_statics(one, ["_far(X) :- weight(X, 9)."])
    other = shelf(tmp_path, '"weight(bolt, 2)"')
    assert {str(each) for each in facts(evaluate_statics(other)) if each.name == "odd"} == {
        "odd(bolt)",
        "odd(nut)",
    }


def test_a_grounder_that_knows_some_facts_goes_on_from_all(tmp_path: Path) -> None:
    grounder = Grounder()
    ground_statics(grounder, shelf(tmp_path, '"weight(bolt, 5)"'))
    grounder.ground("_twice(I, 2*W) :- weight(I, W).")
    assert [[str(each) for each in row] for row in grounder.atoms("_twice", 2)] == [["bolt", "10"]]


CHAINED = """
fits(T, M) :- tool(T), point(M).
better(T, M) :- fits(T, M), fits(U, M), rank(T, P), rank(U, Q), Q < P.
at(M, X) :- place(M, X, _), fits(_, M).
crossed(M, N) :- point(M), point(N).
"""


def test_the_bound_on_a_rule_counts_what_its_variables_can_be() -> None:
    """Two tools and a thousand points: only a rule over pairs of points may have a million
    instances.
    """
    types = {
        "tool": ("tool",),
        "point": ("point",),
        "fits": ("tool", "point"),
        "rank": ("tool", "int"),
    }
    types |= {"place": ("point", "int", "int"), "at": ("point", "int"), "better": ("tool", "point")}
    parsed = read_statements(CHAINED, lambda line, _column: Source("rules.lp", line))
    domain = Domain(
        "shop",
        {"tool": Type("tool"), "point": Type("point")},
        predicates={name: Predicate(name, each, Kind.STATIC) for name, each in types.items()},
        asp=tuple(each.statement for each in parsed if isinstance(each, ParsedStatement)),
    )
    points = [f"m{number}" for number in range(1000)]
    facts = [
        Function("place", (Function(each), Number(n), Number(n))) for n, each in enumerate(points)
    ]
    facts += [Function("rank", (Function(each), Number(n))) for n, each in enumerate(("t", "u"))]
    problem = Problem(
        "many", domain, {"t": "tool", "u": "tool", **dict.fromkeys(points, "point")}, tuple(facts)
    )
    bounds = {each.what.split("(")[0]: each.bound for each in static_suspects(problem)}
    assert bounds == {"fits": 2_000, "better": 4_000, "at": 2_000, "crossed": 1_000_000}
