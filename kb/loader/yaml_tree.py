"""Strict YAML and JSON as a tree of strings, lists and mappings that know their places."""

import functools
import json
import re
from bisect import bisect_left
from collections.abc import Iterator
from typing import Any, NamedTuple

import yaml

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, find_unprintable, read_file
from cellwright.kb.loader.missing_colons import lacking_colon

MAX_YAML_DEPTH = 50
MAX_NODES = 1_000_000


class YamlNode(NamedTuple):
    """A part of a YAML file: `value` is a string, a list of nodes, or a dict from string to
    (key node, node).
    """

    value: Any
    file: File
    start: int
    end: int

    @property
    def where(self) -> Source:
        """The place of its first character."""
        return self.file.at(self.start)

    def place(self, offset: int) -> Source:
        """The place of character `offset` of a scalar's value."""
        return self.file.at(self.offset_of(offset))

    def offset_of(self, offset: int) -> int:
        """Where character `offset` of a scalar's value stands in the file, found by counting
        non-blank characters.

        It is exact for plain, quoted, folded and literal scalars; escapes inside double quotes
        shift it.
        """
        raw = self.file.text[self.start : self.end]
        if raw == self.value:
            return min(self.start + offset, max(self.start, self.end - 1))
        visible = _visible_places(raw)
        count = len("".join(self.value[:offset].split()))
        if count >= len(visible):
            return max(self.start, self.end - 1) if offset and visible else self.start
        return self.start + visible[count]

    def plain(self) -> Any:
        """The content as strings, lists and dicts; an empty scalar is None."""
        match self.value:
            case str():
                return self.value or None
            case list():
                return [item.plain() for item in self.value]
            case _:
                return {key: item.plain() for key, (_, item) in self.value.items()}

    def descend(self, path: tuple[str | int, ...]) -> "YamlNode":
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


@functools.lru_cache(maxsize=4)
def _visible_places(raw: str) -> list[int]:
    """The places of the non-blank characters in a scalar's source, after its quote or block
    indicator.
    """
    opening = re.match(r"[|>][-+0-9]*[^\n]*\n|['\"]|", raw)
    skip = opening.end() if opening else 0
    places = [match.start() for match in re.finditer(r"\S", raw)]
    return places[bisect_left(places, skip) :]


def child_at(node: YamlNode | None, key: str) -> YamlNode | None:
    """The value under `key` of a mapping, or None."""
    if node is None or not isinstance(node.value, dict) or key not in node.value:
        return None
    value: YamlNode = node.value[key][1]
    return value if value.value != "" else None


def required_child(node: YamlNode, key: str) -> YamlNode:
    """The value under a key that the checked form of the file guarantees."""
    value: YamlNode = node.value[key][1]
    return value


def mapping_members(node: YamlNode | None) -> Iterator[tuple[str, YamlNode, YamlNode]]:
    """The (key, key node, value node) of a mapping; empty if there is no node."""
    if node is not None and isinstance(node.value, dict):
        for key, (key_node, value) in node.value.items():
            yield key, key_node, value


def too_many_values(file: File, offset: int, most: int) -> InvalidInput:
    """The error of a file with more than `most` values; the first too many begins at `offset`."""
    return InvalidInput(
        [Diagnostic(file.at(offset), "K007", f"more than {most} values in one file")]
    )


LONGEST_KEY = 500  # characters; YAML takes about a thousand

_JSON_PART = re.compile(
    r'[ \n]*(?:("[^"\\]*(?:\\["\\/][^"\\]*)*")|(-?[0-9][-+.0-9eE]*|true|false|null)|([{[])|([]}]))(?:,(?=[ \n])|: )?'
)
QUOTED, OPENING, CLOSING = 1, 3, 4  # groups of the pattern; 1 and 2 are single values
_ESCAPED = re.compile(r"\\(.)")


def json_tree(file: File, most: int) -> YamlNode | None:
    """The tree of a file; None if it is not plainly JSON.

    Raises `InvalidInput` for more than `most` values.
    """
    if not file.text.startswith("{") or not _is_json_text(file.text):
        return None
    return _build_json_tree(file, most)


def _is_json_text(text: str) -> bool:
    try:
        json.loads(text, object_pairs_hook=_forget_pairs)
    except (ValueError, RecursionError):
        return False
    return True


def _forget_pairs(_pairs: object) -> None:
    """Nothing: only the form of the text is asked for."""


