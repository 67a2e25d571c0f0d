"""What `cellwright` promises: its names and parameters, that the page tells all of them, and
that nothing is loaded too early.
"""

import inspect
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import cellwright
from cellwright.engine.faces.cli.verb_table import VERBS
from tests.places import TOP

PAGE = (TOP / "docs" / "api.md").read_text("utf-8")
ROWS = re.findall(
    r"^\| (`[^|]+) \| (`[^|]+|programs[^|]+) \|$",
    PAGE[PAGE.index("| command | function |") :],
    re.M,
)
FUNCTIONS = {name for name in cellwright.__all__ if inspect.isfunction(getattr(cellwright, name))}


def signature(name: str) -> str:
    """A name with its parameters and defaults; of an answer what it has; of a value of the
    model only the name.
    """
    found = getattr(cellwright, name)
    if inspect.isfunction(found):
        return f"{name}({', '.join(map(_parameter, inspect.signature(found).parameters.values()))})"
    if isinstance(found, type) and issubclass(found, cellwright.Answer):
        return f"{name}: {', '.join(sorted(each for each in public(found)))}"
    return name


def _parameter(each: inspect.Parameter) -> str:
    named = "*" if each.kind is each.KEYWORD_ONLY else ""
    return f"{named}{each.name}" + ("" if each.default is each.empty else f"={each.default!r}")


def public(found: type) -> set[str]:
    """The attributes and methods of a class."""
    return {
        each
        for each in {*dir(found), *getattr(found, "__dataclass_fields__", ())}
        if each[0] != "_"
    }


def test_names_and_parameters_are_those_that_were_accepted(
    golden: Callable[[str, str], None],
) -> None:
    golden("library.txt", "\n".join(map(signature, sorted(cellwright.__all__))) + "\n")


def test_every_function_stands_on_the_page() -> None:
    assert {name for name in FUNCTIONS if not re.search(rf"\b{name}\b", PAGE)} == set()


def test_every_verb_has_its_functions_on_the_page() -> None:
    told = {each for verbs, _ in ROWS for each in re.findall(r"`([^`]+)`", verbs)}
    assert {each.split()[0] for each in told if each.split()[0] in VERBS} == set(VERBS)


def test_the_functions_on_the_page_are_there() -> None:
    named = {each for _, functions in ROWS for each in re.findall(r"`(\w+)`", functions)}
    assert named
    assert named <= FUNCTIONS


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_every_function_says_what_it_does(name: str) -> None:
    assert (inspect.getdoc(getattr(cellwright, name)) or "").endswith((".", ":"))


def fresh(tmp_path: Path, code: str) -> str:
    """What a fresh interpreter prints, in a folder of its own."""
    ran = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(TOP)!r})\n{code}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def test_the_import_loads_nothing_of_ours_and_a_plan_loads_no_array_library(tmp_path: Path) -> None:
    code = """
import cellwright
print([name for name in sys.modules if name.startswith(("cellwright.kb", "cellwright.engine", "rich", "pydantic"))])
answer = cellwright.plan("bulkhead/one_point", objective="cost", order="free")
print(answer.status, [name for name in ("numpy", "ortools", "typer") if name in sys.modules])
"""
    assert fresh(tmp_path, code).splitlines() == ["[]", "optimal []"]


def test_a_name_that_is_not_there_is_told_as_python_does() -> None:
    with pytest.raises(AttributeError, match="no attribute 'planner'"):
        cellwright.planner  # noqa: B018
    assert set(cellwright.__all__) <= set(dir(cellwright))
