"""Arithmetic inside terms means the same to clingo, which grounds it, and to the checker, which
solves bodies itself.
"""

from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.lifted.fact_queries import FactSet, is_satisfiable
from cellwright.kb.loader import load_problem
from cellwright.kb.syntax import parse_expression

DOMAIN = """domain: shelves
include: [rules.lp]
types: {item: object, place: object}
functions:
  slot(int): place
objects: {item: [bolt]}
statics:
  num(int): {}
  step(int, int): {}
  known(place): {}
  said(item, text): {}
  heard(item): {}
fluents:
  at(item, place): {}
derived:
  high(item): {}
operators:
  move(Item, From, To):
    where: "WHERE"
    preconditions: at(Item, From)
    adds: at(Item, To)
deductive_operators:
  - when: at(Item, Place)
    denies: at(Item, Other), Other != Place
"""
RULES = """num(1..4). step(N, N + 1) :- num(N). known(slot(N)) :- num(N). place(slot(N)) :- num(N).
high(I) :- num(N), at(I, slot(N + 2)), N * 2 > 1.
said(bolt, "heard(I) :- said"). heard(I) :- said(I, _).
"""
PROBLEM = """problem: up
domain: domain.yaml
initial: ["at(bolt, slot(1))"]
goals: [high(bolt)]
"""


def problem_file(folder: Path, where: str) -> str:
    (folder / "domain.yaml").write_text(DOMAIN.replace("WHERE", where))
    (folder / "rules.lp").write_text(RULES)
    (folder / "problem.yaml").write_text(PROBLEM)
    return str(folder / "problem.yaml")


@pytest.mark.parametrize(
    "where",
    [
        "From = slot(N), To = slot(N + 1)",
        "To = slot(M), M = N + 1, From = slot(N)",
        "known(slot(N + 1)), num(N), From = slot(N), To = slot(N + 1)",
        "step(N, N + 1), From = slot(N), To = slot(N + 1)",
        "num(N), From = slot(N), To = slot(N + 1), not known(slot(N + 4))",
        "num(N), From = slot(N), To = slot((N * 2 + 2) / 2)",
    ],
)
def test_the_checker_accepts_what_grounding_found(tmp_path: Path, where: str) -> None:
    outcome = checked_plan.plan_problem(load_problem(problem_file(tmp_path, where)))
    assert isinstance(outcome, Found)
    assert len(outcome.plan.steps) == 2


def test_an_equation_waits_until_its_sum_can_be_done() -> None:
    facts = FactSet(parse_expression("atoms", "last(5), num(3), num(4)").value)
    assert is_satisfiable(parse_expression("body", "last(M), M = N + 1, num(N)").value, facts, {})
    assert not is_satisfiable(
        parse_expression("body", "last(M), M = N + 3, num(N)").value, facts, {}
    )
