"""Strict YAML: a file becomes a tree of raw strings, sequences and mappings that know where they stand.

Scalars are never interpreted (`on`, `12:30` and `0755` stay what was written). Anchors, aliases, tags and several
documents are refused, depth and size are bounded, duplicate keys and comments that swallow ASP are reported.
"""

import bisect
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from kb.diagnostics import Diagnostic, InvalidInput, Source

MAX_DEPTH = 50
MAX_BYTES = 64 * 1024 * 1024
MAX_NODES = 2_000_000


@dataclass(frozen=True, slots=True)
class File:
    """The text of a file and its lines, for places inside it."""

    path: str
    text: str
    line_starts: tuple[int, ...]

    def at(self, index: int) -> Source:
        """The place of a character."""
        line = bisect.bisect_right(self.line_starts, index)
        start = self.line_starts[line - 1]
        end = self.text.find("\n", start)
        text = self.text[start:] if end < 0 else self.text[start:end]
        return Source(self.path, line, index - start + 1, text.rstrip("\r")[:400])


@dataclass(frozen=True, slots=True)
class Node:
    """A part of a YAML file: `value` is a string, a list of nodes, or a dict from string to (key node, node)."""

    value: Any
    file: File = field(repr=False)
    start: int
    end: int

    @property
    def where(self) -> Source:
        """The place of its first character."""
        return self.file.at(self.start)

    def place(self, offset: int) -> Source:
        """The place of character `offset` of a scalar's value: the same non-blank character, counted in the file.

        Exact for plain, quoted, folded and literal scalars; escapes inside double quotes shift it.
        """
        raw = self.file.text[self.start : self.end]
        skip = re.match(r"[|>][-+0-9]*[^\n]*\n|['\"]|", raw).end()  # type: ignore[union-attr]
        wanted = sum(not character.isspace() for character in self.value[:offset])
        for index in range(skip, len(raw)):
            if not raw[index].isspace():
                if wanted == 0:
                    return self.file.at(self.start + index)
                wanted -= 1
        return self.where

    def plain(self) -> Any:
        """Strings, lists and dicts alone; an empty scalar is None."""
        match self.value:
            case str():
                return self.value or None
            case list():
                return [item.plain() for item in self.value]
            case _:
                return {key: item.plain() for key, (_, item) in self.value.items()}

    def descend(self, path: tuple[str | int, ...]) -> "Node":
        """The node at `path`, or the deepest one on the way."""
        node = self
        for part in path:
            if isinstance(node.value, dict) and part in node.value:
                node = node.value[part][1]
            elif isinstance(node.value, list) and isinstance(part, int) and part < len(node.value):
                node = node.value[part]
            else:
                break
        return node


def read_file(path: Path, name: str | None = None) -> File:
    """The text of `path` as UTF-8. Raises `InvalidInput` when it cannot be read."""
    name = name or str(path)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InvalidInput([Diagnostic(Source(name), "K007", f"larger than {MAX_BYTES // 2**20} MiB")])
        data = path.read_bytes()
        text = data.decode("utf-8-sig")
    except OSError as error:
        raise InvalidInput([Diagnostic(Source(name), "K001", error.strerror or str(error))]) from None
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InvalidInput(
            [Diagnostic(Source(name, line), "K001", "not UTF-8", "save the file as UTF-8")]
        ) from None
    starts = (0, *(found.end() for found in re.finditer("\n", text)))
    return File(name, text, starts)


def read_tree(file: File) -> tuple[Node, list[Diagnostic]]:
    """The tree of a file and what is wrong with it. Raises `InvalidInput` when there is no tree at all."""
    found: list[Diagnostic] = []
    try:
        root = _Composer(file, found).compose()
    except yaml.YAMLError as error:
        raise InvalidInput([*found, _yaml_error(file, error)]) from None
    found.extend(_swallowed_comments(file))
    return root, found


