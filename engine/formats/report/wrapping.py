"""Atoms broken into lines where people would break them: after spaces; where these are rare, after opening brackets."""

import re
from collections.abc import Iterator

WORD = re.compile(r"(?:for )?[^ ]* ?")
PART = re.compile(r"[^ (]*[ (]?")


def wrapped(text: str, width: int, indent: int = 2) -> str:
    """The text in lines of at most `width` characters (4 at least), all but the first indented.

    Nothing is lost: without line breaks and spaces the text is the same.
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
    """Words; those that are longer than a line, at their brackets."""
    for word in WORD.findall(text):
        yield from PART.findall(word) if len(word.rstrip()) > width else [word]
