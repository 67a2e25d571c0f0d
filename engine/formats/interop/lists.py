"""Lists in YAML files as lines of text: where their items stand, and the lines with other items in their place.

A list stands with one item a line, or between brackets. Only its own lines change. Lists in another form are refused.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

OPENING, CLOSING = "([{", ")]}"


@dataclass(frozen=True, slots=True)
class ListedItem:
    """An item as it is written, with its quotes, and the comment behind it."""

    text: str
    comment: str = ""


@dataclass(frozen=True, slots=True)
class YamlList:
    """A list in lines `first` to `stop`. `head` stands before the items, `tail` behind them; `margin` is None in brackets."""

    first: int
    stop: int
    head: str
    items: tuple[ListedItem | str, ...]  # in a list of lines, comments and empty lines are texts
    tail: str = ""
    margin: str | None = None

    def entries(self) -> list[ListedItem]:
        """The items without the comments between them."""
        return [each for each in self.items if isinstance(each, ListedItem)]

    def written(self, items: Sequence[ListedItem | str]) -> list[str]:
        """The lines of the list with these items."""
        if self.margin is None:
            shown = [_bracketed(each.text) for each in items if isinstance(each, ListedItem)]
            return [f"{self.head}[{', '.join(shown)}]{self.tail}"]
        lines = [e if isinstance(e, str) else f"{self.margin}- {e.text}{e.comment}" for e in items]
        entries = any(isinstance(each, ListedItem) for each in items)
        return [self.head if entries else _emptied(self.head), *lines]


def _emptied(head: str) -> str:
    key, colon, rest = head.partition(":")
    return f"{key}{colon} []{rest}"


def refused(
    path: str, message: str, hint: str = "write one measurement, one fact or one goal per line"
) -> InvalidInput:
    """The refusal of a file whose lists cannot be changed line by line."""
    return InvalidInput([Diagnostic(Source(path), "K418", message, hint)])


def listed(lines: Sequence[str], keys: Sequence[str], path: str) -> YamlList | None:
    """The list under nested keys; None if one of them does not occur. Raises `InvalidInput` if it has another form."""
    at, begin, end, depth, head, rest = 0, 0, len(lines), -1, "", ""
    for number, key in enumerate(keys):
        found = _key(lines, key, range(begin, end), depth)
        if found is None:
            return None
        at = found
        depth = _depth(lines[at])
        head, rest = _halves(lines[at])
        inside = re.match(rf"\s*\{{(.*\b{keys[-1]}\s*:\s*)(?=\[)", rest)
        if number + 1 < len(keys) and inside:
            return _bracketed_list(lines, at, f"{head}{inside[0]}", path)
        begin, end = at + 1, _end(lines, at, depth)
    if rest.strip().startswith("["):
        return _bracketed_list(lines, at, head + rest[: rest.index("[")], path)
    if rest.strip() and not rest.strip().startswith("#"):
        raise refused(path, f"'{keys[-1]}:' in line {at + 1} is no list")
    return _lined_list(lines, at, end, depth, path)


def _key(lines: Sequence[str], key: str, among: range, depth: int) -> int | None:
    """The first line of a key that is deeper than `depth`, among the least deep lines there."""
    inner = [number for number in among if _depth(lines[number]) > depth and _says(lines[number])]
    least = min((_depth(lines[number]) for number in inner), default=0)
    found = (
        n
        for n in inner
        if _depth(lines[n]) == least and re.match(rf"\s*{re.escape(key)}\s*:(\s|$)", lines[n])
    )
    return next(found, None)


def _says(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _halves(line: str) -> tuple[str, str]:
    colon = line.index(":") + 1
    return line[:colon], line[colon:]


def _depth(line: str) -> int:
    return len(line) - len(line.lstrip())


def _end(lines: Sequence[str], at: int, depth: int) -> int:
    """The line behind everything that belongs to a key; items of a list may be as deep as their key."""
    for number in range(at + 1, len(lines)):
        line = lines[number]
        if _says(line) and (
            _depth(line) < depth or (_depth(line) == depth and not line.lstrip().startswith("- "))
        ):
            return number
    return len(lines)


def _lined_list(lines: Sequence[str], at: int, end: int, depth: int, path: str) -> YamlList:
    while end > at + 1 and not _says(lines[end - 1]):
        end -= 1
    items: list[ListedItem | str] = []
    margin = " " * (depth + 2)
    for line in lines[at + 1 : end]:
        found = re.match(r"(\s*)- (.*)$", line)
        if found:
            margin = found[1]
            items.append(ListedItem(*_without_comment(found[2])))
        elif _says(line):
            raise refused(path, f"an item of '{lines[at].strip()}' goes over several lines")
        else:
            items.append(line)
    return YamlList(at, end, lines[at], tuple(items), margin=margin)


def _bracketed_list(lines: Sequence[str], at: int, head: str, path: str) -> YamlList:
    text, stop = lines[at], at + 1
    close = _closing(text, len(head))
    while close is None and stop < len(lines):
        text, stop = f"{text} {lines[stop].strip()}", stop + 1
        close = _closing(text, len(head))
    if close is None or (stop > at + 1 and _without_comment(text[:close])[1]):
        raise refused(path, f"the list in line {at + 1} cannot be read as lines")
    parts = [each.strip() for each in split(text[len(head) + 1 : close])]
    return YamlList(at, stop, head, tuple(ListedItem(each) for each in parts if each), text[close + 1 :])


def _closing(text: str, begin: int) -> int | None:
    """The place of the bracket that closes the one at `begin`."""
    return next((place for place, depth, _ in _walk(text, begin) if depth == 0), None)


def _walk(text: str, begin: int = 0) -> Iterator[tuple[int, int, str]]:
    """Each character outside of quotes: its place, how deep in brackets it stands, and itself."""
    depth, quote = 0, ""
    for place in range(begin, len(text)):
        each = text[place]
        if quote:
            quote = "" if each == quote and text[place - 1] != "\\" else quote
        elif each in "\"'" and (place == begin or not text[place - 1].isalnum()):
            quote = each
        else:
            depth += (each in OPENING) - (each in CLOSING)
            yield place, depth, each


def split(text: str) -> list[str]:
    """The parts of a text between commas that stand outside of brackets and quotes."""
    cuts = [place for place, depth, each in _walk(text) if each == "," and depth == 0]
    return [text[a + 1 : b] for a, b in zip([-1, *cuts], [*cuts, len(text)], strict=True)]


def _without_comment(text: str) -> tuple[str, str]:
    """The text of an item, and the comment behind it with the blanks before that."""
    cut = next(
        (p for p, _, each in _walk(text) if each == "#" and (p == 0 or text[p - 1].isspace())), len(text)
    )
    body = text[:cut].rstrip()
    return body, text[len(body) :]


def _bracketed(text: str) -> str:
    """An item as it can stand in brackets: with quotes if it contains a comma."""
    if text[:1] in ("'", '"') or "," not in text:
        return text
    return f"'{text}'" if '"' in text else f'"{text}"'
