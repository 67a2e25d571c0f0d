"""The examples of the page on commands are what the grammar makes of them."""

import re
from pathlib import Path

import pytest
from test_command_sentences import printed

from cellwright.kb.commands import check_phrases, understand_command
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_domain
from cellwright.kb.model.domain_model import Domain

PAGE = (Path(__file__).parents[3] / "docs" / "commands.md").read_text("utf-8")
BLOCKS = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
ORDERS = [block for block in BLOCKS if block.startswith("say: ")]
ERRORS = [block for block in BLOCKS if block.startswith("--command")]


@pytest.mark.parametrize("block", ORDERS)
def test_an_example_of_an_order(block: str, themse: Domain) -> None:
    sentence = block.splitlines()[0].removeprefix("say: ")
    assert printed(themse, sentence) == block


@pytest.mark.parametrize("block", ERRORS)
def test_an_example_of_an_error(block: str, themse: Domain) -> None:
    with pytest.raises(InvalidInput) as raised:
        understand_command(themse, block.splitlines()[1].strip())
    assert str(raised.value).startswith(block.rstrip())


def test_there_are_examples() -> None:
    assert len(ORDERS) >= 5
    assert ERRORS


def test_the_page_names_every_code_of_commands() -> None:
    from cellwright.kb.diagnostics import DIAGNOSTIC_CODES

    assert {code for code in DIAGNOSTIC_CODES if code.startswith("K6")} == set(
        re.findall(r"^\| (K6\d\d) ", PAGE, re.MULTILINE)
    )


@pytest.mark.parametrize("said", re.findall(r"^\| (\d.*?an hour) \|", PAGE, re.MULTILINE))
def test_the_times_of_the_page_are_understood(said: str, themse: Domain) -> None:
    for time in said.split(", "):
        assert understand_command(themse, f"heat probe 1 for {time}").chains


@pytest.mark.parametrize("name", ["themse", "bulkhead", "screening", "elisa"])
def test_the_phrases_of_bundled_cells_are_sound(name: str) -> None:
    assert check_phrases(load_domain(name)) == []
