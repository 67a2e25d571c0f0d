"""The files that an editor works on: open ones as the editor has them, others as they are on the disk, and which belong together."""

import contextlib
import os
import re
from dataclasses import dataclass, field
from pathlib import Path

from lsprotocol import types
from pygls.uris import from_fs_path, to_fs_path

from engine.faces.lsp.positions import Lines, changed
from engine.pipelines.editing import Seen
from kb.diagnostics import InvalidInput
from kb.editing.describing import Known
from kb.editing.index import FileIndex, Index
from kb.files import read_file, reading
from kb.loader import CELL_FILE, CONTACTS_FILE, DOMAIN_FILE, domain_of, problem_files
from kb.loader.faults import FAULTS_FILE

UP = 3  # folders above a file in which the file of its domain is looked for
BESIDE = (CELL_FILE, CONTACTS_FILE, FAULTS_FILE)
_DOMAIN_LINE = re.compile(r"^(?:domain|problem)[ \t]*:.*$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Here:
    """A file, its lines, and the index of all files that belong to it."""

    file: FileIndex
    lines: Lines
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
    _domains: dict[str, tuple[tuple[str, ...], str]] = field(default_factory=dict)
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
        path = path_of(uri)
        file = self.file(path)
        if file is None:
            return None
        return Here(file, self.lines(file), self.index(path, file))

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
        for domain, seen in self.seen.items():
            if path in seen.read and not path.endswith((".yaml", ".yml")):
                return domain
        said = (*self._heads(path), *self._heads(_near(path)))
        if path in self._domains and self._domains[path][0] == said:
            return self._domains[path][1]
        file = self.file(path)
        try:
            if file is None or file.kind != "problem":
                return _near(path)
            with reading(self.texts):
                found = os.path.abspath(domain_of(path))
        except InvalidInput:
            return _near(path)  # until the loader can tell
        self._domains[path] = said, found
        return found

    def _heads(self, path: str) -> tuple[str, ...]:
        """The lines with which a file names itself and its domain."""
        file = self.file(path) if path else None
        return tuple(_DOMAIN_LINE.findall(file.text)) if file is not None else ()

    def index(self, path: str, file: FileIndex) -> Index:
        """The index of all files that belong to the domain of a file."""
        domain = self.domain(path)
        files = {each: found for each in self._together(domain) if (found := self.file(each))}
        files[path] = file
        marks = tuple(id(each) for each in files.values())
        if domain not in self._indexes or self._indexes[domain][0] != marks:
            self._indexes[domain] = marks, Index(files)
        return self._indexes[domain][1]

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


def _near(path: str) -> str:
    """The domain in the folder of a file, or in one above it; empty if there is none."""
    for folder in list(Path(path).parents)[:UP]:
        if (folder / DOMAIN_FILE).is_file():
            return str(folder / DOMAIN_FILE)
    return ""
