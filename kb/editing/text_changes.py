"""Changes of a text that an editor offers: renaming a name, and fixing a finding."""

import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

from cellwright.kb.diagnostics import Diagnostic, suggested_name
from cellwright.kb.editing.expression_tokens import mentions_in, tokens_of
from cellwright.kb.editing.name_index import DeviceIndex, FileIndex, NameIndex, Symbol
from cellwright.kb.editing.name_occurrences import Occurrence
from cellwright.kb.model.domain_model import BUILT_IN_TYPES

RENAMED_KINDS = ("predicate", "type", "function", "object", "operator", "variable", "cause")
_NAME, _VARIABLE = r"[a-z][A-Za-z0-9_]*", r"_?[A-Z][A-Za-z0-9_]*"


class TextChange(NamedTuple):
    """A text in place of the characters from `start` to `end` of a file."""

    path: str
    start: int
    end: int
    text: str


class NotRenamed(Exception):
    """Why a name is not changed, in one sentence."""


def symbol_to_rename(index: NameIndex, file: FileIndex, offset: int) -> tuple[Symbol, Occurrence]:
    """What would be renamed at a place. Raises `NotRenamed`."""
    symbol_found = index.symbol(file, offset)
    if (
        symbol_found is None
        or symbol_found[0].space not in RENAMED_KINDS
        or symbol_found[1].name == "_"
    ):
        raise NotRenamed("there is no name to change here")
    symbol, place = symbol_found
    if symbol.name in BUILT_IN_TYPES and symbol.space == "type":
        raise NotRenamed(f"'{symbol.name}' is built in")
    if symbol.space != "variable" and not index.definitions(symbol):
        raise NotRenamed(f"'{symbol.name}' is declared nowhere in the files of this domain")
    for home, _ in index.uses(symbol) if symbol.space != "variable" else ():
        if isinstance(home, DeviceIndex):
            hint = f"`cellwright devices show {home.device}` lists what a use can call otherwise"
            raise NotRenamed(f"'{symbol.name}' is a name in the device '{home.device}': {hint}")
    if any(occurrence.ranged for _, occurrence in index.uses(symbol)):
        raise NotRenamed(
            f"'{symbol.name}' is written as part of a range: list the names of the range first"
        )
    return symbol, place


def rename_occurrences(
    index: NameIndex, file: FileIndex, offset: int, name: str
) -> Iterator[TextChange]:
    """The changes that give a name its new form everywhere. Raises `NotRenamed`."""
    symbol, _ = symbol_to_rename(index, file, offset)
    _refuse_name(index, file, symbol, name)
    places = {
        (used_file.path, occurrence.start, occurrence.end)
        for used_file, occurrence in index.uses(symbol)
    }
    yield from (TextChange(*place, name) for place in sorted(places))


def _refuse_name(index: NameIndex, file: FileIndex, symbol: Symbol, name: str) -> None:
    """Raise `NotRenamed` if this cannot be the name."""
    pattern = _VARIABLE if symbol.space == "variable" else _NAME
    if re.fullmatch(pattern, name) is None or name == "not":
        kind = "capital" if symbol.space == "variable" else "small"
        raise NotRenamed(
            f"'{name}' is no name here: write a {kind} letter, then letters, digits and _"
        )
    if symbol.space == "variable":
        if any(
            True
            for _ in index.uses(Symbol("variable", name, file.path, symbol.piece, symbol.scope))
        ):
            raise NotRenamed(f"there is a variable {name} here already")
        return
    taken = _CLASHING_SPACES.get(symbol.space, (symbol.space,))
    for space in taken:
        if name != symbol.name and (declared := index.declarations.get((space, name))):
            raise NotRenamed(f"'{name}' is declared already, as {declared[0][1].kind}")
    if symbol.space in ("predicate", "type") and name in BUILT_IN_TYPES:
        raise NotRenamed(f"'{name}' is built in")
    if symbol.space == "predicate" and any(True for _ in index.uses(Symbol("predicate", name))):
        raise NotRenamed(f"rules use the name '{name}' already")


_CLASHING_SPACES = {
    "predicate": ("predicate", "type"),
    "type": ("type", "predicate"),
    "object": ("object", "function"),
    "function": ("function", "object"),
}


MAX_FINDING_REACH = (
    4000  # characters after the place of a finding in which the name that it is about may stand
)
_YAML_INDENT = "  "


class Fix(NamedTuple):
    """What is offered, and the changes that do it.

    `preferred`: the one that is most probably meant.
    """

    title: str
    changes: tuple[TextChange, ...]
    preferred: bool = False


def fixes_of(index: NameIndex, file: FileIndex, finding: Diagnostic) -> Iterator[Fix]:
    """What can be done about a finding in a file."""
    if not 1 <= finding.where.line <= len(file.line_starts):
        return
    start = min(
        file.line_starts[finding.where.line - 1] + max(finding.where.column - 1, 0), len(file.text)
    )
    if name := suggested_name(finding.hint):
        yield from _replace_quoted(file, finding, start, name)
    if make := _FIX_MAKERS.get(finding.code):
        yield from make(index, file, finding, start)


def _replace_quoted(file: FileIndex, finding: Diagnostic, start: int, name: str) -> Iterator[Fix]:
    """The name that was probably meant in place of the one that is quoted in the message."""
    for wrong in _quoted_names(finding.message):
        if (place := _find_name(file.text, wrong, start)) is not None:
            change = TextChange(file.path, place, place + len(wrong), name)
            yield Fix(f"write '{name}'", (change,), True)
            return


