"""The domain that `cellwright init` writes does everything that a domain can do."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cellwright.engine.authoring.starter import create_domain
from cellwright.engine.faces.cli import app

CAUSES = ("item_missing", "jaws_worn", "sensor_dirty")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("starter") / "my cell"
    create_domain(made)
    return made


def answer(*arguments: object) -> tuple[int, dict[str, Any]]:
    result = CliRunner().invoke(app, [*map(str, arguments), "--format", "json"])
    envelope: dict[str, Any] = json.loads(result.stdout)
    assert envelope["diagnostics"] == []
    return result.exit_code, envelope["data"]


@pytest.mark.parametrize("verb", ["check", "test"])
def test_nothing_is_wrong_with_it(folder: Path, verb: str) -> None:
    assert answer(verb, folder)[0] == 0


def test_its_words_are_understood(folder: Path) -> None:
    problem, words = (
        folder / "problems" / "two_items.yaml",
        "put the bolt into the left bin and open the right bin",
    )
    code, found = answer("plan", problem, "--command", words)
    assert (code, len(found["plan"]["steps"])) == (0, 4)


@pytest.mark.parametrize("cause", CAUSES)
def test_its_tests_tell_every_cause(folder: Path, cause: str) -> None:
    code, found = answer("diagnose", folder, "--exception", "not_gripped", "--hidden", cause)
    assert code == 0
    assert [each["causes"] for each in found["hypotheses"]] == [[cause]]


def test_an_item_that_the_sensor_did_not_see_is_not_picked_again(folder: Path) -> None:
    case = (
        "--exception",
        "not_gripped",
        "--step",
        "pick(bolt)",
        "--hidden",
        "sensor_dirty",
        "--recover",
    )
    _, found = answer("diagnose", folder / "problems" / "two_items.yaml", *case)
    operators = [step["operator"] for step in found["recovery"]["plan"]["steps"]]
    assert "pick(plate)" in operators
    assert "pick(bolt)" not in operators
