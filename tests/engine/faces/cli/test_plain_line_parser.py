"""A plain command line is read as typer reads it, or left to typer."""

import random
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any

import pytest
import typer.testing

from cellwright.engine.faces.cli import verb_table
from cellwright.engine.faces.cli.plain_line_parser import _Place, _Unusual, plain_call, read
from cellwright.engine.faces.cli.typer_application import app
from cellwright.engine.faces.cli.verb_table import VERBS, is_group, load_verb, verb_parameters

ALONE = [name for name in VERBS if not is_group(name)]
WORDS = (
    "",
    "x",
    "themse/one",
    "-",
    "--",
    "-1",
    "0",
    "007",
    "3",
    "90",
    "1e3",
    "nan",
    "2.5",
    "1_0",
    " 4",
    "٣",
    "é",
    "a=b",
)
MISTAKES = (
    "--help",
    "-h",
    "--nonsense",
    "--form",
    "-otto.svg",
    "--format=json",
    "--no-pddl",
    "--seed=3",
    "--install-completion",
)


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> Callable[[str, list[str]], dict[str, Any] | None]:
    """What typer takes from a command line; None if it refuses it or prints help."""
    calls: list[dict[str, Any]] = []
    monkeypatch.setattr(
        verb_table, "run_limited", lambda _verb, _name, options: calls.append(dict(options))
    )

    def read_by_typer(name: str, words: list[str]) -> dict[str, Any] | None:
        calls.clear()
        typer.testing.CliRunner().invoke(app, [name, *words])
        return calls[0] if calls else None

    return read_by_typer


@pytest.mark.parametrize("name", ALONE)
def test_a_line_that_is_read_without_typer_is_read_as_typer_reads_it(
    name: str,
    taken: Callable[[str, list[str]], dict[str, Any] | None],
    tmp_path: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x").write_text("")
    chosen, wanted = random.Random(f"lines of {name}"), verb_parameters(load_verb(name))
    plain = 0
    for _ in range(60):
        words = _line(chosen, wanted)
        try:
            found = read(wanted, words)
        except (_Unusual, typer.BadParameter):
            continue
        plain += 1
        assert repr(found) == repr(_in_order(taken(name, words), found)), words
    assert plain > 2


def _in_order(options: dict[str, Any] | None, like: Mapping[str, Any]) -> dict[str, Any] | None:
    return None if options is None else {name: options[name] for name in like if name in options}


def _line(chosen: random.Random, wanted: Mapping[str, Any]) -> list[str]:
    """A command line that is right more often than not."""
    parts: list[list[str]] = []
    for place in map(_Place, wanted.values()):
        if place.declared.kind == "Argument":
            if place.required or chosen.random() < 0.4:
                parts += [
                    [_text(chosen, place)]
                    for _ in range(chosen.choice((1, 2)) if place.many else 1)
                ]
        elif (place.required or chosen.random() < 0.15) and (names := list(place.names())):
            given = [] if place.is_switch() else [_text(chosen, place)]
            parts += [[chosen.choice(names), *given]] * (chosen.choice((1, 2)) if place.many else 1)
    if chosen.random() < 0.1:
        parts.append([chosen.choice((*MISTAKES, *WORDS))])
    chosen.shuffle(parts)
    return [word for part in parts for word in part]


def _text(chosen: random.Random, place: _Place) -> str:
    if chosen.random() < (0.3 if place.kind in (int, float) else 0.1):
        return chosen.choice(WORDS)
    if isinstance(place.kind, type) and issubclass(place.kind, Enum):
        return str(chosen.choice(list(place.kind)).value)
    if place.kind in (int, float):
        low, high = place.declared.settings.get("min", 0), place.declared.settings.get("max", 99)
        return str(
            chosen.choice(
                (low, high, (low + high) // 2, (low + high) / 2 if place.kind is float else high)
            )
        )
    return chosen.choice(("x", "themse/one", "stored(1)", "a b"))


@pytest.mark.parametrize(
    "line",
    [
        "",
        "--version",
        "plan",
        "plan --help",
        "plan a --seed -1",
        "plan a --time-limit nan",
        "plan a --see 3",
        "store check",
        "help plan",
        "pan a",
    ],
)
def test_what_is_not_plain_is_left_to_typer(line: str) -> None:
    assert plain_call(line.split()) is None


def test_an_option_that_the_environment_sets_is_left_to_typer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert plain_call(["plan", "themse/one"]) is not None
    monkeypatch.setenv("CELLWRIGHT_STORE", "library.db")
    assert plain_call(["plan", "themse/one"]) is None
    assert plain_call(["plan", "themse/one", "--store", "other.db"]) is not None