def _build_json_tree(file: File, most: int) -> YamlNode | None:
    """The tree of a text that is JSON; None if YAML could read a part of it in another way.

    `items` are those of the innermost collection that is open, `opened` the others around it and
    where each begins.
    """
    items: list[YamlNode] = []
    opened: list[tuple[int, list[YamlNode]]] = []
    values_left, end, whole = most, 0, len(file.text.rstrip(" \n"))
    make = (
        tuple.__new__
    )  # a node is made for each value: the constructor of a named tuple takes twice as long
    # Each part begins where the last one ends: a search from any other place would go through long
    # blanks again and again.
    scanner = _JSON_PART.scanner(file.text, 0, whole)  # type: ignore[attr-defined]
    for match in iter(scanner.match, None):
        kind, end = match.lastindex or 0, match.end()
        first, last = match.span(kind)
        if kind == OPENING:
            opened.append((first, items))
            items = []
            continue
        if kind == CLOSING:
            if (
                len(opened) > MAX_YAML_DEPTH
                or (closed := _close_collection(items, match[kind])) is None
            ):
                return None
            first, items = opened.pop()
            items.append(make(YamlNode, (closed, file, first, last)))
        else:
            written = match[kind]
            if kind == QUOTED:
                written = _ESCAPED.sub(r"\1", written[1:-1]) if "\\" in written else written[1:-1]
            items.append(make(YamlNode, (written, file, first, last)))
        values_left -= 1
        if values_left < 0:
            raise too_many_values(file, first, most)
    return items[0] if end == whole else None


def _close_collection(
    items: list[YamlNode], sign: str
) -> list[YamlNode] | dict[str, tuple[YamlNode, YamlNode]] | None:
    """The values of a list; of a mapping the keys with their nodes and values, or None if a key
    is long or comes twice.
    """
    if sign == "]":
        return items
    pairs = {key.value: (key, value) for key, value in zip(items[::2], items[1::2], strict=True)}
    if 2 * len(pairs) < len(items) or max(map(len, pairs), default=0) > LONGEST_KEY:
        return None
    return pairs


__all__ = ["File", "YamlNode", "read_file", "read_tree"]

SHORT_FILE_CHARACTERS = 2**16  # characters
MAX_FOUND = 100  # a file with more YAML errors than this is not read further


def read_tree(file: File, most: int = MAX_NODES) -> tuple[YamlNode, list[Diagnostic]]:
    """The tree of a file with at most so many values, and its errors. Raises `InvalidInput` if
    there is no tree.

    The trees of the last short files are remembered: the domain is read anew with each of its
    problems.
    """
    root, diagnostics = (
        _remembered if len(file.text) <= SHORT_FILE_CHARACTERS else _read_uncached
    )(file, most)
    return root, [*diagnostics]


def _read_uncached(file: File, most: int) -> tuple[YamlNode, list[Diagnostic]]:
    if (quick := json_tree(file, most)) is not None:
        return quick, []
    diagnostics: list[Diagnostic] = []
    try:
        root = Composer(file, diagnostics, most).compose()
    except yaml.YAMLError as error:
        raise InvalidInput([*diagnostics, _yaml_error(file, error)]) from None
    return root, diagnostics


_remembered = functools.lru_cache(64)(_read_uncached)


