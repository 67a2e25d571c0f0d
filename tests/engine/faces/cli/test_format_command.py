"""`cellwright format` writes what is to be written, and nothing else."""

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.kb.targets import BUNDLED_DOMAINS

UNUSUAL = "domain: d\ntypes:\n    place: object   # where\n"
USUAL = "domain: d\ntypes:\n  place: object     # where\n"


def run(*arguments: str) -> tuple[int, str, str]:
    ran = CliRunner().invoke(app, ["format", *arguments], env={"COLUMNS": "120"})
    return ran.exit_code, ran.stdout, ran.stderr


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "domain.yaml"
    path.write_text(UNUSUAL)
    path.chmod(0o640)
    return path


def test_a_check_says_what_would_change_and_writes_nothing(file: Path) -> None:
    code, said, _ = run(str(file), "--check")
    assert code == 1
    assert f"would change {file}" in said.replace("\n", "")
    assert file.read_text() == UNUSUAL


def test_a_file_is_written_anew_with_its_permissions(file: Path) -> None:
    assert run(str(file))[0] == 0
    assert file.read_text() == USUAL
    assert file.stat().st_mode & 0o777 == 0o640
    assert [each.name for each in file.parent.iterdir()] == ["domain.yaml"]
    assert run(str(file), "--check")[0] == 0


def test_a_link_stays_a_link(file: Path) -> None:
    link = file.with_name("link.yaml")
    link.symlink_to(file)
    assert run(str(link))[0] == 0
    assert link.is_symlink()
    assert file.read_text() == USUAL


def test_a_broken_file_is_told_and_left_and_the_others_are_done(file: Path) -> None:
    broken = file.with_name("rules.lp")
    broken.write_text("p(X) :- q(X\n")
    code, said, told = run(str(file.parent))
    assert code == 2
    assert "K201" in told
    assert "1 broken" in said
    assert broken.read_text() == "p(X) :- q(X\n"
    assert file.read_text() == USUAL


@pytest.mark.parametrize(
    ("name", "code"),
    [("nothing.yaml", "K001"), ("page.md", "K413"), ("empty", "K401"), ("empty.yaml", "K002")],
)
def test_what_cannot_be_formatted_is_refused(tmp_path: Path, name: str, code: str) -> None:
    (tmp_path / "page.md").write_text("# page")
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty.yaml").write_text("")
    ended, _, told = run(str(tmp_path / name))
    assert ended == 2
    assert code in told


def test_json(file: Path) -> None:
    _, said, _ = run(str(file), "--format", "json")
    assert json.loads(said)["data"] == {"changed": [str(file)], "files": 1}


def test_the_domains_that_we_ship_have_their_usual_form(tmp_path: Path) -> None:
    shutil.copytree(BUNDLED_DOMAINS / "themse", tmp_path / "themse")
    assert run(str(tmp_path / "themse"), "--check")[0] == 0
