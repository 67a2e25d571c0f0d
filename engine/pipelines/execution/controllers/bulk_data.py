"""Bulk data of replies that come in parts: pieces of a name are joined, within a limit."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from cellwright.engine.pipelines.execution.controllers.protocol import (
    MAX_NAME_CHARACTERS,
    MalformedLine,
)

MAX_BULK_BYTES = 32 * 2**20  # of memory, for all commands that are open
MAX_BULK_PIECES = 100_000
PIECE_BYTES = 100  # beside the characters of a piece


@dataclass
class BulkData:
    """The pieces that have come before the replies to open commands."""

    _pieces: dict[int, dict[str, list[str]]] = field(default_factory=dict)
    _spoilt: set[int] = field(default_factory=set)  # commands whose pieces were too many
    _characters: int = 0
    _count: int = 0
    _width: int = 1  # bytes of the widest character

    def add(self, number: int, name: str, text: str) -> None:
        """Take in a piece. Raises `MalformedLine` if it is too much; all pieces of this command are
        dropped then.
        """
        if number in self._spoilt:
            return
        self._count += 1
        self._characters += len(text)
        self._width = max(self._width, character_bytes(text))
        size = self._characters * self._width + PIECE_BYTES * self._count
        is_long = len(name) > MAX_NAME_CHARACTERS
        if is_long or size > MAX_BULK_BYTES or self._count > MAX_BULK_PIECES:
            self.joined(number)
            self._spoilt.add(number)
            raise MalformedLine(f"parts for command {number} that are too many, and are dropped")
        self._pieces.setdefault(number, {}).setdefault(name, []).append(text)

    def joined(self, number: int) -> Mapping[str, str]:
        """The data that came in parts before the reply to a command; they are given once."""
        self._spoilt.discard(number)
        pieces = self._pieces.pop(number, {})
        if not self._pieces:
            self._characters, self._count, self._width = 0, 0, 1
        else:
            self._count -= sum(map(len, pieces.values()))
            self._characters -= sum(len(text) for texts in pieces.values() for text in texts)
        return {name: "".join(texts) for name, texts in pieces.items()}


def character_bytes(text: str) -> int:
    """How many bytes of memory Python takes for each character of a text."""
    if text.isascii():
        return 1
    widest = max(text)
    return 1 if widest < "\u0100" else 2 if widest < "\U00010000" else 4
