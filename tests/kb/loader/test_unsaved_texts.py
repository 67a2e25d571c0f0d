"""Texts of an editor are read in place of files, by every reader; and it is noted what was read."""

import os
import shutil
from pathlib import Path

import pytest

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.files import read_unsaved
from cellwright.kb.loader import load


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    return Path(
        shutil.copytree(Path(__file__).parents[1] / "editing" / "laboratory", tmp_path / "themse")
    )


def test_what_is_not_saved_is_read_and_what_was_read_is_noted(cell: Path) -> None:
    domain, problem = cell / "domain.yaml", cell / "problems" / "two.yaml"
    text = domain.read_text().replace("furnace, freezer]", "furnace, freezer, fridge]")
    with read_unsaved({str(domain): text}) as desk:
        loaded = load(problem)
    assert "fridge" in loaded.domain.objects
    assert list(desk.read) == [
        str(problem),
        str(domain),
        str(cell / "rules.lp"),
        str(cell / "sensors.lp"),
    ]
    assert "fridge" not in load(problem).domain.objects


def test_a_file_that_is_only_in_the_editor_is_found(
    cell: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(cell)
    domain = Path("domain.yaml")
    text = domain.read_text().replace("[rules.lp,", "[rules.lp, more.lp,")
    texts = {
        str(cell / "domain.yaml"): text,
        str(cell / "more.lp"): "fits(L, mars_gripper) :- lid(L).\n",
    }
    with read_unsaved(texts):
        assert any(each.text.startswith("fits(L,mars") for each in load(domain).domain.asp)
    with read_unsaved({str(cell / "domain.yaml"): text}), pytest.raises(InvalidInput, match="K203"):
        load(domain)


def test_the_domain_of_a_problem_goes_by_the_name_in_the_editor(cell: Path) -> None:
    domain, problem = cell / "domain.yaml", cell / "problems" / "two.yaml"
    texts = {
        str(domain): domain.read_text().replace("domain: themse", "domain: renamed"),
        str(problem): problem.read_text().replace("domain: themse", "domain: renamed"),
    }
    with read_unsaved(texts):
        assert load(problem).domain.name == "renamed"


def test_a_text_is_as_little_trusted_as_a_file(cell: Path) -> None:
    domain = cell / "domain.yaml"
    for text, code in (
        ("domain: d\x07\n", "K001"),
        ("a" * 70_000_000, "K007"),
        ("domain: \ud800\n", "K001"),
    ):
        with read_unsaved({os.path.abspath(domain): text}), pytest.raises(InvalidInput, match=code):
            load(domain)
