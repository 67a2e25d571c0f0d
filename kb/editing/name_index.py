"""The index of the names in one file, in all files of a domain, and in its devices."""

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TypeVar

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.editing.name_occurrences import (
    NameDeclaration,
    Occurrence,
    PieceNames,
    names_in_rules,
    names_in_yaml,
)
from cellwright.kb.editing.scalar_roles import SHAPE_OF_KIND
from cellwright.kb.files import is_file
from cellwright.kb.loader.device_uses import DeviceUse
from cellwright.kb.loader.device_uses.device_files import FilledFile
from cellwright.kb.loader.device_uses.use_binding import readable_uses
from cellwright.kb.loader.fault_base import FAULTS_FILE
from cellwright.kb.loader.tolerant_yaml import YamlPiece, piece_tree, split_pieces
from cellwright.kb.loader.yaml_tree import YamlNode, child_at
from cellwright.kb.targets import DEVICE_FILE

ASP_KIND = "asp"
_ASP_STATEMENTS = re.compile(r"[^\n]*\.[ \t]*(?:%[^\n]*)?\n|[^\n]*\n|[^\n]+")
_KIND_KEY = re.compile(rf"^({'|'.join(SHAPE_OF_KIND)})[ \t]*:", re.MULTILINE)


def editor_file_kind(path: str, text: str) -> str:
    """The kind of a file: `asp`, or one of `cellwright.kb.editing.scalar_roles`.

    What cannot be told is a domain, or a part of one.
    """
    if not path.endswith((".yaml", ".yml")):
        return ASP_KIND
    kinds = {key_match[1] for key_match in _KIND_KEY.finditer(text)}
    others = [kind for kind in kinds if kind != "domain"]
    return others[0] if len(others) == 1 else "problem" if "problem" in kinds else "domain"


@dataclass(frozen=True)
class FileIndex:
    """The names in one text."""

    path: str
    text: str
    kind: str

    @staticmethod
    def of(path: str, text: str) -> "FileIndex":
        """The index of a text."""
        return FileIndex(path, text, editor_file_kind(path, text))

    @cached_property
    def pieces(self) -> list[tuple[int, PieceNames]]:
        """Where each piece of the text begins, and what names it holds."""
        if self.kind == ASP_KIND:
            return [(start, names_in_rules(part)) for start, part in _asp_paragraphs(self.text)]
        text_pieces = split_pieces(self.text)
        return [
            (piece.start, names_in_yaml(self.kind, YamlPiece(piece.section, 0, piece.text)))
            for piece in text_pieces
        ]

    @cached_property
    def _starts(self) -> list[int]:
        return [start for start, _ in self.pieces]

    @cached_property
    def line_starts(self) -> list[int]:
        """Where the lines of the text begin."""
        return [0, *(line_end.end() for line_end in re.finditer("\n", self.text))]

    def at(self, offset: int) -> tuple[Occurrence, int] | None:
        """What is named at a place, and the number of its piece.

        Between two names, the one before the place counts.
        """
        number = bisect_right(self._starts, offset) - 1
        if number < 0:
            return None
        start, names = self.pieces[number]
        inside = [
            occurrence
            for occurrence in names.occurrences
            if start + occurrence.start <= offset <= start + occurrence.end
        ]
        if not inside:
            return None
        best = max(
            inside,
            key=lambda occurrence: (
                offset < start + occurrence.end,
                occurrence.doing == "declared",
                -occurrence.end,
            ),
        )
        return best.moved(start), number

    def around(self, offset: int) -> Iterator[Occurrence]:
        """The names in the entry around a place; of an ASP file, in the statement."""
        number = bisect_right(self._starts, offset) - 1
        if number >= 0:
            start, names = self.pieces[number]
            before = [
                occurrence for occurrence in names.occurrences if start + occurrence.start <= offset
            ]
            scope = before[-1].scope if before else 0
            yield from (
                occurrence.moved(start)
                for occurrence in names.occurrences
                if occurrence.scope == scope
            )

    def occurrences(self) -> Iterator[tuple[int, Occurrence]]:
        """Every name in the text, with the number of its piece."""
        for number, (start, names) in enumerate(self.pieces):
            for occurrence in names.occurrences:
                yield number, occurrence.moved(start)

    def named(self, name: str) -> Iterator[tuple[int, Occurrence]]:
        """Every place with this name or variable, with the number of its piece."""
        for number, (start, names) in enumerate(self.pieces):
            for occurrence in names.occurrences:
                if occurrence.name == name:
                    yield number, occurrence.moved(start)

    def declared(self) -> Iterator[NameDeclaration]:
        """Everything that the text declares."""
        for start, names in self.pieces:
            for declared in names.declared:
                yield declared.moved(start)


