"""Single facts that help: which are found, in which words, and what a dropped goal leaves
behind.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from cellwright.engine.formats.report.plans.explanation_report import explanation_text as text
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.plan_explanation import Amendment, Edit, Explanation
from cellwright.engine.pipelines.explanation import apply_amendment, explain_infeasibility
from cellwright.engine.pipelines.explanation.amendments import domain_facts, without_chains
from cellwright.engine.pipelines.explanation.possible_facts import solve_for_variable
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.asp import ground_term
from cellwright.kb.loader import load_problem
from cellwright.kb.model.conditions import And
from cellwright.kb.model.planning_problem import Chain, Problem
from cellwright.kb.terms import Atom, Function, Number, Operation, Variable

DOMAIN = """
domain: mixer
types: {vessel: object, arm: object}
objects: {vessel: [v1], arm: [left]}
statics:
  volume(vessel, int): {}
  needs(vessel, int): {}
  program(int): {}
  strength(arm, int): {}
  weight(vessel, int): {}
  broken(arm): {}
  sum_of(int): {}
  bound(int): {}
fluents:
  full(vessel): {}
  lifted(vessel): {}
  checked: {}
events:
  heated(vessel, int): {}
operators:
  fill(V):
    where: volume(V, Has), needs(V, Asked), 2 * Has + 1 >= Asked
    adds: full(V)
  heat(V, Time):
    where: program(Time)
    preconditions: full(V)
    adds: heated(V, Time)
  lift(Arm, V):
    where: strength(Arm, Most), weight(V, Own), Own <= Most, not broken(Arm)
    adds: lifted(V)
  check:
    where: bound(B), sum_of(S), S <= B
    adds: checked
include: [rules.lp]
"""
RULES = """
program(600..602).
needs((v1; v2), 10).
sum_of(S) :- S = #sum { W,V : weight(V, W) }.
"""
PROBLEM = """
problem: p
domain: mixer
"""
HAND = """
domain: hand
types: {probe: object}
objects: {probe: [p1, p2]}
fluents: {held(probe): {}, empty: {}}
operators:
  take(P):
    preconditions: empty
    adds: held(P)
    deletes: empty
