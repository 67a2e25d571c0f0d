"""The index of names of one file, and of all files of a domain."""

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from cellwright.kb.editing.occurrences import Declared, Names, Occurrence, names_of
from cellwright.kb.editing.rules import names_in_rules
from cellwright.kb.editing.shapes import KINDS
from cellwright.kb.loader.tolerant import Piece, pieces

ASP = "asp"
_STATEMENTS = re.compile(r"[^\n]*\.[ \t]*(?:%[^\n]*)?\n|[^\n]*\n|[^\n]+")
_KIND = re.compile(rf"^({'|'.join(KINDS)})[ \t]*:", re.MULTILINE)


def kind_of(path: str, text: str) -> str:
    """The kind of a file: `asp`, or one of `cellwright.kb.editing.shapes`. What cannot be told is a domain, or a part of one."""
    if not path.endswith((".yaml", ".yml")):
        return ASP
    found = {each[1] for each in _KIND.finditer(text)}
    others = [kind for kind in found if kind != "domain"]
    return others[0] if len(others) == 1 else "problem" if "problem" in found else "domain"


@dataclass(frozen=True)
class FileIndex:
    """The names in one text."""

    path: str
    text: str
    kind: str

    @staticmethod
    def of(path: str, text: str) -> "FileIndex":
        """The index of a text."""
        return FileIndex(path, text, kind_of(path, text))

    @cached_property
    def pieces(self) -> list[tuple[int, Names]]:
        """Where each piece of the text begins, and what names it holds."""
        if self.kind == ASP:
            return [(start, names_in_rules(part)) for start, part in _paragraphs(self.text)]
        found = pieces(self.text)
        return [(each.start, names_of(self.kind, Piece(each.section, 0, each.text))) for each in found]

    @cached_property
    def _starts(self) -> list[int]:
        return [start for start, _ in self.pieces]

    @cached_property
    def line_starts(self) -> list[int]:
        """Where the lines of the text begin."""
        return [0, *(found.end() for found in re.finditer("\n", self.text))]

    def at(self, offset: int) -> tuple[Occurrence, int] | None:
        """What is named at a place, and the number of its piece. Between two names, the one before the place counts."""
        number = bisect_right(self._starts, offset) - 1
        if number < 0:
            return None
        start, names = self.pieces[number]
        inside = [each for each in names.occurrences if start + each.start <= offset <= start + each.end]
        if not inside:
            return None
        best = max(inside, key=lambda each: (offset < start + each.end, each.doing == "declared", -each.end))
        return best.moved(start), number

    def around(self, offset: int) -> Iterator[Occurrence]:
        """The names in the entry around a place; of an ASP file, in the statement."""
        number = bisect_right(self._starts, offset) - 1
        if number >= 0:
            start, names = self.pieces[number]
            before = [each for each in names.occurrences if start + each.start <= offset]
            scope = before[-1].scope if before else 0
            yield from (each.moved(start) for each in names.occurrences if each.scope == scope)

    def occurrences(self) -> Iterator[tuple[int, Occurrence]]:
        """Every name in the text, with the number of its piece."""
        for number, (start, names) in enumerate(self.pieces):
            for each in names.occurrences:
                yield number, each.moved(start)

    def named(self, name: str) -> Iterator[tuple[int, Occurrence]]:
        """Every place with this name or variable, with the number of its piece."""
        for number, (start, names) in enumerate(self.pieces):
            for each in names.occurrences:
                if each.name == name:
                    yield number, each.moved(start)

    def declared(self) -> Iterator[Declared]:
        """Everything that the text declares."""
        for start, names in self.pieces:
            for each in names.declared:
                yield each.moved(start)


def _paragraphs(text: str) -> Iterator[tuple[int, str]]:
    """An ASP text cut after lines that end with a full stop; whole if it has comments of several lines."""
    if "%*" in text:
        yield 0, text
        return
    start = 0
    for found in _STATEMENTS.finditer(text):
        code = found[0].partition("%")[0].rstrip()
        if code.endswith("."):
            yield start, text[start : found.end()]
            start = found.end()
    if start < len(text):
        yield start, text[start:]


@dataclass(frozen=True)
class Symbol:
    """What a name means: its space and the name; for a variable also the file, the piece and the statement it belongs to."""

    space: str
    name: str
    path: str = ""
    piece: int = 0
    scope: int = 0


_SPACES = {
    "predicate": ("predicate", "type"),
    "function": ("function", "predicate", "operator"),
    "object": ("object", "predicate", "operator", "type"),
    "operator": ("operator",),
}
"""For the space that a place suggests: the spaces in which the name is looked for, in this order."""


@dataclass(frozen=True)
class Index:
    """The names in all files of a domain. A file of a device is there once for each use of it, under its path and the use."""

    files: Mapping[str, FileIndex] = field(default_factory=dict)

    @cached_property
    def declarations(self) -> dict[tuple[str, str], list[tuple[FileIndex, Declared]]]:
        """Where each name of each space is declared."""
        found: dict[tuple[str, str], list[tuple[FileIndex, Declared]]] = {}
        for file in self.files.values():
            for each in file.declared():
                found.setdefault((each.space, each.name), []).append((file, each))
        return found

    def of_space(self, space: str) -> Iterator[Declared]:
        """The first declaration of each name of a space."""
        yield from (found[0][1] for (own, _), found in self.declarations.items() if own == space)

    def symbol(self, file: FileIndex, offset: int) -> tuple[Symbol, Occurrence] | None:
        """What is named at a place of a file, and where the name begins and ends."""
        found = file.at(offset)
        return None if found is None else (self.meaning(file, *found), found[0])

    def meaning(self, file: FileIndex, each: Occurrence, piece: int) -> Symbol:
        """What an occurrence names."""
        if each.space == "variable":
            return Symbol("variable", each.name, file.path, piece, each.scope)
        spaces = _SPACES.get(each.space, (each.space,))
        space = next((own for own in spaces if (own, each.name) in self.declarations), each.space)
        return Symbol(space, each.name)

    def uses(self, symbol: Symbol) -> Iterator[tuple[FileIndex, Occurrence]]:
        """Every place that names a symbol, declarations included."""
        files: Iterable[FileIndex] = self.files.values()
        if symbol.space == "variable":
            files = [file for file in files if file.path == symbol.path][:1]
        told: set[tuple[str, int, int]] = set()  # two uses of a device have the same places
        for file in files:
            for piece, each in file.named(symbol.name):
                place = file.path, each.start, each.end
                if place not in told and self.meaning(file, each, piece) == symbol:
                    told.add(place)
                    yield file, each

    def definitions(self, symbol: Symbol) -> list[tuple[FileIndex, Occurrence]]:
        """Where a symbol is declared, and the heads of the rules that define it; for a variable, its first place."""
        found = list(self.uses(symbol))
        if symbol.space == "variable":
            return found[:1]
        declared = [(file, each) for file, each in found if each.doing == "declared"]
        heads = [(file, each) for file, each in found if each.doing == "defined"]
        return [*declared, *heads]

    def is_a(self, type_: str, ancestor: str) -> bool:
        """Whether a type is another one or below it, as far as the declarations tell."""
        for _ in range(50):
            if type_ == ancestor or ancestor == "object":
                return True
            found = self.declarations.get(("type", type_))
            if not found or not found[0][1].of:
                return False
            type_ = found[0][1].of
        return False
