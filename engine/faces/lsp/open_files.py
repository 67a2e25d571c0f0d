"""The files an editor has open, the others as on disk, and positions in their text (UTF-16)."""

import contextlib
import os
import re
from bisect import bisect_right
from dataclasses import dataclass, field
from pathlib import Path

from lsprotocol import types
from pygls.uris import from_fs_path, to_fs_path

from cellwright.engine.authoring.editor_view import EditorFindings
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.editing.name_descriptions import DomainKnowledge
from cellwright.kb.editing.name_index import (
    DeviceIndex,
    FileIndex,
    NameIndex,
    devices_in_use,
    section_of_uses,
)
from cellwright.kb.files import read_file, read_unsaved
from cellwright.kb.loader import CELL_FILE, CONTACTS_FILE, DOMAIN_FILE, problem_files
from cellwright.kb.loader.domain_lookup import domain_called
from cellwright.kb.loader.fault_base import FAULTS_FILE
from cellwright.kb.targets import DEVICE_FILE

_END = re.compile(r"\r\n|\n|\r")


class TextLines:
    """The lines of a text, for places in it."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.starts = [0, *(line_end.end() for line_end in _END.finditer(text))]

    def offset(self, position: types.Position) -> int:
        """The place of a position; positions behind the end of a line or of the text mean that
        end.
        """
        if position.line >= len(self.starts):
            return len(self.text)
        start = self.starts[position.line]
        line = self._line(position.line)
        if line.isascii():
            return start + min(position.character, len(line))
        units = 0
        for number, character in enumerate(line):
            if units >= position.character:
                return start + number
            units += 2 if ord(character) > 0xFFFF else 1
        return start + len(line)

    def position(self, offset: int) -> types.Position:
        """The position of a place."""
        offset = min(max(offset, 0), len(self.text))
        line = bisect_right(self.starts, offset) - 1
        before = self.text[self.starts[line] : offset]
        character = (
            len(before)
            if before.isascii()
            else len(before.encode("utf-16-le", "surrogatepass")) // 2
        )
        return types.Position(line, character)

    def range(self, start: int, end: int) -> types.Range:
        """The range between two places."""
        return types.Range(self.position(start), self.position(end))

    def _line(self, number: int) -> str:
        end = self.starts[number + 1] if number + 1 < len(self.starts) else len(self.text)
        return self.text[self.starts[number] : end].rstrip("\r\n")


def apply_change(text: str, change: types.TextDocumentContentChangeEvent) -> str:
    """The text after a change."""
    if isinstance(change, types.TextDocumentContentChangePartial):
        lines = TextLines(text)
        start, end = lines.offset(change.range.start), lines.offset(change.range.end)
        return text[:start] + change.text + text[max(start, end) :]
    return change.text


FOLDERS_ABOVE = 3  # folders above a file in which the file of its domain is looked for
FILES_BESIDE_DOMAIN = (CELL_FILE, CONTACTS_FILE, FAULTS_FILE)


@dataclass(frozen=True, slots=True)
class Page:
    """A file and its lines."""

    file: FileIndex
    lines: TextLines


@dataclass(frozen=True, slots=True)
class IndexedPage(Page):
    """A file, its lines, and the index of all files that belong to it."""

    index: NameIndex


@dataclass
class OpenFiles:
    """All texts. Paths are absolute."""

    texts: dict[str, str] = field(default_factory=dict)  # of open files
    versions: dict[str, int] = field(default_factory=dict)
    uris: dict[str, str] = field(default_factory=dict)  # as the editor writes them
    seen: dict[str, EditorFindings] = field(default_factory=dict)  # by domain file
    _read: dict[str, tuple[tuple[int, int], FileIndex]] = field(default_factory=dict)
    _open: dict[str, FileIndex] = field(default_factory=dict)
    _lines: dict[str, TextLines] = field(default_factory=dict)
    _devices: dict[str, tuple[str, dict[str, FileIndex | None], tuple[DeviceIndex, ...]]] = field(
        default_factory=dict
    )
    _indexes: dict[str, tuple[tuple[int, ...], NameIndex]] = field(default_factory=dict)

    def open(self, document: types.TextDocumentItem) -> str:
        """Take a file as the editor has it. Returns its path."""
        path = path_of(document.uri)
        self.uris[path] = document.uri
        self._put(path, document.text, document.version)
        return path

    def change(self, parameters: types.DidChangeTextDocumentParams) -> str:
        """Change an open file. Returns its path."""
        path = path_of(parameters.text_document.uri)
        text = self.texts.get(path, "")
        for content_change in parameters.content_changes:
            text = apply_change(text, content_change)
        self._put(path, text, parameters.text_document.version)
        return path

    def close(self, uri: str) -> str:
        """Forget what the editor had. Returns the path."""
        path = path_of(uri)
        for by_path in (self.texts, self.versions, self._open, self._lines):
            by_path.pop(path, None)
        return path

    def _put(self, path: str, text: str, version: int) -> None:
        self.texts[path], self.versions[path] = text, version
        self._open[path] = FileIndex.of(path, text)
        self._lines.pop(path, None)

    def uri(self, path: str) -> str:
        """The address of a file, as the editor writes it."""
        return self.uris.get(path) or from_fs_path(path) or path

    def here(self, uri: str) -> IndexedPage | None:
        """A file with all that belongs to it; None if it cannot be read."""
        if (page := self.page(uri)) is None:
            return None
        index = self.index(page.file.path, page.file)
        file = next(
            index_file for index_file in index.files.values() if index_file.path == page.file.path
        )
        return IndexedPage(file, page.lines, index)

    def page(self, uri: str) -> Page | None:
        """A file alone; None if it cannot be read."""
        file = self.file(path_of(uri))
        return None if file is None else Page(file, self.lines(file))

    def file(self, path: str) -> FileIndex | None:
        """The index of one file; None if it cannot be read."""
        if path in self._open:
            return self._open[path]
        try:
            status = os.stat(path)
            mark = (status.st_mtime_ns, status.st_size)
            if path not in self._read or self._read[path][0] != mark:
                self._read[path] = mark, FileIndex.of(path, read_file(Path(path)).text)
            return self._read[path][1]
        except (OSError, ValueError, InvalidInput):
            return None

    def lines(self, file: FileIndex) -> TextLines:
        """The lines of a file."""
        if file.path not in self._lines or self._lines[file.path].text is not file.text:
            self._lines[file.path] = TextLines(file.text)
        return self._lines[file.path]

    def domain(self, path: str) -> str:
        """The file of the domain that a file belongs to; empty if there is none."""
        if os.path.basename(path) == DOMAIN_FILE:
            return path
        if _of_device(path):
            return self._user(path)
        for domain, seen in self.seen.items():
            if path in seen.read and not path.endswith((".yaml", ".yml")):
                return domain
        file = self.file(path)
        if file is None or file.kind != "problem":
            return _nearest_domain(path)
        with read_unsaved(self.texts):
            name = next(
                (
                    occurrence.name
                    for _, occurrence in file.occurrences()
                    if occurrence.space == "domain"
                ),
                "",
            )
            domain_path = domain_called(name, Path(path).parent) if name else None
        return os.path.abspath(domain_path) if domain_path is not None else _nearest_domain(path)

    def index(self, path: str, file: FileIndex) -> NameIndex:
        """The index of all files that belong to the domain of a file."""
        domain = self.domain(path)
        devices = self.devices(domain)
        folders = {os.path.dirname(device.path) for device in devices}
        together = (
            member for member in self._together(domain) if os.path.dirname(member) not in folders
        )
        files = {member: member_index for member in together if (member_index := self.file(member))}
        files |= {f"{device.path}#{device.use}": device for device in devices}
        if all(device.path != path for device in devices):
            files[path] = file
        marks = tuple(id(indexed_file) for indexed_file in files.values())
        if domain not in self._indexes or self._indexes[domain][0] != marks:
            self._indexes[domain] = marks, NameIndex(files)
        return self._indexes[domain][1]

    def devices(self, domain: str) -> tuple[DeviceIndex, ...]:
        """The files of the devices that a domain uses, as it fills them in."""
        if not domain or (file := self.file(domain)) is None:
            return ()
        section = section_of_uses(file.text)
        said, marks, device_files = self._devices.get(domain, ("", {}, ()))
        if section != said or any(self.file(path) is not mark for path, mark in marks.items()):
            with read_unsaved(self.texts) as read:
                device_files = tuple(devices_in_use(section, Path(domain)))
            self._devices[domain] = (
                section,
                {path: self.file(path) for path in read.read},
                device_files,
            )
        return device_files

    def _user(self, path: str) -> str:
        """The domain that uses the device that a file belongs to: an open one, else one near
        the file.
        """
        domains = dict.fromkeys(
            self.domain(text_path) for text_path in [*self.texts] if not _of_device(text_path)
        )
        users = (
            domain for domain in domains if any(path == used.path for used in self.devices(domain))
        )
        return next(users, _nearest_domain(path))

    def _together(self, domain: str) -> dict[str, None]:
        """The files of a domain: those that it includes, that were read with it, that lie
        beside it, and its problems.
        """
        if not domain:
            return {}
        folder = Path(domain).parent
        members: dict[str, None] = {domain: None}
        if (file := self.file(domain)) is not None:
            named = (
                occurrence.name
                for _, occurrence in file.occurrences()
                if occurrence.space == "file"
            )
            members |= dict.fromkeys(os.path.abspath(folder / included) for included in named)
        members |= dict.fromkeys(str(folder / name_beside) for name_beside in FILES_BESIDE_DOMAIN)
        with contextlib.suppress(InvalidInput):
            members |= dict.fromkeys(map(str, problem_files(Path(domain))))
        if domain in self.seen:
            members |= dict.fromkeys(self.seen[domain].read)
        return members

    def known(self, path: str) -> DomainKnowledge:
        """What the last reading of the domain of a file has told."""
        seen = self.seen.get(self.domain(path))
        return DomainKnowledge(seen.examples, seen.parameters) if seen else DomainKnowledge()


def path_of(uri: str) -> str:
    """The absolute path of a file."""
    return os.path.abspath(to_fs_path(uri) or uri)


def _of_device(path: str) -> bool:
    """Whether a file lies in the folder of a device."""
    return os.path.isfile(os.path.join(os.path.dirname(path), DEVICE_FILE))


def _nearest_domain(path: str) -> str:
    """The domain in the folder of a file, or in one above it; empty if there is none."""
    for folder in list(Path(path).parents)[:FOLDERS_ABOVE]:
        if (folder / DOMAIN_FILE).is_file():
            return str(folder / DOMAIN_FILE)
    return ""
