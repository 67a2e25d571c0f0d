"""PDDL tasks with times in the library: read, planned, checked."""

from fractions import Fraction
from pathlib import Path

import pytest

import cellwright
from tests.timed_examples import CELLAR, FUSES


@pytest.fixture
def task(tmp_path: Path) -> cellwright.TimedTask:
    (tmp_path / "domain.pddl").write_text(CELLAR, "utf-8")
    (tmp_path / "problem.pddl").write_text(FUSES, "utf-8")
    return cellwright.read_timed_pddl(tmp_path / "domain.pddl", tmp_path / "problem.pddl")


def test_an_answer_is_a_plan_text_and_data(task: cellwright.TimedTask, tmp_path: Path) -> None:
    answer = cellwright.plan_timed(task, expansions=2000)
    assert answer.plan is not None
    assert float(answer.plan.makespan) == answer.data()["makespan"]
    assert "(strike m1) [5.000]" in str(answer)
    (tmp_path / "plan.txt").write_text(answer.ipc(), "utf-8")
    for given in (answer, answer.plan, tmp_path / "plan.txt"):
        assert cellwright.validate_timed(task, given)


def test_a_wrong_plan_is_told_with_what_is_broken(
    task: cellwright.TimedTask, tmp_path: Path
) -> None:
    (tmp_path / "plan.txt").write_text("0.000: (strike m1) [4.500]\n", "utf-8")
    verdict = cellwright.validate_timed(task, tmp_path / "plan.txt")
    assert not verdict
    assert "0.5 off" in str(verdict)
    assert [each.code for each in verdict.diagnostics] == ["K501", "K502"]


def test_no_plan_is_an_answer_without_a_text(tmp_path: Path) -> None:
    dark = CELLAR.replace("(= ?duration 2)", "(= ?duration 6)")
    (tmp_path / "domain.pddl").write_text(dark, "utf-8")
    (tmp_path / "problem.pddl").write_text(FUSES, "utf-8")
    files = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    answer = cellwright.plan_timed(cellwright.read_timed_pddl(*files), expansions=100)
    assert (answer.status, answer.plan) == ("infeasible", None)
    with pytest.raises(cellwright.InvalidInput, match="there is no plan"):
        answer.ipc()


def test_a_time_limit_ends_the_search_with_the_best_plan(task: cellwright.TimedTask) -> None:
    answer = cellwright.plan_timed(task, anytime=True, seconds=0.3)
    assert answer.plan is not None
    assert answer.plan.makespan < Fraction(10)


def test_a_task_with_times_names_the_function_that_reads_it(tmp_path: Path) -> None:
    (tmp_path / "domain.pddl").write_text(CELLAR, "utf-8")
    (tmp_path / "problem.pddl").write_text(FUSES, "utf-8")
    with pytest.raises(cellwright.InvalidInput, match="read_timed_pddl"):
        cellwright.read_pddl(tmp_path / "domain.pddl", tmp_path / "problem.pddl")