def _asp_paragraphs(text: str) -> Iterator[tuple[int, str]]:
    """An ASP text cut after lines that end with a full stop; whole if it has comments of
    several lines.
    """
    if "%*" in text:
        yield 0, text
        return
    start = 0
    for statement in _ASP_STATEMENTS.finditer(text):
        code = statement[0].partition("%")[0].rstrip()
        if code.endswith("."):
            yield start, text[start : statement.end()]
            start = statement.end()
    if start < len(text):
        yield start, text[start:]


@dataclass(frozen=True)
class Symbol:
    """What a name means: its space and the name; for a variable also the file, the piece and
    the statement it belongs to.
    """

    space: str
    name: str
    path: str = ""
    piece: int = 0
    scope: int = 0


_OCCURRENCE_SPACES = {
    "predicate": ("predicate", "type"),
    "function": ("function", "predicate", "operator"),
    "object": ("object", "predicate", "operator", "type"),
    "operator": ("operator",),
    "event": ("predicate", "operator"),  # of a window of time
    "worker": ("operator", "object", "function"),  # of a calendar
}
"""For the space that a place suggests: the spaces in which the name is looked for, in this
order.
"""


@dataclass(frozen=True)
class NameIndex:
    """The names in all files of a domain.

    A file of a device is there once for each use of it, under its path and the use.
    """

    files: Mapping[str, FileIndex] = field(default_factory=dict)

    @cached_property
    def declarations(self) -> dict[tuple[str, str], list[tuple[FileIndex, NameDeclaration]]]:
        """Where each name of each space is declared."""
        declarations: dict[tuple[str, str], list[tuple[FileIndex, NameDeclaration]]] = {}
        for file in self.files.values():
            for declared in file.declared():
                declarations.setdefault((declared.space, declared.name), []).append(
                    (file, declared)
                )
        return declarations

    def of_space(self, space: str) -> Iterator[NameDeclaration]:
        """The first declaration of each name of a space."""
        yield from (
            declared_places[0][1]
            for (own, _), declared_places in self.declarations.items()
            if own == space
        )

    def symbol(self, file: FileIndex, offset: int) -> tuple[Symbol, Occurrence] | None:
        """What is named at a place of a file, and where the name begins and ends."""
        place_found = file.at(offset)
        return None if place_found is None else (self.meaning(file, *place_found), place_found[0])

    def meaning(self, file: FileIndex, occurrence: Occurrence, piece: int) -> Symbol:
        """What an occurrence names."""
        if occurrence.space == "variable":
            return Symbol("variable", occurrence.name, file.path, piece, occurrence.scope)
        spaces = _OCCURRENCE_SPACES.get(occurrence.space, (occurrence.space,))
        space = next(
            (own for own in spaces if (own, occurrence.name) in self.declarations), occurrence.space
        )
        return Symbol(space, occurrence.name)

    def uses(self, symbol: Symbol) -> Iterator[tuple[FileIndex, Occurrence]]:
        """Every place that names a symbol, declarations included."""
        files: Iterable[FileIndex] = self.files.values()
        if symbol.space == "variable":
            files = [file for file in files if file.path == symbol.path][:1]
        uses_seen: set[tuple[str, int, int]] = set()  # two uses of a device have the same places
        for file in files:
            for piece, occurrence in file.named(symbol.name):
                place = file.path, occurrence.start, occurrence.end
                if place not in uses_seen and self.meaning(file, occurrence, piece) == symbol:
                    uses_seen.add(place)
                    yield file, occurrence

    def definitions(self, symbol: Symbol) -> list[tuple[FileIndex, Occurrence]]:
        """Where a symbol is declared, and the heads of the rules that define it; for a
        variable, its first place.
        """
        uses = list(self.uses(symbol))
        if symbol.space == "variable":
            return uses[:1]
        declared = [
            (file, occurrence) for file, occurrence in uses if occurrence.doing == "declared"
        ]
        heads = [(file, occurrence) for file, occurrence in uses if occurrence.doing == "defined"]
        return [*declared, *heads]

    def is_a(self, type_: str, ancestor: str) -> bool:
        """Whether a type is another one or below it, as far as the declarations tell."""
        for _ in range(50):
            if type_ == ancestor or ancestor == "object":
                return True
            declared = self.declarations.get(("type", type_))
            if not declared or not declared[0][1].of:
                return False
            type_ = declared[0][1].of
        return False


