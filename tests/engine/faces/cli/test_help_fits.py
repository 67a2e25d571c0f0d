"""Help can be read on a terminal of 80 columns: nothing is cut off, and no choice is broken in
two.
"""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app


def verbs(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Every command and sub-command."""
    yield path
    for name, each in getattr(command, "commands", {}).items():
        yield from verbs(each, (*path, name))


def told(path: tuple[str, ...]) -> str:
    result = CliRunner().invoke(app, [*path, "--help"], env={"COLUMNS": "80", "TERM": "dumb"})
    assert result.exit_code == 0
    return result.stdout


# a list of choices, cut within a word
BROKEN = re.compile(r"<[a-z]+\|[a-z|]*(?<!\|)  +\S.*\n│ +[a-z|]*>")


def fits(path: tuple[str, ...]) -> bool:
    said = told(path)
    broken = [each[0] for each in BROKEN.finditer(said) if not _between_words(each[0])]
    return "…" not in said and not broken and all(len(line) <= 80 for line in said.splitlines())


@pytest.mark.parametrize(
    "path", ["run", "monitor", "results", "place", "motion plan", "store check"]
)
def test_nothing_is_cut_off_in_the_help_of_commands_with_long_words(path: str) -> None:
    assert fits(tuple(path.split()))


@pytest.mark.slow
def test_nothing_is_cut_off_in_the_help_of_any_command() -> None:
    assert [path for path in verbs(get_command(app)) if not fits(path)] == []


def _between_words(found: str) -> bool:
    """Whether the second line of a list of choices begins with a whole one."""
    return found.split("\n")[1].lstrip("│ ").startswith("|")
