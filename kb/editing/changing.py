"""Changes of names: where to write a new name, and whether it may be one."""

import re
from collections.abc import Iterator
from typing import NamedTuple

from cellwright.kb.editing.devices import DeviceIndex
from cellwright.kb.editing.index import FileIndex, Index, Symbol
from cellwright.kb.editing.occurrences import Occurrence
from cellwright.kb.model.domain import BUILT_IN_TYPES

RENAMED = ("predicate", "type", "function", "object", "operator", "variable", "cause")
_NAME, _VARIABLE = r"[a-z][A-Za-z0-9_]*", r"_?[A-Z][A-Za-z0-9_]*"


class Change(NamedTuple):
    """A text in place of the characters from `start` to `end` of a file."""

    path: str
    start: int
    end: int
    text: str


class NotRenamed(Exception):
    """Why a name is not changed, in one sentence."""


def renaming(index: Index, file: FileIndex, offset: int) -> tuple[Symbol, Occurrence]:
    """What would be renamed at a place. Raises `NotRenamed`."""
    found = index.symbol(file, offset)
    if found is None or found[0].space not in RENAMED or found[1].name == "_":
        raise NotRenamed("there is no name to change here")
    symbol, place = found
    if symbol.name in BUILT_IN_TYPES and symbol.space == "type":
        raise NotRenamed(f"'{symbol.name}' is built in")
    if symbol.space != "variable" and not index.definitions(symbol):
        raise NotRenamed(f"'{symbol.name}' is declared nowhere in the files of this domain")
    for home, _ in index.uses(symbol) if symbol.space != "variable" else ():
        if isinstance(home, DeviceIndex):
            hint = f"`cellwright devices show {home.device}` lists what a use can call otherwise"
            raise NotRenamed(f"'{symbol.name}' is a name in the device '{home.device}': {hint}")
    if any(each.ranged for _, each in index.uses(symbol)):
        raise NotRenamed(f"'{symbol.name}' is written as part of a range: list the names of the range first")
    return symbol, place


def renamed(index: Index, file: FileIndex, offset: int, name: str) -> Iterator[Change]:
    """The changes that give a name its new form everywhere. Raises `NotRenamed`."""
    symbol, _ = renaming(index, file, offset)
    _refuse(index, file, symbol, name)
    places = {(found.path, each.start, each.end) for found, each in index.uses(symbol)}
    yield from (Change(*place, name) for place in sorted(places))


def _refuse(index: Index, file: FileIndex, symbol: Symbol, name: str) -> None:
    """Raise `NotRenamed` if this cannot be the name."""
    pattern = _VARIABLE if symbol.space == "variable" else _NAME
    if re.fullmatch(pattern, name) is None or name == "not":
        kind = "capital" if symbol.space == "variable" else "small"
        raise NotRenamed(f"'{name}' is no name here: write a {kind} letter, then letters, digits and _")
    if symbol.space == "variable":
        if any(True for _ in index.uses(Symbol("variable", name, file.path, symbol.piece, symbol.scope))):
            raise NotRenamed(f"there is a variable {name} here already")
        return
    taken = _CLASHES.get(symbol.space, (symbol.space,))
    for space in taken:
        if name != symbol.name and (found := index.declarations.get((space, name))):
            raise NotRenamed(f"'{name}' is declared already, as {found[0][1].kind}")
    if symbol.space in ("predicate", "type") and name in BUILT_IN_TYPES:
        raise NotRenamed(f"'{name}' is built in")
    if symbol.space == "predicate" and any(True for _ in index.uses(Symbol("predicate", name))):
        raise NotRenamed(f"rules use the name '{name}' already")


_CLASHES = {
    "predicate": ("predicate", "type"),
    "type": ("type", "predicate"),
    "object": ("object", "function"),
    "function": ("function", "object"),
}