def _quoted_names(message: str) -> list[str]:
    """The names in a message, those in quotes first."""
    return [*re.findall(r"'([^']+)'", message), *re.findall(r"variable (\w+)", message)]


def _find_name(text: str, name: str, start: int) -> int | None:
    """Where a whole name stands next after a place, else in its line."""
    pattern = re.compile(rf"(?<![\w']){re.escape(name)}(?![\w'])")
    match = pattern.search(text, start, start + MAX_FINDING_REACH)
    match = match or pattern.search(text, text.rfind("\n", 0, start) + 1, start + MAX_FINDING_REACH)
    return match.start() if match else None


def _lone_variable(
    _index: NameIndex, file: FileIndex, finding: Diagnostic, start: int
) -> Iterator[Fix]:
    for name in _quoted_names(finding.message)[:1]:
        if (place := _find_name(file.text, name, start)) is not None:
            change = TextChange(file.path, place, place + len(name), f"_{name}")
            yield Fix(f"call it _{name}: it may occur only once", (change,))


def _missing_key(
    _index: NameIndex, file: FileIndex, finding: Diagnostic, start: int
) -> Iterator[Fix]:
    match = re.fullmatch(r"the key '(\w+)' is missing", finding.message)
    if match is None:
        return
    column = start - (file.text.rfind("\n", 0, start) + 1)
    text = (
        f"{match[1]}: , "
        if file.text[start : start + 1] == "{"
        else f"{match[1]}: \n{' ' * column}"
    )
    place = start + 1 if file.text[start : start + 1] == "{" else start
    yield Fix(f"add the key '{match[1]}'", (TextChange(file.path, place, place, text),))


def _not_in_header(
    _index: NameIndex, file: FileIndex, finding: Diagnostic, start: int
) -> Iterator[Fix]:
    """Add a variable to the header of its operator."""
    names = re.findall(r"variable (\w+) is not in the header", finding.message)
    header = next(
        (
            occurrence
            for occurrence in file.around(start)
            if occurrence.space == "operator" and occurrence.doing == "declared"
        ),
        None,
    )
    if not names or header is None:
        return
    behind = file.text[header.end : header.end + 1]
    close = file.text.find(")", header.end)
    if behind == "(" and close >= 0:
        change = TextChange(file.path, close, close, f", {names[0]}")
    else:
        change = TextChange(file.path, header.end, header.end, f"({names[0]})")
    yield Fix(f"add {names[0]} to the header of {header.name}", (change,))


def _declare_predicate(
    index: NameIndex, file: FileIndex, finding: Diagnostic, start: int
) -> Iterator[Fix]:
    """Declare an unknown predicate, with as many arguments as it is used with."""
    match = re.fullmatch(r"unknown predicate '(\w+)'", finding.message)
    place = _find_name(file.text, match[1], start) if match else None
    if match is None or place is None:
        return
    signature = f"{match[1]}{_argument_types(index, file.text[place : place + 200])}"
    for home in index.files.values():
        for section in ("fluents", "statics", "derived"):
            header = re.search(rf"^{section}:[ \t]*(#[^\n]*)?\n", home.text, re.MULTILINE)
            if home.kind == "domain" and header:
                change = TextChange(
                    home.path, header.end(), header.end(), f"{_YAML_INDENT}{signature}: {{}}\n"
                )
                yield Fix(f"declare {signature} under `{section}:`", (change,))


def _argument_types(index: NameIndex, text: str) -> str:
    """The types of the arguments with which a predicate is used; `object` where they are not
    known.
    """
    text_tokens, depth, end = tokens_of(text), 0, len(text)
    for token in text_tokens[1:]:
        depth += (token.text == "(") - (token.text == ")")
        if depth <= 0:
            end = token.end
            break
    inner = [mention for mention in mentions_in(text[:end]) if mention.head == text_tokens[0].text]
    count = max((mention.number for mention in inner), default=-1) + 1
    types = ["object"] * count
    for inner_mention in inner:
        if declared := index.declarations.get(("object", inner_mention.name)):
            types[inner_mention.number] = declared[0][1].of or "object"
    return f"({', '.join(types)})" if types else ""


def _remove_unused(
    _index: NameIndex, file: FileIndex, finding: Diagnostic, start: int
) -> Iterator[Fix]:
    """Remove a declaration of one line."""
    begin = file.text.rfind("\n", 0, start) + 1
    end = file.text.find("\n", start) + 1 or len(file.text)
    following = file.text[end:].partition("\n")[0]
    indent = len(file.text[begin:end]) - len(file.text[begin:end].lstrip())
    if len(following) - len(following.lstrip()) <= indent or not following.strip():
        names = _quoted_names(finding.message)
        yield Fix(
            f"remove '{names[0]}'" if names else "remove it",
            (TextChange(file.path, begin, end, ""),),
        )


_FIX_MAKERS: dict[str, Callable[[NameIndex, FileIndex, Diagnostic, int], Iterator[Fix]]] = {
    "K005": _missing_key,
    "K101": _declare_predicate,
    "K105": _not_in_header,
    "K110": _lone_variable,
    "K309": _remove_unused,
}
