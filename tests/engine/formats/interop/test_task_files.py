"""Files of a PDDL task in a wrong order are told as that, and nothing else is refused for it."""

import itertools
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.formats.interop.pddl import read_pddl_task
from cellwright.kb.diagnostics import InvalidInput

TIMED = """; a comment before it
(DEFINE (Domain ways) (:requirements :durative-actions)
  (:predicates (there))
  (:durative-action go :parameters () :duration (= ?duration 5)
    :condition () :effect (at end (there))))
"""
PLAIN = """
(define (domain ways) (:predicates (there)) (:action go :parameters () :effect (there)))
"""
TASK = "(define\n(problem one) (:domain ways) (:init) (:goal (there)))\n"


@pytest.mark.parametrize(
    ("domain", "plan"),
    [
        (TIMED, "; a plan\n\n0.000: (go) [5.000]\n"),
        (TIMED, "0: (go)[5] ; done\n"),
        (PLAIN, "(go)\n"),
        (PLAIN, "\n(go) ; done\n(go)\n"),
    ],
)
def test_each_wrong_order_is_told(tmp_path: Path, domain: str, plan: str) -> None:
    files = {"domain": domain, "problem": TASK, "plan": plan}
    for kind, text in files.items():
        (tmp_path / kind).write_text(text)
    for order in itertools.permutations(files):
        line = ["validate", "--pddl", *(str(tmp_path / kind) for kind in order)]
        result = CliRunner().invoke(app, line)
        if order == tuple(files):
            assert result.output.startswith("valid")
            continue
        wrong = [pair for pair in zip(order, files, strict=True) if pair[0] != pair[1]]
        said = [f"this is a {kind}, but a PDDL {wanted} is wanted here" for kind, wanted in wrong]
        assert result.exit_code == 2
        assert any(sentence in result.output for sentence in said)
        assert "K801" in result.output
        assert "the domain comes first" in result.output


@pytest.mark.parametrize("domain", [TIMED, PLAIN])
def test_plan_tells_that_the_problem_came_first(tmp_path: Path, domain: str) -> None:
    (tmp_path / "domain").write_text(domain)
    (tmp_path / "problem").write_text(TASK)
    line = ["plan", "--pddl", str(tmp_path / "problem"), str(tmp_path / "domain")]
    result = CliRunner().invoke(app, line)
    assert "this is a problem, but a PDDL domain is wanted here" in result.output


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("(defie (domain ways))", "begins no PDDL file"),
        ("(define (domian ways))", "domian is not supported"),
        ("set instance egg food\n", "outside all parentheses"),
        ("", "no expression"),
    ],
)
def test_what_is_none_of_the_three_is_told_by_the_reader(
    tmp_path: Path, text: str, said: str
) -> None:
    (tmp_path / "domain").write_text(text)
    (tmp_path / "problem").write_text(TASK)
    with pytest.raises(InvalidInput, match=said):
        read_pddl_task(tmp_path / "domain", tmp_path / "problem")
