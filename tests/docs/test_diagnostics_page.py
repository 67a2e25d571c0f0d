"""The page on diagnostics explains every code, with messages as they are printed."""

import re
from pathlib import Path

import pytest

from cellwright.kb.diagnostics import DIAGNOSTIC_CODES

TOP = Path(__file__).parents[2]
PAGE = (TOP / "docs" / "diagnostics.md").read_text("utf-8")
PRINTED = TOP / "tests" / "golden" / "diagnostics"
SECTIONS = dict(re.findall(r"^### (K\d{3}: .*)\n((?:(?!##).*\n)*)", PAGE, re.MULTILINE))
SHOWN = sorted({file.name[:4] for file in PRINTED.glob("K*.txt")})


def section(code: str) -> str:
    return SECTIONS[f"{code}: {DIAGNOSTIC_CODES[code]}"]


def test_every_code_stands_there_once_in_order() -> None:
    assert re.findall(r"^### (.*)", PAGE, re.MULTILINE) == [
        f"{code}: {said}" for code, said in DIAGNOSTIC_CODES.items()
    ]


@pytest.mark.parametrize("code", DIAGNOSTIC_CODES)
def test_a_code_is_explained(code: str) -> None:
    explained = re.sub(r"```text\n.*?```", "", section(code), flags=re.DOTALL)
    assert len(explained.split()) >= 8


@pytest.mark.parametrize("code", SHOWN)
def test_the_example_of_a_code_is_what_is_printed(code: str) -> None:
    example = re.search(r"```text\n(.*?)```", section(code), re.DOTALL)
    assert example
    printed = {
        file.read_text("utf-8").replace(f"{file.stem}/", "")
        for file in PRINTED.glob(f"{code}_*.txt")
    }
    assert example[1] in printed
