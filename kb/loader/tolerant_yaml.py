"""Trees of a YAML text that may be broken, piece by piece, for editors.

A file is cut at the lines that begin a section, and each section at those that begin an entry of
it, so an error spoils one entry and not the file. In a broken entry, lines are left out until the
rest is YAML.
"""

import re
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from typing import NamedTuple

import yaml

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.files import File
from cellwright.kb.loader.yaml_tree import MAX_NODES, Composer, YamlNode

MAX_TRIES = 6  # lines that are left out of one broken entry
_SECTION = re.compile(r"^(?![#%\]}]|-{3}|\.{3})\S[^\n]*$", re.MULTILINE)
_BARE = re.compile(r"([A-Za-z_][\w-]*)[ \t]*:[ \t]*(?:#[^\n]*)?$", re.MULTILINE)
_CONTENT = re.compile(r"^([ ]*)[^\s#][^\n]*$", re.MULTILINE)


class YamlPiece(NamedTuple):
    """A part of a file: the section that it belongs to (empty: the file itself), where it
    begins, and its text.
    """

    section: str
    start: int
    text: str


def split_pieces(text: str) -> Iterator[YamlPiece]:
    """The pieces of a YAML text, in order.

    Together they hold all of it except what stands before the first section.
    """
    starts = [match.start() for match in _SECTION.finditer(text)]
    for start, end in zip(starts, [*starts[1:], len(text)], strict=False):
        head = _BARE.match(text, start, end)
        yield from (
            _of_section(text, head, end) if head else (YamlPiece("", start, text[start:end]),)
        )


def _of_section(text: str, head: re.Match[str], end: int) -> Iterator[YamlPiece]:
    """The key of a section alone, then each of its entries."""
    lines = [
        (match.start(), len(match[1])) for match in _CONTENT.finditer(text, head.end() + 1, end)
    ]
    least = min((indent for _, indent in lines), default=0)
    starts = [start for start, indent in lines if indent == least]
    yield YamlPiece("", head.start(), text[head.start() : starts[0] if starts else end])
    for start, stop in zip(starts, [*starts[1:], end], strict=False):
        yield YamlPiece(head[1], start, text[start:stop])


@lru_cache(8192)
def piece_tree(text: str) -> YamlNode | None:
    """The tree of a piece, with places counted from its beginning; None if there is none."""
    for _ in range(MAX_TRIES):
        tree = _try_tree(text)
        if isinstance(tree, YamlNode):
            return tree
        if tree is None:
            return None
        text = tree
    return None


def _try_tree(text: str) -> YamlNode | str | None:
    """The tree of a text; else the text without a line that is to blame; None if nothing can be
    done.
    """
    try:
        return _compose_tree(text)
    except InvalidInput:
        return None
    except yaml.YAMLError as error:
        rests = [_without_line(text, index) for index in _blamed_lines(text, error)]
    for rest in rests:
        with suppress(InvalidInput, yaml.YAMLError):
            return _compose_tree(rest)
    return rests[0] if rests else None


def _compose_tree(text: str) -> YamlNode:
    return Composer(File("", text, (0,)), [], MAX_NODES).compose()


def _blamed_lines(text: str, error: yaml.YAMLError) -> list[int]:
    """Where the lines begin that may be to blame: where a bracket was opened, where YAML
    stopped, and the line before.
    """
    context = str(getattr(error, "context", ""))
    marks = (
        [getattr(error, "context_mark", None)] if "flow" in context or "quoted" in context else []
    )
    marks.append(getattr(error, "problem_mark", None))
    lines: dict[int, None] = {}
    for mark in filter(None, marks):
        start = _line_at(text, min(mark.index, len(text)))
        lines[start] = None
        lines[_line_at(text, start - 1)] = None
    return [start for start in lines if start >= 0]


def _line_at(text: str, index: int) -> int:
    """Where the last line that is not blank begins, seen from a place; -1 if there is none."""
    while index >= 0:
        start = text.rfind("\n", 0, index) + 1
        if text[start : index + 1].strip() or text[start:].partition("\n")[0].strip():
            return start
        index = start - 1
    return -1


def _without_line(text: str, start: int) -> str:
    """The text without a line. If it was the key of lines below it, another key stands for it."""
    line, _, rest = text[start:].partition("\n")
    indent = len(line) - len(line.lstrip())
    below = _CONTENT.search(rest)
    key = "_:" if below and len(below[1]) > indent and len(line) > indent + 1 else ""
    return text[:start] + (" " * indent + key).ljust(len(line)) + text[start + len(line) :]
