"""Dotted names and paths in pages are modules, classes, functions and files that are there."""

import re
from pathlib import Path

import pytest

from tests.docs.pages import DECISIONS, PATHS, TOP

PAGES = {
    str(path.relative_to(TOP)): path.read_text("utf-8")
    for path in [*PATHS, *DECISIONS, TOP / "CONTRIBUTING.md", TOP / "CHANGELOG.md"]
}
DOTTED = re.compile(r"\bcellwright(?:\.\w+)*\.(?:engine|kb|domains)(?:\.\w+)*")
BARE = re.compile(r"`(?:engine|kb)\.(?!py`)\w[\w.]*`")
PATH = re.compile(r"`((?:engine|kb|tests|docs|benchmarks)/[\w/.-]*\w)`")
BUILT = {"engine/kernels/shared"}  # written and compiled when the package is built


def is_defined(name: str, module: Path) -> bool:
    """Whether a module defines a name, imports it, or hands it on by name."""
    text = module.read_text("utf-8")
    defined = rf"(?:async )?(?:class|def) {name}\b|{name}\b *[:=]"
    return re.search(rf'^ *(?:{defined})|import.*\b{name}\b|^ *"?{name}"?,', text, re.M) is not None


def is_there(dotted: str) -> bool:
    """Whether a dotted name leads to a folder, a module, or a name inside one."""
    path, names = TOP, dotted.removeprefix("cellwright.").split(".")
    while names and (path / names[0]).is_dir():
        path /= names.pop(0)
    if names and (path / f"{names[0]}.py").is_file():
        module = path / f"{names.pop(0)}.py"
    else:
        module = path / "__init__.py"
    return not names or (module.is_file() and is_defined(names[0], module))


@pytest.mark.parametrize("page", PAGES)
def test_dotted_names_and_paths_are_there(page: str) -> None:
    dotted = set(DOTTED.findall(PAGES[page]))
    assert {name for name in dotted if not is_there(name)} == set()
    assert BARE.findall(PAGES[page]) == []
    paths = set(PATH.findall(PAGES[page])) - BUILT
    assert {path for path in paths if not (TOP / path).exists()} == set()


def test_a_name_that_is_not_there_is_noticed() -> None:
    assert is_there("cellwright.kb.terms")
    assert is_there("cellwright.engine.pipelines.planning.plan_gate")
    assert not is_there("cellwright.engine.pipelines.gate")
    assert not is_there("cellwright.kb.terms.Nothing")
