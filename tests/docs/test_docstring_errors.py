"""Docstrings name errors that exist: after a rename, the old name is gone from `Raises`."""

import ast
import builtins
import re
from collections.abc import Iterator
from pathlib import Path

from tests.places import TOP

RAISES = re.compile(r"[Rr]aises? ((?:`[\w.]+`(?:,? and |,? or |, )?)+)")
ROOMS = ("kb", "engine", "domains")


def modules() -> Iterator[tuple[Path, ast.Module]]:
    paths = [path for room in ROOMS for path in (TOP / room).rglob("*.py")]
    for path in [*paths, *(TOP / "cellwright").glob("*.py")]:
        yield path, ast.parse(path.read_text("utf-8"))


def names_in(tree: ast.Module) -> Iterator[str]:
    """The classes that a module defines, and what it imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            yield node.name
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield from (alias.asname or alias.name for alias in node.names)


def raised_names(tree: ast.Module) -> Iterator[str]:
    """The names of errors in the docstrings of a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            for named in RAISES.finditer(ast.get_docstring(node) or ""):
                yield from re.findall(r"`([\w.]+)`", named[1])


def test_errors_in_docstrings_exist() -> None:
    trees = list(modules())
    known = {*dir(builtins), *(name for _, tree in trees for name in names_in(tree))}
    known |= {"typer.BadParameter"}
    missing = {
        (str(path.relative_to(TOP)), name)
        for path, tree in trees
        for name in raised_names(tree)
        if name not in known and name.rpartition(".")[2] not in known
    }
    assert not missing
