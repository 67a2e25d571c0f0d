"""Dataclasses and expressions are the same, whether they were compiled now or by an earlier run."""

import dataclasses
import marshal
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from cellwright.engine.faces.cli.bytecode_cache import KeptCode, keep_patterns

SETTINGS = [
    {"frozen": True, "slots": True},
    {"order": True, "unsafe_hash": True},
    {"eq": False, "kw_only": True, "repr": False},
]


def made(settings: dict[str, bool]) -> type[Any]:
    fields = [
        ("a", int),
        ("b", list[int], dataclasses.field(default_factory=list)),
        ("c", int, dataclasses.field(default=3, compare=False)),
    ]
    return dataclasses.make_dataclass("Made", fields, **settings)


def behaviour(kind: type[Any]) -> list[object]:
    """What an object of such a class says and does."""
    one, other = kind(a=1, c=5), kind(a=1)
    found: list[object] = [one == other, one != kind(a=2), dataclasses.asdict(one)]
    found += [dataclasses.asdict(dataclasses.replace(one, a=4)), kind.__match_args__]
    for ask in (hash, repr, lambda each: each < other, lambda each: setattr(each, "a", 9)):
        try:
            found.append(
                str(ask(one)).partition(" object at")[0]
                if ask is not hash
                else bool(ask(one)) or True
            )
        except Exception as error:
            found.append((type(error).__name__, str(error)))
    return found


@pytest.mark.parametrize("settings", SETTINGS)
def test_classes_with_kept_methods_behave_as_those_of_the_standard_library(
    tmp_path: Path, settings: dict[str, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    expected = behaviour(made(settings))
    for run in ("compiles", "finds"):
        methods = KeptCode(tmp_path / "folder" / "methods")
        monkeypatch.setitem(vars(dataclasses), "exec", methods.run)
        if run == "finds":
            # would fail
            monkeypatch.setitem(vars(sys.modules[KeptCode.__module__]), "compile", None)
        assert behaviour(made(settings)) == expected
        methods.keep()
    assert [each.name for each in (tmp_path / "folder").iterdir()] == ["methods"]


@pytest.mark.parametrize(
    "content", [b"", b"no marshal", marshal.dumps(3), marshal.dumps(("another", {"": 1}))]
)
def test_a_damaged_file_or_one_of_another_python_counts_for_nothing(
    tmp_path: Path, content: bytes
) -> None:
    file = tmp_path / "methods"
    file.write_bytes(content)
    space: dict[str, int] = {}
    KeptCode(file).run("a = 3", {}, space)
    assert space == {"a": 3}


def test_nothing_is_written_where_python_writes_no_bytecode_or_cannot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    for file, refused in ((tmp_path / "methods", True), (tmp_path / "file" / "methods", False)):
        monkeypatch.setattr(sys, "dont_write_bytecode", refused)
        methods = KeptCode(file)
        methods.run("a = 3", {})
        methods.keep()
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


EXPRESSIONS = [
    ("(?P<one>a+)|(b)(?P<two>[^x-z])*", 0),
    ("^é.$", re.IGNORECASE | re.MULTILINE),
    (rb"(\d+)(?:\1)?", re.ASCII),
]


@pytest.fixture
def compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Puts the compiler of expressions back at the end. What was compiled may be kept."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    for name in ("_sre", "compile"):
        monkeypatch.setattr(vars(re)["_compiler"], name, getattr(vars(re)["_compiler"], name))


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize(("expression", "flags"), EXPRESSIONS)
def test_kept_expressions_match_as_those_of_the_standard_library(
    tmp_path: Path, expression: str | bytes, flags: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    re.purge()
    expected = told(re.compile(expression, flags))
    for run in ("compiles", "finds"):
        code = KeptCode(tmp_path / "kept")
        keep_patterns(code)
        if run == "finds":
            monkeypatch.setattr(vars(re)["_compiler"], "_code", None)  # would fail
        re.purge()
        space = {"re": re, "expression": expression, "flags": flags}
        exec("found = re.compile(expression, flags)", space)  # as a module does
        assert told(space["found"]) == expected
        code.keep()


def told(made: Any) -> list[object]:
    """What an expression finds, and what it says of itself."""
    texts: list[Any] = ["aab", "bq", "Éa\nxéb", "1212 77 3"]
    if isinstance(made.pattern, bytes):
        texts = [each.encode() for each in texts]
    found = [
        [(each.span(), each.groups(), each.groupdict()) for each in made.finditer(text)]
        for text in texts
    ]
    return [
        found,
        made.flags,
        made.groups,
        dict(made.groupindex),
        repr(made),
        hash(made) == hash(made),
    ]


@pytest.mark.usefixtures("compiler")
def test_expressions_of_functions_are_not_kept(tmp_path: Path) -> None:
    code = KeptCode(tmp_path / "kept")
    keep_patterns(code)
    re.purge()
    assert re.compile("something(?= odd)")
    code.keep()
    assert not code.file.exists()
