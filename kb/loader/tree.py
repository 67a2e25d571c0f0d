"""Strict YAML: the tree of a file, made of raw strings, sequences and mappings that know their places.

Scalars are never interpreted: `on`, `12:30` and `0755` stay as they are written. Anchors, aliases, tags and several
documents are refused. Depth and size are limited. Duplicate keys, and comments that swallow ASP, are reported.
"""

import functools
import re
from collections.abc import Iterator
from typing import Any

import yaml

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, read_file, unprintable
from cellwright.kb.loader.json_tree import json_tree
from cellwright.kb.loader.node import MAX_DEPTH, MAX_NODES, Node, too_many

__all__ = ["File", "Node", "read_file", "read_tree"]

SHORT = 2**16  # characters
MAX_FOUND = 100  # a file with more YAML errors than this is not read further


def read_tree(file: File, most: int = MAX_NODES) -> tuple[Node, list[Diagnostic]]:
    """The tree of a file with at most so many values, and its errors. Raises `InvalidInput` if there is no tree.

    The trees of the last short files are remembered: the domain is read anew with each of its problems.
    """
    root, found = (_remembered if len(file.text) <= SHORT else _read)(file, most)
    return root, [*found]


def _read(file: File, most: int) -> tuple[Node, list[Diagnostic]]:
    if (quick := json_tree(file, most)) is not None:
        return quick, []
    found: list[Diagnostic] = []
    try:
        root = Composer(file, found, most).compose()
    except yaml.YAMLError as error:
        raise InvalidInput([*found, _yaml_error(file, error)]) from None
    return root, found


_remembered = functools.lru_cache(64)(_read)


def outlined(text: str) -> Iterator[str | None]:
    """The scalars of a YAML text in order, and None where a mapping or list begins or ends. Raises `InvalidInput`.

    It takes a third of the time of a tree.
    """
    try:
        for event in yaml.parse(text, Loader=yaml.CSafeLoader):
            if isinstance(event, yaml.ScalarEvent):
                yield event.value
            elif isinstance(event, yaml.CollectionStartEvent | yaml.CollectionEndEvent):
                yield None
    except yaml.YAMLError as error:
        raise InvalidInput([_yaml_error(File.of("", text), error)]) from None