"""
Write = Callable[[str], Problem]


@pytest.fixture
def cell(tmp_path: Path) -> Write:
    """Makes the problem of a text, in a small cell."""

    def write(rest: str) -> Problem:
        (tmp_path / "problems").mkdir()
        (tmp_path / "domain.yaml").write_text(DOMAIN)
        (tmp_path / "rules.lp").write_text(RULES)
        (tmp_path / "problems" / "p.yaml").write_text(PROBLEM + rest)
        return load_problem(str(tmp_path / "problems" / "p.yaml"))

    return write


def kinds(found: Explanation) -> list[str]:
    return [str(change) for change in found.changes if change.edits]


@pytest.mark.parametrize(
    ("statics", "goal", "advice"),
    [
        ("", "full(v1)", ["add static volume(v1, 5)"]),
        ("volume(v1, 2)", "full(v1)", ["change static volume(v1, 5) instead of volume(v1, 2)"]),
        (
            "strength(left, 4), weight(v1, 30)",
            "lifted(v1)",
            [
                "change static strength(left, 30) instead of strength(left, 4)",
                "change static weight(v1, 4) instead of weight(v1, 30)",
            ],
        ),
        (
            "strength(left, 4), weight(v1, 4), broken(left)",
            "lifted(v1)",
            ["remove static broken(left)"],
        ),
        ("weight(v1, 77)", "checked", ["add static bound(77)"]),
    ],
)
def test_numbers_are_the_nearest_that_a_comparison_asks_for(
    cell: Write, statics: str, goal: str, advice: list[str]
) -> None:
    problem = cell(
        f"statics: ['{statics}']\ngoals: ['{goal}']\n" if statics else f"goals: ['{goal}']\n"
    )
    found = kinds(explain_infeasibility(problem))
    assert set(advice) <= set(found)
    assert len({each.split(" instead")[0].rsplit(",")[0] for each in found}) == len(found)


def test_a_program_for_the_time_of_a_stage_is_found(cell: Write) -> None:
    problem = cell("statics: ['volume(v1, 5)']\nworkflow: [{stages: 'heated(v1, 1200)'}]\n")
    assert "add static program(1200)" in kinds(explain_infeasibility(problem))


@pytest.mark.slow
def test_capacity_is_one_piece_of_advice_with_the_least_number() -> None:
    found = kinds(explain_infeasibility(load_problem("themse/unsolvable")))
    assert found[0] == "add static capacity(freezer, 2)"
    assert sum("capacity(freezer" in each and "usual" not in each for each in found) == 1


@pytest.mark.slow
def test_a_fact_that_is_in_the_way_is_removed() -> None:
    problem = load_problem("bulkhead/tool_missing")
    given = Function("unavailable", (Function("slra"),))
    problem = replace(problem, statics=(*problem.statics, given), initial=problem.initial[:2])
    assert explain_infeasibility(problem).changes[0].edits == (Edit("static", None, given),)


def test_dropping_a_chain_leaves_no_chain_that_waits_for_it(tmp_path: Path) -> None:
    """Both chains end with a probe in the one hand, and the second waits for the first."""
    (tmp_path / "problems").mkdir()
    (tmp_path / "domain.yaml").write_text(HAND)
    file = tmp_path / "problems" / "p.yaml"
    file.write_text("problem: p\ndomain: hand\ninitial: [empty]\ngoals: [held(p1)]\n")
    one, two = (atom(f"held(p{n})") for n in (1, 2))
    chains = (
        Chain("1", (one,), (), one.arguments[0]),
        Chain("2", (two,), ("1",), two.arguments[0]),
    )
    problem = replace(load_problem(str(file)), chains=chains, goal=And(()))
    drops = [change for change in explain_infeasibility(problem).changes if change.goal]
    assert len(drops) == 2
    assert all(
        isinstance(checked_plan.plan_problem(apply_amendment(problem, each)), Found)
        for each in drops
    )


def test_what_waited_for_a_dropped_chain_waits_for_those_before_it() -> None:
    one, two, three = (
        Chain(name, (Function("r"),), after)
        for name, after in (("1", ()), ("2", ("1",)), ("3", ("2",)))
    )
    assert [each.after for each in without_chains((one, two, three), {"2"})] == [(), ("1",)]
    assert [each.after for each in without_chains((one, two, three), {"1", "2"})] == [()]


def test_one_fact_of_a_range_is_removed_and_the_others_stay(cell: Write) -> None:
    problem = cell("goals: [checked]\n")
    poorer = apply_amendment(problem, Amendment((Edit("static", None, atom("program(601)")),)))
    assert [str(each) for each in poorer.statics] == ["program(600)", "program(602)"]
    left = {str(each) for held in domain_facts(poorer.domain).values() for each in held}
    assert left == {"needs(v1, 10)", "needs(v2, 10)"}


def test_advice_is_said_in_plain_words() -> None:
    edits = (
        Edit("static", atom("small(bolt)")),
        Edit("static", atom("small(nut)")),
        Edit("initial", None, atom("at(lid, rim)")),
    )
    said = str(text(Explanation("infeasible", ("g",), changes=(Amendment(edits, proof=3),))))
    assert "a plan of 3 steps if the problem also said small(bolt) and small(nut)" in said
    assert "and if at(lid, rim) did not hold at the start" in said


def test_a_comparison_is_solved_for_any_side() -> None:
    x = Variable("X")
    for inside, value in (
        (Operation("+", x, Number(2)), "(7-2)"),
        (Operation("-", Number(9), x), "(9-7)"),
        (Operation("*", Number(3), Operation("-", x, Number(1))), "((7/3)+1)"),
        (Operation("\\", x, Number(3)), "None"),
    ):
        assert str(solve_for_variable(inside, Number(7), x)) == value


def atom(said: str) -> Atom:
    found = ground_term(said)
    assert isinstance(found, Function)
    return found