Part = TypeVar("Part", Occurrence, NameDeclaration)
_USE_SECTION = re.compile(r"^use[ \t]*:[^\n]*\n?(?:[ \t#\r][^\n]*\n?|\n)*", re.MULTILINE)


@dataclass(frozen=True)
class DeviceIndex(FileIndex):
    """The names in a file of a device, as one use fills them in.

    Places are those of the file as it was written.
    """

    use: str
    device: str
    about: str
    filled: FilledFile

    @cached_property
    def pieces(self) -> list[tuple[int, PieceNames]]:
        """Where each piece begins, and what names it holds."""
        whole = FileIndex(self.path, self.filled.text, self.kind).pieces
        return [
            *self._title(),
            *((self._place(start), self._names(start, names)) for start, names in whole),
        ]

    def _title(self) -> Iterator[tuple[int, PieceNames]]:
        """The device itself, and the use, where the device says its name."""
        title = re.search(rf"^device[ \t]*:[ \t]*({self.device})", self.text, re.MULTILINE)
        if title and self.kind == "device":
            start, end = title.span(1)
            names = dict.fromkeys((self.device, self.use))
            places = tuple(
                Occurrence("device", name, start, end, "declared", ranged=True) for name in names
            )
            declared = tuple(
                NameDeclaration("device", name, "device", start, end, of=self.about)
                for name in names
            )
            yield 0, PieceNames(places, declared)

    def _names(self, start: int, names: PieceNames) -> PieceNames:
        base = self._place(start)
        return PieceNames(
            tuple(self._moved(occurrence, start, base) for occurrence in names.occurrences),
            tuple(self._moved(declared, start, base) for declared in names.declared),
        )

    def _moved(self, part: Part, start: int, base: int) -> Part:
        begin, end = self._place(start + part.start), self._place(start + part.end)
        return part._replace(start=begin - base, end=end - base)

    def _place(self, index: int) -> int:
        return self.filled.as_written(index)


def section_of_uses(text: str) -> str:
    """The part of the text of a domain that says which devices it uses."""
    section = _USE_SECTION.search(text)
    return section[0] if section else ""


def devices_in_use(section: str, domain: Path) -> Iterator[DeviceIndex]:
    """The files of all devices that such a part uses in a domain file: device, rules, faults."""
    entries: dict[str, tuple[YamlNode, YamlNode]] = {}
    for piece in split_pieces(section):
        root = piece_tree(piece.text)
        if piece.section and (root is None or isinstance(root.value, str)):
            # its parameters are being written
            root = piece_tree(piece.text.partition(":")[0] + ": {}\n")
        node = root if piece.section or root is None else child_at(root, "use")
        if node is not None and isinstance(node.value, dict):
            entries |= node.value
    for use in readable_uses(entries, domain):
        with suppress(InvalidInput):
            yield from _device_files(use)


def _device_files(use: DeviceUse) -> Iterator[DeviceIndex]:
    """The files of a device.

    Faults of a use under another name have other names, and are left out.
    """
    own = use.read(DEVICE_FILE)
    yield (first := _device_index(use, own))
    names = dict.fromkeys(
        occurrence.name for _, occurrence in first.occurrences() if occurrence.space == "file"
    )
    faults = [FAULTS_FILE] if use.name == use.device.name else []
    for name in (*names, *faults):
        if is_file(use.device.folder / name):
            with suppress(InvalidInput):
                yield _device_index(use, use.read(name))


def _device_index(use: DeviceUse, filled: FilledFile) -> DeviceIndex:
    text = filled.written.text
    kind = editor_file_kind(filled.path, text)
    path = str(use.device.folder.absolute() / Path(filled.path).name)
    return DeviceIndex(path, text, kind, use.name, use.device.name, use.device.about, filled)
