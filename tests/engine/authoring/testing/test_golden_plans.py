import shutil
from pathlib import Path

import pytest

from cellwright.engine.authoring.starter import create_domain
from cellwright.engine.authoring.testing.golden_files import accept_answer, compare_all
from cellwright.kb.diagnostics import InvalidInput

pytest_plugins = ["pytester"]


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    create_domain(tmp_path / "cell")
    return tmp_path / "cell"


def test_an_accepted_answer_is_the_same_again(cell: Path) -> None:
    assert [each.verdict for each in compare_all(str(cell))] == ["same"]


def test_the_same_domain_elsewhere_gives_the_same_golden_files(cell: Path, tmp_path: Path) -> None:
    moved = tmp_path / "elsewhere"
    shutil.copytree(cell, moved)
    assert [each.verdict for each in compare_all(str(moved))] == ["same"]


def test_a_changed_goal_says_what_it_changes(cell: Path) -> None:
    problem = cell / "problems" / "two_items.yaml"
    problem.write_text(problem.read_text().replace("  - position(left, closed)\n", ""))
    (found,) = compare_all(str(cell))
    assert found.verdict == "different"
    assert found.meaning[:2] == ("other goals", "cost 7 -> 6")
    assert any(line.startswith("-goal: position(left, closed)") for line in found.diff)


def test_an_unsolvable_problem_has_a_golden_answer_too(cell: Path) -> None:
    problem = cell / "problems" / "two_items.yaml"
    (cell / "problems" / "never.yaml").write_text(
        problem.read_text()
        .replace("two_items", "never")
        .replace("sorted(bolt, _)", "sorted(bolt, right)")
    )
    never = next(each for each in compare_all(str(cell)) if each.name == "never")
    assert never.verdict == "new"
    accept_answer(never)
    assert [each.verdict for each in compare_all(str(cell))] == ["same", "same"]
    assert '"status": "infeasible"' in (cell / "golden" / "never.json").read_text()


def test_a_golden_file_without_a_problem_is_an_orphan_and_is_removed(cell: Path) -> None:
    shutil.copy(cell / "golden" / "two_items.json", cell / "golden" / "old.json")
    orphan = next(each for each in compare_all(str(cell)) if each.verdict == "orphan")
    accept_answer(orphan)
    assert not (cell / "golden" / "old.json").exists()


def test_a_damaged_golden_file_is_bad_input(cell: Path) -> None:
    (cell / "golden" / "two_items.json").write_text("{")
    with pytest.raises(InvalidInput, match="K413"):
        list(compare_all(str(cell)))


def test_the_plugin_tests_a_domain_and_shows_the_difference(
    cell: Path, pytester: pytest.Pytester
) -> None:
    shutil.copytree(cell, pytester.path / "cell")
    pytester.runpytest("cell").assert_outcomes(passed=1)
    problem = pytester.path / "cell" / "problems" / "two_items.yaml"
    problem.write_text(problem.read_text().replace("  - position(left, closed)\n", ""))
    result = pytester.runpytest("cell")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*other goals, cost 7 -> 6*", "*-goal: position(left, closed)*"])


def test_a_problem_that_says_slow_is_tested_with_the_slow_ones(
    cell: Path, pytester: pytest.Pytester
) -> None:
    shutil.copytree(cell, pytester.path / "cell")
    problem = pytester.path / "cell" / "problems" / "two_items.yaml"
    problem.write_text("# slow\n" + problem.read_text())
    pytester.makeini("[pytest]\nmarkers = slow: long")
    pytester.runpytest("cell", "-m", "not slow").assert_outcomes(deselected=1)


def test_the_plugin_accepts_answers_only_outside_continuous_integration(
    cell: Path, pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(cell, pytester.path / "cell")
    (pytester.path / "cell" / "golden" / "two_items.json").unlink()
    monkeypatch.setenv("CI", "true")
    pytester.runpytest("cell", "--update-plans").assert_outcomes(failed=1)
    monkeypatch.delenv("CI")
    pytester.runpytest("cell", "--update-plans").assert_outcomes(passed=1)
    pytester.runpytest("cell").assert_outcomes(passed=1)
