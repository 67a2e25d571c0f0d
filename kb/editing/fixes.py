"""What an editor can do about a finding: the hint as a change of the text."""

import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

from cellwright.kb.diagnostics import Diagnostic, suggested
from cellwright.kb.editing.changing import Change
from cellwright.kb.editing.index import FileIndex, Index
from cellwright.kb.editing.tokens import mentions, tokens

REACH = 4000  # characters after the place of a finding in which the name that it is about may stand
_INDENT = "  "


class Fix(NamedTuple):
    """What is offered, and the changes that do it. `preferred`: the one that is most probably meant."""

    title: str
    changes: tuple[Change, ...]
    preferred: bool = False


def fixes(index: Index, file: FileIndex, finding: Diagnostic) -> Iterator[Fix]:
    """What can be done about a finding in a file."""
    if not 1 <= finding.where.line <= len(file.line_starts):
        return
    start = min(file.line_starts[finding.where.line - 1] + max(finding.where.column - 1, 0), len(file.text))
    if name := suggested(finding.hint):
        yield from _replaced(file, finding, start, name)
    if make := _MAKERS.get(finding.code):
        yield from make(index, file, finding, start)


def _replaced(file: FileIndex, finding: Diagnostic, start: int, name: str) -> Iterator[Fix]:
    """The name that was probably meant in place of the one that is quoted in the message."""
    for wrong in _quoted(finding.message):
        if (place := _find(file.text, wrong, start)) is not None:
            change = Change(file.path, place, place + len(wrong), name)
            yield Fix(f"write '{name}'", (change,), True)
            return


def _quoted(message: str) -> list[str]:
    """The names in a message, those in quotes first."""
    return [*re.findall(r"'([^']+)'", message), *re.findall(r"variable (\w+)", message)]


def _find(text: str, name: str, start: int) -> int | None:
    """Where a whole name stands next after a place, else in its line."""
    pattern = re.compile(rf"(?<![\w']){re.escape(name)}(?![\w'])")
    found = pattern.search(text, start, start + REACH)
    found = found or pattern.search(text, text.rfind("\n", 0, start) + 1, start + REACH)
    return found.start() if found else None


def _lone_variable(_index: Index, file: FileIndex, finding: Diagnostic, start: int) -> Iterator[Fix]:
    for name in _quoted(finding.message)[:1]:
        if (place := _find(file.text, name, start)) is not None:
            change = Change(file.path, place, place + len(name), f"_{name}")
            yield Fix(f"call it _{name}: it may occur only once", (change,))


def _missing_key(_index: Index, file: FileIndex, finding: Diagnostic, start: int) -> Iterator[Fix]:
    found = re.fullmatch(r"the key '(\w+)' is missing", finding.message)
    if found is None:
        return
    column = start - (file.text.rfind("\n", 0, start) + 1)
    text = f"{found[1]}: , " if file.text[start : start + 1] == "{" else f"{found[1]}: \n{' ' * column}"
    place = start + 1 if file.text[start : start + 1] == "{" else start
    yield Fix(f"add the key '{found[1]}'", (Change(file.path, place, place, text),))


def _not_in_header(_index: Index, file: FileIndex, finding: Diagnostic, start: int) -> Iterator[Fix]:
    """Add a variable to the header of its operator."""
    names = re.findall(r"variable (\w+) is not in the header", finding.message)
    header = next(
        (each for each in file.around(start) if each.space == "operator" and each.doing == "declared"), None
    )
    if not names or header is None:
        return
    behind = file.text[header.end : header.end + 1]
    close = file.text.find(")", header.end)
    if behind == "(" and close >= 0:
        change = Change(file.path, close, close, f", {names[0]}")
    else:
        change = Change(file.path, header.end, header.end, f"({names[0]})")
    yield Fix(f"add {names[0]} to the header of {header.name}", (change,))


def _declared(index: Index, file: FileIndex, finding: Diagnostic, start: int) -> Iterator[Fix]:
    """Declare an unknown predicate, with as many arguments as it is used with."""
    found = re.fullmatch(r"unknown predicate '(\w+)'", finding.message)
    place = _find(file.text, found[1], start) if found else None
    if found is None or place is None:
        return
    signature = f"{found[1]}{_arguments(index, file.text[place : place + 200])}"
    for home in index.files.values():
        for section in ("fluents", "statics", "derived"):
            header = re.search(rf"^{section}:[ \t]*(#[^\n]*)?\n", home.text, re.MULTILINE)
            if home.kind == "domain" and header:
                change = Change(home.path, header.end(), header.end(), f"{_INDENT}{signature}: {{}}\n")
                yield Fix(f"declare {signature} under `{section}:`", (change,))


def _arguments(index: Index, text: str) -> str:
    """The types of the arguments with which a predicate is used; `object` where they are not known."""
    found, depth, end = tokens(text), 0, len(text)
    for token in found[1:]:
        depth += (token.text == "(") - (token.text == ")")
        if depth <= 0:
            end = token.end
            break
    inner = [each for each in mentions(text[:end]) if each.head == found[0].text]
    count = max((each.number for each in inner), default=-1) + 1
    types = ["object"] * count
    for each in inner:
        if declared := index.declarations.get(("object", each.name)):
            types[each.number] = declared[0][1].of or "object"
    return f"({', '.join(types)})" if types else ""


def _unused(_index: Index, file: FileIndex, finding: Diagnostic, start: int) -> Iterator[Fix]:
    """Remove a declaration of one line."""
    begin = file.text.rfind("\n", 0, start) + 1
    end = file.text.find("\n", start) + 1 or len(file.text)
    following = file.text[end:].partition("\n")[0]
    indent = len(file.text[begin:end]) - len(file.text[begin:end].lstrip())
    if len(following) - len(following.lstrip()) <= indent or not following.strip():
        names = _quoted(finding.message)
        yield Fix(f"remove '{names[0]}'" if names else "remove it", (Change(file.path, begin, end, ""),))


_MAKERS: dict[str, Callable[[Index, FileIndex, Diagnostic, int], Iterator[Fix]]] = {
    "K005": _missing_key,
    "K101": _declared,
    "K105": _not_in_header,
    "K110": _lone_variable,
    "K309": _unused,
}
