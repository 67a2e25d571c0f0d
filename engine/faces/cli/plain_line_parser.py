"""Fast parser of plain command lines, read without typer: a verb, then correct arguments.

Whatever is not plain (help, a mistake, a shortened option, a value out of its range, a group of
verbs) is left to typer, which reads it from the start. So nothing here refuses anything: a line is
read as typer would read it, or not at all.
"""

import os
import re
from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from inspect import Parameter
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin

from cellwright.engine.faces.cli.option_declarations import declaration_of
from cellwright.engine.faces.cli.verb_table import (
    VERBS,
    is_group,
    load_verb,
    run_limited,
    verb_parameters,
)

WHOLE = re.compile(r"[0-9]{1,15}")
DECIMAL = re.compile(r"[0-9]{1,15}(\.[0-9]{1,15})?")
SHOWN = {
    "help",
    "metavar",
    "hidden",
    "show_default",
    "rich_help_panel",
    "autocompletion",
    "envvar",
    "callback",
}
RANGE = {"min", "max"}


class _Unusual(Exception):
    """This is no plain line."""


class _Place:
    """An argument or option of a verb: where its values go, and of what type they are."""

    def __init__(self, parameter: Parameter) -> None:
        found = declaration_of(parameter.annotation)
        if found is None:
            raise _Unusual
        self.name, self.declared = parameter.name, found
        self.required = parameter.default is Parameter.empty
        self.default = parameter.default
        kind = parameter.annotation.__origin__
        if isinstance(kind, UnionType):
            kind = next(each for each in get_args(kind) if each is not type(None))
        self.many = get_origin(kind) is list
        self.kind = get_args(kind)[0] if self.many else kind

    def names(self) -> Iterable[str]:
        """The names of an option. One of two opposite switches has no plain name."""
        names = self.declared.names
        if self.is_switch() and not names:
            return ()
        return names or ("--" + self.name.replace("_", "-"),)

    def is_switch(self) -> bool:
        return self.kind is bool

    def value(self, text: str) -> Any:
        """A value from its text. Raises `_Unusual` where typer might refuse it."""
        found = _converted(text, self.kind)
        settings = self.declared.settings
        if settings.keys() - SHOWN - RANGE or not _within(
            found, settings.get("min"), settings.get("max")
        ):
            raise _Unusual
        callback = settings.get("callback")
        return callback(found) if callback else found


def plain_call(words: list[str]) -> Callable[[], None] | None:
    """What a plain command line asks for, to be called; None if the line is not plain."""
    if (
        not words
        or is_group_or_none(words[0])
        or any(name.endswith("_COMPLETE") for name in os.environ)
    ):
        return None
    called = load_verb(words[0])
    try:
        options = read(verb_parameters(called), words[1:])
    except _Unusual:
        return None
    return lambda: run_limited(called, words[0], options)


def is_group_or_none(word: str) -> bool:
    return word not in VERBS or is_group(word)


def read(taken: Mapping[str, Parameter], words: list[str]) -> dict[str, Any]:
    """What is given for each parameter, and what the others are by default. Raises `_Unusual`."""
    places = [_Place(each) for each in taken.values()]
    options = {
        name: each for each in places if each.declared.kind == "Option" for name in each.names()
    }
    given: dict[str, Any] = {}
    bare: list[str] = []
    rest = iter(words)
    for word in rest:
        if not word.startswith("-"):
            bare.append(word)
        elif (place := options.get(word)) is None or (place.name in given and not place.many):
            raise _Unusual
        elif place.is_switch():
            given[place.name] = True
        else:
            _give(given, place, next(rest, "-"))
    _arrange(given, [each for each in places if each.declared.kind == "Argument"], bare)
    return {
        each.name: given[each.name] if each.name in given else _default(each) for each in places
    }


def _arrange(given: dict[str, Any], arguments: list[_Place], bare: list[str]) -> None:
    """Give each argument the word at its place; the last one takes all that are left, if it
    takes many.
    """
    for place in arguments:
        if place.many and place is not arguments[-1]:
            raise _Unusual
        for _ in range(len(bare) if place.many else 1):
            if bare:
                _give(given, place, bare.pop(0))
    if bare:
        raise _Unusual


def _give(given: dict[str, Any], place: _Place, text: str) -> None:
    if text.startswith("-"):
        raise _Unusual
    value = place.value(text)
    given[place.name] = [*given.get(place.name, ()), value] if place.many else value


def _default(place: _Place) -> Any:
    settings: dict[str, Any] = place.declared.settings
    if place.required or os.environ.get(settings.get("envvar", "")) is not None:
        raise _Unusual
    return place.default


def _converted(text: str, kind: Any) -> Any:
    """A text as a value of a type."""
    if kind is str:
        return text
    if kind is Path and not (os.path.exists(text) and not os.access(text, os.R_OK)):
        return Path(text)
    if kind is int and WHOLE.fullmatch(text):
        return int(text)
    if kind is float and DECIMAL.fullmatch(text):
        return float(text)
    if isinstance(kind, type) and issubclass(kind, Enum) and text in kind._value2member_map_:
        return kind(text)
    raise _Unusual


def _within(value: Any, least: Any, most: Any) -> bool:
    return (least is None or value >= least) and (most is None or value <= most)