class _Composer:
    """Builds the tree from parser events with a stack of its own, so depth is bounded by us and not by Python."""

    def __init__(self, file: File, found: list[Diagnostic]) -> None:
        self.file, self.found = file, found
        self.count = 0

    def compose(self) -> Node:
        stack: list[tuple[yaml.Event, list[Node]]] = []
        roots: list[Node] = []
        for event in self._events():
            children = stack[-1][1] if stack else roots
            match event:
                case yaml.ScalarEvent():
                    children.append(self._node(event.value, event, event))
                case yaml.SequenceStartEvent() | yaml.MappingStartEvent():
                    stack.append((event, []))
                    self._bound(event, len(stack))
                case yaml.SequenceEndEvent():
                    opened, items = stack.pop()
                    (stack[-1][1] if stack else roots).append(self._node(items, opened, event))
                case yaml.MappingEndEvent():
                    opened, items = stack.pop()
                    (stack[-1][1] if stack else roots).append(self._mapping(items, opened, event))
        if len(roots) != 1:
            what = "the file is empty" if not roots else "more than one document"
            raise InvalidInput([*self.found, Diagnostic(self.file.at(0), "K002", what)])
        return roots[0]

    def _events(self) -> Iterator[yaml.Event]:
        for event in yaml.parse(self.file.text, Loader=yaml.CSafeLoader):
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
                self._refuse(event, "anchors and aliases", "write the value out")
            elif (tag := getattr(event, "tag", None)) and tag != "!":
                self._refuse(event, f"the tag '{tag}'", "quote the value if it starts with '!'")
            if not isinstance(event, yaml.AliasEvent):
                yield event

    def _refuse(self, event: yaml.Event, what: str, hint: str) -> None:
        message = (
            f"{what} are not part of the language"
            if what.endswith("s")
            else f"{what} is not part of the language"
        )
        self.found.append(Diagnostic(self.file.at(_start(event)), "K004", message, hint))
        if len(self.found) > 100:
            raise InvalidInput(self.found)

    def _bound(self, event: yaml.Event, depth: int) -> None:
        if depth > MAX_DEPTH:
            where = self.file.at(_start(event))
            raise InvalidInput(
                [*self.found, Diagnostic(where, "K007", f"nested deeper than {MAX_DEPTH} levels")]
            )

    def _node(self, value: Any, opened: yaml.Event, closed: yaml.Event) -> Node:
        self.count += 1
        if self.count > MAX_NODES:
            raise InvalidInput([Diagnostic(self.file.at(_start(opened)), "K007", "too many values")])
        return Node(value, self.file, _start(opened), _end(closed))

    def _mapping(self, items: list[Node], opened: yaml.Event, closed: yaml.Event) -> Node:
        pairs: dict[str, tuple[Node, Node]] = {}
        for key, value in zip(items[::2], items[1::2], strict=False):
            if not isinstance(key.value, str):
                self.found.append(Diagnostic(key.where, "K005", "a key must be a plain string"))
            elif key.value in pairs:
                first = pairs[key.value][0].where
                self.found.append(
                    Diagnostic(key.where, "K003", f"key '{key.value}' stands already in line {first.line}")
                )
            else:
                pairs[key.value] = (key, value)
        return self._node(pairs, opened, closed)


def _start(event: yaml.Event) -> int:
    return event.start_mark.index if event.start_mark else 0


def _end(event: yaml.Event) -> int:
    return event.end_mark.index if event.end_mark else 0


_ASP_COMMENT = re.compile(r"\s(#(?:count|sum\+?|min|max|true|false)\b[^\n]*)")


def _swallowed_comments(file: File) -> Iterator[Diagnostic]:
    for number, start in enumerate(file.line_starts, 1):
        end = file.line_starts[number] if number < len(file.line_starts) else len(file.text)
        line = file.text[start:end]
        found = _ASP_COMMENT.search(line)
        if (
            found
            and ":" in line[: found.start()]
            and '"' not in line
            and "'" not in line
            and not line.lstrip().startswith("#")
        ):
            yield Diagnostic(
                file.at(start + found.start(1)),
                "K006",
                "YAML reads this as a comment",
                "put the whole value in quotes",
            )


def _yaml_error(file: File, error: yaml.YAMLError) -> Diagnostic:
    mark = getattr(error, "problem_mark", None)
    where = file.at(mark.index) if mark else Source(file.path)
    problem = getattr(error, "problem", None) or str(error)
    hint = (
        "a value with ': ' or starting with '!', '%', '{' or '[' needs quotes"
        if "mapping values" in problem
        else ""
    )
    return Diagnostic(where, "K002", problem, hint)