def outline_yaml(text: str) -> Iterator[str | None]:
    """The scalars of a YAML text in order, and None where a mapping or list begins or ends. Raises
    `InvalidInput`.

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
    """Builds the tree from parser events.

    An explicit stack limits the depth, instead of Python's recursion limit.
    """

    def __init__(self, file: File, diagnostics: list[Diagnostic], most: int) -> None:
        self.file, self.found, self.most = file, diagnostics, most
        self.count = 0

    def compose(self) -> YamlNode:
        stack: list[tuple[yaml.Event, list[YamlNode]]] = []
        roots: list[YamlNode] = []
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
            diagnostic = Diagnostic(
                roots[1].where, "K002", "a second document", "keep one, without `---` between"
            )
        else:
            hint = "give another one" if _is_json(self.file) else "it needs `domain:` or `problem:`"
            diagnostic = Diagnostic(Source(self.file.path), "K002", "the file is empty", hint)
        raise InvalidInput([*self.found, diagnostic])

    def _events(self) -> Iterator[yaml.Event]:
        for event in yaml.parse(self.file.text, Loader=yaml.CSafeLoader):
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
                self._refuse(event, "anchors and aliases are", "write the value out")
            elif (tag := getattr(event, "tag", None)) and tag != "!":
                self._refuse(event, f"the tag '{tag}' is", "quote the value if it starts with '!'")
            if not isinstance(event, yaml.AliasEvent):
                yield event

    def _refuse(self, event: yaml.Event, what: str, hint: str) -> None:
        where = self.file.at(_event_start(event))
        self._note(Diagnostic(where, "K004", f"{what} not part of the language", hint))

    def _note(self, diagnostic: Diagnostic) -> None:
        self.found.append(diagnostic)
        if len(self.found) > MAX_FOUND:
            raise InvalidInput(self.found)

    def _bound(self, event: yaml.Event, depth: int) -> None:
        if depth > MAX_YAML_DEPTH:
            where = self.file.at(_event_start(event))
            diagnostic = Diagnostic(
                where,
                "K007",
                f"nested deeper than {MAX_YAML_DEPTH} levels",
                "no file needs so many",
            )
            raise InvalidInput([*self.found, diagnostic])

    def _scalar(self, event: yaml.ScalarEvent) -> YamlNode:
        start, end = _event_start(event), _event_end(event)
        if control := find_unprintable(event.value):
            message = f"an escape makes the control character U+{ord(control[0]):04X}"
            self._note(Diagnostic(self.file.at(start), "K004", message, "remove it"))
        elif (start == end or self.file.text[start] not in "'\"|>") and (
            comment := _ASP_COMMENT.match(self.file.text, end)
        ):
            hint = "put the whole value in quotes"
            where = self.file.at(comment.start(1))
            self._note(
                Diagnostic(
                    where, "K006", f"YAML takes '{comment[1]}' for the start of a comment", hint
                )
            )
            return self._node("", event, event)  # the rest of the value would only be misread
        return self._node(event.value, event, event)

    def _node(self, value: Any, opened: yaml.Event, closed: yaml.Event) -> YamlNode:
        self.count += 1
        if self.count > self.most:
            raise too_many_values(self.file, _event_start(opened), self.most)
        return YamlNode(value, self.file, _event_start(opened), _event_end(closed))

    def _mapping(self, items: list[YamlNode], opened: yaml.Event, closed: yaml.Event) -> YamlNode:
        pairs: dict[str, tuple[YamlNode, YamlNode]] = {}
        for key, value in zip(items[::2], items[1::2], strict=False):
            if not isinstance(key.value, str):
                hint = "quote it if it starts with '[' or '{'"
                self._note(Diagnostic(key.where, "K005", "a key must be a plain string", hint))
            elif key.value in pairs:
                first = pairs[key.value][0].where
                message = f"the key '{key.value[:60]}' is already used in line {first.line}"
                self._note(
                    Diagnostic(
                        key.where, "K003", message, "remove one, or put both values under one key"
                    )
                )
            else:
                pairs[key.value] = (key, value)
        return self._node(pairs, opened, closed)


def _event_start(event: yaml.Event) -> int:
    return event.start_mark.index if event.start_mark else 0


def _event_end(event: yaml.Event) -> int:
    return event.end_mark.index if event.end_mark else 0


_ASP_COMMENT = re.compile(r"[ \t]+(#(?:count|sum\+?|min|max|true|false|inf|sup)\b)")


def _yaml_error(file: File, error: yaml.YAMLError) -> Diagnostic:
    mark = getattr(error, "problem_mark", None)
    where = file.at(mark.index) if mark else Source(file.path)
    problem = getattr(error, "problem", None) or str(error)
    if mark and not _is_json(file) and (offset := lacking_colon(file, mark.index)) is not None:
        said = "not YAML: a ':' is missing here"
        return Diagnostic(file.at(offset), "K002", said, "a key needs ': ' after it")
    hint = next((hint for part, hint in _YAML_HINTS.items() if part in problem), "")
    return Diagnostic(where, "K002", f"not {'JSON' if _is_json(file) else 'YAML'}: {problem}", hint)


def _is_json(file: File) -> bool:
    """Whether a program wrote the file. JSON is read as YAML, of which it is a part."""
    return file.path.endswith(".json")


_INDENT_HINT = (
    "indent it like its neighbours, and look for an open quote or bracket in an earlier line"
)
_YAML_HINTS = {
    "mapping values": "a value with ': ' or starting with '!', '%', '{' or '[' needs quotes",
    "cannot start any "
    "token": "indent with spaces, not tabs; a value starting with '%', '@' or '`' needs quotes",
    "expected ':'": "a key needs ': ' after it",
    "expected ','": "close the bracket, or put the whole value in quotes",
    "expected key": _INDENT_HINT,
    "expected <block end>": _INDENT_HINT,
    "expected '-' indicator": _INDENT_HINT,
    "unexpected end of stream": "close the quote",
    "unexpected document indicator": "close the quote",
    "undefined tag handle": "quote the value if it starts with '!'",
    "unknown escape": "use single quotes, which have no escapes",
}