class Composer:
    """Builds the tree from parser events. An explicit stack limits the depth, instead of Python's recursion limit."""

    def __init__(self, file: File, found: list[Diagnostic], most: int) -> None:
        self.file, self.found, self.most = file, found, most
        self.count = 0

    def compose(self) -> Node:
        stack: list[tuple[yaml.Event, list[Node]]] = []
        roots: list[Node] = []
        for event in self._events():
            children = stack[-1][1] if stack else roots
            match event:
                case yaml.ScalarEvent():
                    children.append(self._scalar(event))
                case yaml.SequenceStartEvent() | yaml.MappingStartEvent():
                    stack.append((event, []))
                    self._bound(event, len(stack))
                case yaml.SequenceEndEvent():
                    opened, items = stack.pop()
                    (stack[-1][1] if stack else roots).append(self._node(items, opened, event))
                case yaml.MappingEndEvent():
                    opened, items = stack.pop()
                    (stack[-1][1] if stack else roots).append(self._mapping(items, opened, event))
        if len(roots) == 1:
            return roots[0]
        if roots:
            found = Diagnostic(roots[1].where, "K002", "a second document", "keep one, without `---` between")
        else:
            hint = "give another one" if _is_json(self.file) else "it needs `domain:` or `problem:`"
            found = Diagnostic(Source(self.file.path), "K002", "the file is empty", hint)
        raise InvalidInput([*self.found, found])

    def _events(self) -> Iterator[yaml.Event]:
        for event in yaml.parse(self.file.text, Loader=yaml.CSafeLoader):
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
                self._refuse(event, "anchors and aliases are", "write the value out")
            elif (tag := getattr(event, "tag", None)) and tag != "!":
                self._refuse(event, f"the tag '{tag}' is", "quote the value if it starts with '!'")
            if not isinstance(event, yaml.AliasEvent):
                yield event

    def _refuse(self, event: yaml.Event, what: str, hint: str) -> None:
        where = self.file.at(_start(event))
        self._note(Diagnostic(where, "K004", f"{what} not part of the language", hint))

    def _note(self, diagnostic: Diagnostic) -> None:
        self.found.append(diagnostic)
        if len(self.found) > MAX_FOUND:
            raise InvalidInput(self.found)

    def _bound(self, event: yaml.Event, depth: int) -> None:
        if depth > MAX_DEPTH:
            where = self.file.at(_start(event))
            found = Diagnostic(
                where, "K007", f"nested deeper than {MAX_DEPTH} levels", "no file needs so many"
            )
            raise InvalidInput([*self.found, found])

    def _scalar(self, event: yaml.ScalarEvent) -> Node:
        start, end = _start(event), _end(event)
        if found := unprintable(event.value):
            message = f"an escape makes the control character U+{ord(found[0]):04X}"
            self._note(Diagnostic(self.file.at(start), "K004", message, "remove it"))
        elif (start == end or self.file.text[start] not in "'\"|>") and (
            comment := _ASP_COMMENT.match(self.file.text, end)
        ):
            hint = "put the whole value in quotes"
            where = self.file.at(comment.start(1))
            self._note(
                Diagnostic(where, "K006", f"YAML takes '{comment[1]}' for the start of a comment", hint)
            )
            return self._node("", event, event)  # the rest of the value would only be misread
        return self._node(event.value, event, event)

    def _node(self, value: Any, opened: yaml.Event, closed: yaml.Event) -> Node:
        self.count += 1
        if self.count > self.most:
            raise too_many(self.file, _start(opened), self.most)
        return Node(value, self.file, _start(opened), _end(closed))

    def _mapping(self, items: list[Node], opened: yaml.Event, closed: yaml.Event) -> Node:
        pairs: dict[str, tuple[Node, Node]] = {}
        for key, value in zip(items[::2], items[1::2], strict=False):
            if not isinstance(key.value, str):
                hint = "quote it if it starts with '[' or '{'"
                self._note(Diagnostic(key.where, "K005", "a key must be a plain string", hint))
            elif key.value in pairs:
                first = pairs[key.value][0].where
                message = f"the key '{key.value[:60]}' is already used in line {first.line}"
                self._note(
                    Diagnostic(key.where, "K003", message, "remove one, or put both values under one key")
                )
            else:
                pairs[key.value] = (key, value)
        return self._node(pairs, opened, closed)


def _start(event: yaml.Event) -> int:
    return event.start_mark.index if event.start_mark else 0


def _end(event: yaml.Event) -> int:
    return event.end_mark.index if event.end_mark else 0


_ASP_COMMENT = re.compile(r"[ \t]+(#(?:count|sum\+?|min|max|true|false|inf|sup)\b)")


def _yaml_error(file: File, error: yaml.YAMLError) -> Diagnostic:
    mark = getattr(error, "problem_mark", None)
    where = file.at(mark.index) if mark else Source(file.path)
    problem = getattr(error, "problem", None) or str(error)
    hint = next((hint for part, hint in _YAML_HINTS.items() if part in problem), "")
    return Diagnostic(where, "K002", f"not {'JSON' if _is_json(file) else 'YAML'}: {problem}", hint)


def _is_json(file: File) -> bool:
    """Whether a program wrote the file. JSON is read as YAML, of which it is a part."""
    return file.path.endswith(".json")


_INDENT = "indent it like its neighbours, and look for an open quote or bracket in an earlier line"
_YAML_HINTS = {
    "mapping values": "a value with ': ' or starting with '!', '%', '{' or '[' needs quotes",
    "cannot start any token": "indent with spaces, not tabs; a value starting with '%', '@' or '`' needs quotes",
    "expected ':'": "a key needs ': ' after it",
    "expected ','": "close the bracket, or put the whole value in quotes",
    "expected key": _INDENT,
    "expected <block end>": _INDENT,
    "expected '-' indicator": _INDENT,
    "unexpected end of stream": "close the quote",
    "unexpected document indicator": "close the quote",
    "undefined tag handle": "quote the value if it starts with '!'",
    "unknown escape": "use single quotes, which have no escapes",
}
