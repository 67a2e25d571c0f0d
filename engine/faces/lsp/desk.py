"""The files that an editor works on: open ones as the editor has them, others as they are on the disk, and which belong together."""

import contextlib
import os
from dataclasses import dataclass, field
from pathlib import Path

from lsprotocol import types
from pygls.uris import from_fs_path, to_fs_path

from cellwright.engine.faces.lsp.positions import Lines, changed
from cellwright.engine.pipelines.editing import Seen
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.editing.describing import Known
from cellwright.kb.editing.devices import DeviceIndex, devices_in_use, section_of_uses
from cellwright.kb.editing.index import FileIndex, Index
from cellwright.kb.files import read_file, reading
from cellwright.kb.loader import CELL_FILE, CONTACTS_FILE, DOMAIN_FILE, problem_files
from cellwright.kb.loader.faults import FAULTS_FILE
from cellwright.kb.loader.references import domain_called
from cellwright.kb.targets import DEVICE_FILE

UP = 3  # folders above a file in which the file of its domain is looked for
BESIDE = (CELL_FILE, CONTACTS_FILE, FAULTS_FILE)


@dataclass(frozen=True, slots=True)
class Page:
    """A file and its lines."""

    file: FileIndex
    lines: Lines


@dataclass(frozen=True, slots=True)
class Here(Page):
    """A file, its lines, and the index of all files that belong to it."""

    index: Index


@dataclass
class Desk:
    """All texts. Paths are absolute."""

    texts: dict[str, str] = field(default_factory=dict)  # of open files
    versions: dict[str, int] = field(default_factory=dict)
    uris: dict[str, str] = field(default_factory=dict)  # as the editor writes them
    seen: dict[str, Seen] = field(default_factory=dict)  # by domain file
    _read: dict[str, tuple[tuple[int, int], FileIndex]] = field(default_factory=dict)
    _open: dict[str, FileIndex] = field(default_factory=dict)
    _lines: dict[str, Lines] = field(default_factory=dict)
    _devices: dict[str, tuple[str, dict[str, FileIndex | None], tuple[DeviceIndex, ...]]] = field(
        default_factory=dict
    )
    _indexes: dict[str, tuple[tuple[int, ...], Index]] = field(default_factory=dict)

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
        for each in parameters.content_changes:
            text = changed(text, each)
        self._put(path, text, parameters.text_document.version)
        return path

    def close(self, uri: str) -> str:
        """Forget what the editor had. Returns the path."""
        path = path_of(uri)
        for each in (self.texts, self.versions, self._open, self._lines):
            each.pop(path, None)
        return path

    def _put(self, path: str, text: str, version: int) -> None:
        self.texts[path], self.versions[path] = text, version
        self._open[path] = FileIndex.of(path, text)
        self._lines.pop(path, None)

    def uri(self, path: str) -> str:
        """The address of a file, as the editor writes it."""
        return self.uris.get(path) or from_fs_path(path) or path

    def here(self, uri: str) -> Here | None:
        """A file with all that belongs to it; None if it cannot be read."""
        if (page := self.page(uri)) is None:
            return None
        index = self.index(page.file.path, page.file)
        file = next(each for each in index.files.values() if each.path == page.file.path)
        return Here(file, page.lines, index)

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

    def lines(self, file: FileIndex) -> Lines:
        """The lines of a file."""
        if file.path not in self._lines or self._lines[file.path].text is not file.text:
            self._lines[file.path] = Lines(file.text)
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
            return _near(path)
        with reading(self.texts):
            name = next((each.name for _, each in file.occurrences() if each.space == "domain"), "")
            found = domain_called(name, Path(path).parent) if name else None
        return os.path.abspath(found) if found is not None else _near(path)

    def index(self, path: str, file: FileIndex) -> Index:
        """The index of all files that belong to the domain of a file."""
        domain = self.domain(path)
        devices = self.devices(domain)
        folders = {os.path.dirname(each.path) for each in devices}
        together = (each for each in self._together(domain) if os.path.dirname(each) not in folders)
        files = {each: found for each in together if (found := self.file(each))}
        files |= {f"{each.path}#{each.use}": each for each in devices}
        if all(each.path != path for each in devices):
            files[path] = file
        marks = tuple(id(each) for each in files.values())
        if domain not in self._indexes or self._indexes[domain][0] != marks:
            self._indexes[domain] = marks, Index(files)
        return self._indexes[domain][1]

    def devices(self, domain: str) -> tuple[DeviceIndex, ...]:
        """The files of the devices that a domain uses, as it fills them in."""
        if not domain or (file := self.file(domain)) is None:
            return ()
        section = section_of_uses(file.text)
        said, marks, found = self._devices.get(domain, ("", {}, ()))
        if section != said or any(self.file(path) is not mark for path, mark in marks.items()):
            with reading(self.texts) as read:
                found = tuple(devices_in_use(section, Path(domain)))
            self._devices[domain] = section, {path: self.file(path) for path in read.read}, found
        return found

    def _user(self, path: str) -> str:
        """The domain that uses the device that a file belongs to: an open one, else one near the file."""
        domains = dict.fromkeys(self.domain(each) for each in [*self.texts] if not _of_device(each))
        users = (each for each in domains if any(path == used.path for used in self.devices(each)))
        return next(users, _near(path))

    def _together(self, domain: str) -> dict[str, None]:
        """The files of a domain: those that it includes, that were read with it, that lie beside it, and its problems."""
        if not domain:
            return {}
        folder = Path(domain).parent
        found: dict[str, None] = {domain: None}
        if (file := self.file(domain)) is not None:
            named = (each.name for _, each in file.occurrences() if each.space == "file")
            found |= dict.fromkeys(os.path.abspath(folder / each) for each in named)
        found |= dict.fromkeys(str(folder / each) for each in BESIDE)
        with contextlib.suppress(InvalidInput):
            found |= dict.fromkeys(map(str, problem_files(Path(domain))))
        if domain in self.seen:
            found |= dict.fromkeys(self.seen[domain].read)
        return found

    def known(self, path: str) -> Known:
        """What the last reading of the domain of a file has told."""
        seen = self.seen.get(self.domain(path))
        return Known(seen.examples, seen.parameters) if seen else Known()


def path_of(uri: str) -> str:
    """The absolute path of a file."""
    return os.path.abspath(to_fs_path(uri) or uri)


def _of_device(path: str) -> bool:
    """Whether a file lies in the folder of a device."""
    return os.path.isfile(os.path.join(os.path.dirname(path), DEVICE_FILE))


def _near(path: str) -> str:
    """The domain in the folder of a file, or in one above it; empty if there is none."""
    for folder in list(Path(path).parents)[:UP]:
        if (folder / DOMAIN_FILE).is_file():
            return str(folder / DOMAIN_FILE)
    return ""
