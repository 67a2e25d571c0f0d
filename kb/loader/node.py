"""The parts of a file that is read: raw strings, sequences and mappings that know their places."""

import functools
import re
from bisect import bisect_left
from typing import Any, NamedTuple

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File

MAX_DEPTH = 50
MAX_NODES = 1_000_000


class Node(NamedTuple):
    """A part of a YAML file: `value` is a string, a list of nodes, or a dict from string to (key node, node)."""

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
        """Where character `offset` of a scalar's value stands in the file, found by counting non-blank characters.

        It is exact for plain, quoted, folded and literal scalars; escapes inside double quotes shift it.
        """
        raw = self.file.text[self.start : self.end]
        if raw == self.value:
            return min(self.start + offset, max(self.start, self.end - 1))
        visible = _visible(raw)
        wanted = len("".join(self.value[:offset].split()))
        if wanted >= len(visible):
            return max(self.start, self.end - 1) if offset and visible else self.start
        return self.start + visible[wanted]

    def plain(self) -> Any:
        """The content as strings, lists and dicts; an empty scalar is None."""
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


@functools.lru_cache(maxsize=4)
def _visible(raw: str) -> list[int]:
    """The places of the non-blank characters in a scalar's source, after its quote or block indicator."""
    found = re.match(r"[|>][-+0-9]*[^\n]*\n|['\"]|", raw)
    skip = found.end() if found else 0
    places = [each.start() for each in re.finditer(r"\S", raw)]
    return places[bisect_left(places, skip) :]


def too_many(file: File, offset: int, most: int) -> InvalidInput:
    """The error of a file with more than `most` values; the first too many begins at `offset`."""
    return InvalidInput([Diagnostic(file.at(offset), "K007", f"more than {most} values in one file")])
