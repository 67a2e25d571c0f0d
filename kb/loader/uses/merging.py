"""Several trees as one: mappings are joined key by key, lists one after another, and what is said twice is said once."""

from collections.abc import Sequence
from typing import Any

from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.loader.node import Node

ALL = ("include",)  # lists of names that mean different things in different files


def merged(parts: Sequence[Node], own: Node) -> Node:
    """The mappings as one, which takes its place from `own`. Raises `InvalidInput` where two parts contradict each other."""
    wrong: list[Diagnostic] = []
    whole: dict[str, tuple[Node, Node]] = {}
    for part in parts:
        if isinstance(part.value, dict):
            for key, entry in part.value.items():
                whole[key] = _joined(whole[key], entry, wrong, ()) if key in whole else _copied(entry)
    if wrong:
        raise InvalidInput(wrong)
    return own._replace(value=whole)


Entry = tuple[Node, Node]


def _copied(entry: Entry) -> Entry:
    """An entry whose mapping may be changed: trees of files are remembered, and never changed."""
    key, node = entry
    return key, node._replace(value=dict(node.value)) if isinstance(node.value, dict) else node


def _joined(old: Entry, new: Entry, wrong: list[Diagnostic], above: tuple[str, ...]) -> Entry:
    """Two entries with the same key, below the keys `above`. What says nothing gives way."""
    (key, first), (new_key, second) = old, new
    path = (*above, str(key.value))
    match first.value, second.value:
        case dict(), dict():
            whole: dict[str, Any] = dict(first.value)
            for name, entry in second.value.items():
                whole[name] = _joined(whole[name], entry, wrong, path) if name in whole else entry
            return new_key, second._replace(value=whole)
        case list(), list():
            return new_key, second._replace(value=_listed(first.value, second.value, str(key.value)))
        case _, "":
            return old
        case "", _:
            return new
    if first.plain() != second.plain():
        place = f"{first.where.path}:{first.where.line}"
        said = f"'{key.value}' is said otherwise in {place}"
        wrong.append(Diagnostic(new_key.where, "K104", said, _remedy(path, new_key)))
    return new


def _remedy(path: tuple[str, ...], key: Node) -> str:
    """What to try where two parts contradict each other: an operator of a device can be replaced by one of the domain."""
    if path[0] == "operators" and key.file.user() is None:
        name = path[1].partition("(")[0]
        return f"give it another name, or have it replace that of the device: `without: [{name}]`"
    return "say it in one place, or give one of them another name"


def _listed(first: list[Node], second: list[Node], key: str) -> list[Node]:
    if key in ALL:
        return [*first, *second]
    said = {str(each.plain()) for each in first}
    return [*first, *(each for each in second if str(each.plain()) not in said)]
