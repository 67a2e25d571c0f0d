"""Atoms broken into lines as people would do it: after spaces, or after opening brackets if there are few spaces."""

import re
from collections.abc import Iterator

WORD = re.compile(r"(?:for )?[^ ]* ?")
PART = re.compile(r"[^ (]*[ (]?")


def wrapped(text: str, width: int, indent: int = 2) -> str:
    """The text in lines of at most `width` characters (at least 4); all lines except the first are indented.

    Only line breaks and spaces change.
    """
    return "\n".join(_lines(text, max(width, indent + 2), " " * indent))


def _lines(text: str, width: int, indent: str) -> Iterator[str]:
    line = ""
    for piece in _pieces(text, width - len(indent)):
        if line.strip() and len((line + piece).rstrip()) > width:
            yield line.rstrip()
            line = indent
        line += piece
        while len(line.rstrip()) > width:  # one piece longer than a line
            yield line[:width]
            line = indent + line[width:]
    yield line.rstrip()


def _pieces(text: str, width: int) -> Iterator[str]:
    """The words; a word longer than a line is broken at its brackets."""
    for word in WORD.findall(text):
        yield from PART.findall(word) if len(word.rstrip()) > width else [word]
