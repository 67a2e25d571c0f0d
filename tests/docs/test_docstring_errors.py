"""Docstrings name errors that exist: after a rename, the old name is gone from `Raises`."""

import builtins
import re
from collections.abc import Iterator
from pathlib import Path

from tests.places import TOP

RAISES = re.compile(r"[Rr]aises?\s+((?:`[\w.]+`(?:,?\s+and\s+|,?\s+or\s+|,\s+)?)+)")
CLASS = re.compile(r"^\s*class (\w+)", re.MULTILINE)
IMPORTED = re.compile(r"^\s*(?:from [\w.]+ )?import (\([^)]*\)|[^\n]*)", re.MULTILINE)
ROOMS = ("kb", "engine", "domains")


def module_texts() -> Iterator[tuple[Path, str]]:
    paths = [path for room in ROOMS for path in (TOP / room).rglob("*.py")]
    for path in [*paths, *(TOP / "cellwright").glob("*.py")]:
        yield path, path.read_text("utf-8")


def defined_names(text: str) -> set[str]:
    """The classes that a module defines, and what it imports."""
    imported = (name for names in IMPORTED.findall(text) for name in re.findall(r"\w+", names))
    return {*CLASS.findall(text), *imported}


def raised_names(text: str) -> set[str]:
    """The names of errors in the docstrings of a module."""
    return {name for names in RAISES.findall(text) for name in re.findall(r"`([\w.]+)`", names)}


def test_errors_in_docstrings_exist() -> None:
    texts = list(module_texts())
    known = {*dir(builtins), "BadParameter"}.union(*(defined_names(text) for _, text in texts))
    missing = {
        (str(path.relative_to(TOP)), name)
        for path, text in texts
        for name in raised_names(text)
        if name.rpartition(".")[2] not in known
    }
    assert not missing
