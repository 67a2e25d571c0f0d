"""Places in a text: the editor counts lines and UTF-16 units from 0, we count characters."""

import re
from bisect import bisect_right

from lsprotocol import types

_END = re.compile(r"\r\n|\n|\r")


class Lines:
    """The lines of a text, for places in it."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.starts = [0, *(found.end() for found in _END.finditer(text))]

    def offset(self, position: types.Position) -> int:
        """The place of a position; positions behind the end of a line or of the text mean that end."""
        if position.line >= len(self.starts):
            return len(self.text)
        start = self.starts[position.line]
        line = self._line(position.line)
        if line.isascii():
            return start + min(position.character, len(line))
        units = 0
        for number, character in enumerate(line):
            if units >= position.character:
                return start + number
            units += 2 if ord(character) > 0xFFFF else 1
        return start + len(line)

    def position(self, offset: int) -> types.Position:
        """The position of a place."""
        offset = min(max(offset, 0), len(self.text))
        line = bisect_right(self.starts, offset) - 1
        before = self.text[self.starts[line] : offset]
        character = len(before) if before.isascii() else len(before.encode("utf-16-le", "surrogatepass")) // 2
        return types.Position(line, character)

    def range(self, start: int, end: int) -> types.Range:
        """The range between two places."""
        return types.Range(self.position(start), self.position(end))

    def _line(self, number: int) -> str:
        end = self.starts[number + 1] if number + 1 < len(self.starts) else len(self.text)
        return self.text[self.starts[number] : end].rstrip("\r\n")


def changed(text: str, change: types.TextDocumentContentChangeEvent) -> str:
    """The text after a change."""
    if isinstance(change, types.TextDocumentContentChangePartial):
        lines = Lines(text)
        start, end = lines.offset(change.range.start), lines.offset(change.range.end)
        return text[:start] + change.text + text[max(start, end) :]
    return change.text
