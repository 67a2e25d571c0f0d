"""Texts broken into lines as people would do it: between terms, within a term after its commas or its brackets."""

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
    """Terms and words; a term longer than a line is broken after its commas, what is still longer at its brackets."""
    for term in terms(text):
        for word in [term] if len(term.rstrip()) <= width else WORD.findall(term):
            yield from PART.findall(word) if len(word.rstrip()) > width else [word]


def terms(text: str) -> Iterator[str]:
    """The text, cut at the spaces that are within no brackets."""
    term, depth = "", 0
    for word in WORD.findall(text):
        term += word
        depth = max(0, depth + word.count("(") - word.count(")"))
        if depth == 0:
            yield term
            term = ""
    yield term
