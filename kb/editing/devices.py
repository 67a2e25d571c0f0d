"""The names that a domain has from the devices that it uses, each at its place in the file of the device as it was written.

The text of the domain may be broken: a use that cannot be read is left out, the others are there.
"""

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.editing.index import FileIndex, kind_of
from cellwright.kb.editing.occurrences import Declared, Names, Occurrence
from cellwright.kb.files import is_file
from cellwright.kb.loader.faults import FAULTS_FILE
from cellwright.kb.loader.node import Node
from cellwright.kb.loader.quantities import child
from cellwright.kb.loader.tolerant import pieces, tree_of
from cellwright.kb.loader.uses import Use
from cellwright.kb.loader.uses.binding import readable_uses
from cellwright.kb.loader.uses.filling import Filled
from cellwright.kb.targets import DEVICE_FILE

Part = TypeVar("Part", Occurrence, Declared)
_SECTION = re.compile(r"^use[ \t]*:[^\n]*\n?(?:[ \t#\r][^\n]*\n?|\n)*", re.MULTILINE)


@dataclass(frozen=True)
class DeviceIndex(FileIndex):
    """The names in a file of a device, as one use fills them in. Places are those of the file as it was written."""

    use: str
    device: str
    about: str
    filled: Filled

    @cached_property
    def pieces(self) -> list[tuple[int, Names]]:
        """Where each piece begins, and what names it holds."""
        whole = FileIndex(self.path, self.filled.text, self.kind).pieces
        return [*self._title(), *((self._place(start), self._names(start, names)) for start, names in whole)]

    def _title(self) -> Iterator[tuple[int, Names]]:
        """The device itself, and the use, where the device says its name."""
        found = re.search(rf"^device[ \t]*:[ \t]*({self.device})", self.text, re.MULTILINE)
        if found and self.kind == "device":
            start, end = found.span(1)
            names = dict.fromkeys((self.device, self.use))
            places = tuple(Occurrence("device", name, start, end, "declared", ranged=True) for name in names)
            declared = tuple(Declared("device", name, "device", start, end, of=self.about) for name in names)
            yield 0, Names(places, declared)

    def _names(self, start: int, names: Names) -> Names:
        base = self._place(start)
        return Names(
            tuple(self._moved(each, start, base) for each in names.occurrences),
            tuple(self._moved(each, start, base) for each in names.declared),
        )

    def _moved(self, each: Part, start: int, base: int) -> Part:
        begin, end = self._place(start + each.start), self._place(start + each.end)
        return each._replace(start=begin - base, end=end - base)

    def _place(self, index: int) -> int:
        return self.filled.as_written(index)


def section_of_uses(text: str) -> str:
    """The part of the text of a domain that says which devices it uses."""
    found = _SECTION.search(text)
    return found[0] if found else ""


def devices_in_use(section: str, domain: Path) -> Iterator[DeviceIndex]:
    """The files of all devices that such a part uses in a domain file: device, rules, faults."""
    entries: dict[str, tuple[Node, Node]] = {}
    for piece in pieces(section):
        root = tree_of(piece.text)
        if piece.section and (root is None or isinstance(root.value, str)):
            root = tree_of(piece.text.partition(":")[0] + ": {}\n")  # its parameters are being written
        node = root if piece.section or root is None else child(root, "use")
        if node is not None and isinstance(node.value, dict):
            entries |= node.value
    for use in readable_uses(entries, domain):
        with suppress(InvalidInput):
            yield from _files(use)


def _files(use: Use) -> Iterator[DeviceIndex]:
    """The files of a device. Faults of a use under another name have other names, and are left out."""
    own = use.read(DEVICE_FILE)
    yield (first := _index(use, own))
    names = dict.fromkeys(each.name for _, each in first.occurrences() if each.space == "file")
    faults = [FAULTS_FILE] if use.name == use.device.name else []
    for name in (*names, *faults):
        if is_file(use.device.folder / name):
            with suppress(InvalidInput):
                yield _index(use, use.read(name))


def _index(use: Use, filled: Filled) -> DeviceIndex:
    text = filled.written.text
    kind = kind_of(filled.path, text)
    path = str(use.device.folder.absolute() / Path(filled.path).name)
    return DeviceIndex(path, text, kind, use.name, use.device.name, use.device.about, filled)
