"""Reads files with care: regular ones of limited size, in UTF-8, or an editor's unsaved text."""

import bisect
import os
import re
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint

MAX_FILE_BYTES = 64 * 2**20  # of a file that people write, or that an import writes for them
MAX_EXCERPT_CHARACTERS = 160  # characters of a line shown in a message
ASCII = "[^\t\n\r\x20-\x7e]"
UNICODE = "[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]"


@dataclass
class UnsavedTexts:
    """Texts that are read in place of files, as an editor holds them unsaved; and the files that
    were read, in order.

    Both go by absolute paths.
    """

    unsaved: Mapping[str, str] = field(default_factory=dict)
    read: dict[str, None] = field(default_factory=dict)

    def text(self, path: Path) -> str | None:
        """The text that stands for a file, or None."""
        return self.unsaved.get(os.path.abspath(path))


_desk: ContextVar[UnsavedTexts | None] = ContextVar("desk", default=None)


@contextmanager
def read_unsaved(unsaved: Mapping[str, str]) -> Iterator[UnsavedTexts]:
    """A context in which these texts are read in place of the files at their absolute paths.

    It notes what is read.
    """
    desk = UnsavedTexts(unsaved)
    before = _desk.set(desk)
    try:
        yield desk
    finally:
        _desk.reset(before)


@dataclass(frozen=True, slots=True)
class File:
    """The text of a file and the starts of its lines, which are needed for places in it."""

    path: str
    text: str
    line_starts: tuple[int, ...]

    @classmethod
    def of(cls, path: str, text: str) -> "File":
        """A file with this text."""
        return cls(path, text, (0, *(newline.end() for newline in re.finditer("\n", text))))

    def beside(self, path: Path) -> "File":
        """Another file that belongs to this one.

        Raises `InvalidInput` if it cannot be read as text.
        """
        return read_file(path)

    def user(self) -> Source | None:
        """The place where the device is used that the file belongs to; None for a file of the
        domain itself.
        """
        return None

    def at(self, index: int) -> Source:
        """The place of a character. It takes the same time for lines of any length."""
        line = bisect.bisect_right(self.line_starts, index)
        start = self.line_starts[line - 1]
        end = self.text.find("\n", index, index + MAX_EXCERPT_CHARACTERS)
        end = end if end >= 0 else min(index + MAX_EXCERPT_CHARACTERS, len(self.text))
        first = (
            max(start, index - MAX_EXCERPT_CHARACTERS)
            if end - start > MAX_EXCERPT_CHARACTERS
            else start
        )
        return Source(
            self.path, line, index - start + 1, self.text[first:end].rstrip("\r"), first - start
        )

    def line(self, number: int, column: int) -> Source:
        """The place of a column of a line, both counted from 1.

        If there is no such line, the place is the file.
        """
        if not 1 <= number <= len(self.line_starts):
            return Source(self.path)
        return self.at(min(self.line_starts[number - 1] + max(column - 1, 0), len(self.text)))


def find_unprintable(text: str) -> re.Match[str] | None:
    """The first character that is not allowed.

    Most texts are ASCII, for which a small pattern is enough.
    """
    return re.search(ASCII if text.isascii() else UNICODE, text)


def similar_file_hint(path: Path) -> str:
    """The hint for a file that is not there: one beside it whose name is like it; empty if
    there is none.
    """
    try:
        names = [entry.name for entry in os.scandir(path.parent) if entry.name[:1] != "."]
    except (OSError, ValueError):
        return ""
    hint = nearest_hint(path.name, names)
    return (
        hint.replace("did you mean '", f"did you mean '{path.parent}{os.sep}")
        if hint and path.parent != Path()
        else hint
    )


def read_file(path: Path, name: str | None = None, most: int = MAX_FILE_BYTES) -> File:
    """The text of `path`, of at most so many bytes.

    Raises `InvalidInput` if it cannot be read as text.
    """
    name = name or str(path)
    data = read_bytes(path, name, most)
    try:
        file = File.of(name, data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        readable = File.of(name, data[: error.start].decode("utf-8", "replace"))
        where = readable.at(len(readable.text))
        hint = "save the file as UTF-8"
        if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
            hint += "; this looks like UTF-16"
        raise InvalidInput(
            [Diagnostic(where, "K001", f"not UTF-8: byte {data[error.start]:#04x}", hint)]
        ) from None
    if control := find_unprintable(file.text):
        message = f"the control character U+{ord(control[0]):04X} is not allowed in a text"
        raise InvalidInput([Diagnostic(file.at(control.start()), "K001", message, "remove it")])
    return file


def read_bytes(path: Path, name: str, most: int = MAX_FILE_BYTES) -> bytes:
    """The bytes of a regular file of at most so many. Raises `InvalidInput`."""
    if (unsaved := _editor_text(path, noted=True)) is not None:
        if len(unsaved) > most:
            raise InvalidInput([_too_large(name, most)])
        return unsaved
    try:
        status = path.stat()
        if stat.S_ISREG(status.st_mode) and status.st_size <= most:
            with path.open("rb") as file:
                data = file.read(most + 1)  # files under /proc report a size of 0
            if len(data) <= most:
                return data
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        hint = similar_file_hint(path) if isinstance(error, FileNotFoundError) else ""
        raise InvalidInput(
            [Diagnostic(Source(name), "K001", f"cannot be read: {reason.lower()}", hint)]
        ) from None
    if stat.S_ISDIR(status.st_mode):
        diagnostic = Diagnostic(
            Source(name), "K001", "this is a folder, not a file", "name a file in it"
        )
    elif not stat.S_ISREG(status.st_mode):
        diagnostic = Diagnostic(
            Source(name), "K001", "not a regular file", "pipes and devices are not read"
        )
    else:
        diagnostic = _too_large(name, most)
    raise InvalidInput([diagnostic])


def foreign_bytes(path: Path, code: str, what: str, most: int) -> bytes:
    """`read_bytes` of a file in a format of others, such as a mesh.

    Its findings have the code of that format's reader.
    """
    try:
        return read_bytes(path, str(path), most)
    except InvalidInput as error:
        diagnostic = error.diagnostics[0]
        reason = diagnostic.message.removeprefix("cannot be read: ")
        hint = (
            "take a smaller file"
            if diagnostic.code == "K007"
            else diagnostic.hint or "is it a file that can be read?"
        )
        raise InvalidInput(
            [Diagnostic(diagnostic.where, code, f"{what} cannot be read: {reason}", hint)]
        ) from None


def _too_large(name: str, most: int) -> Diagnostic:
    hint = "split the problem, or generate facts with rules"
    return Diagnostic(Source(name), "K007", f"larger than {most // 2**20} MiB", hint)


def _editor_text(path: Path, noted: bool = False) -> bytes | None:
    """What an editor holds for a file, as bytes; None if it does not. With `noted`, the file
    counts as read.
    """
    if (desk := _desk.get()) is None:
        return None
    if noted:
        desk.read[os.path.abspath(path)] = None
    text = desk.text(path)
    return None if text is None else text.encode("utf-8", "surrogatepass")


def first_bytes(path: Path, most: int) -> bytes:
    """The first bytes of a file; empty if it cannot be read."""
    if (unsaved := _editor_text(path)) is not None:
        return unsaved[:most]
    if not is_file(path):
        return b""
    try:
        with path.open("rb") as file:
            return file.read(most)
    except OSError:
        return b""


def is_file(path: Path) -> bool:
    """Whether there is a regular file of this name. For an impossible name, the answer is no."""
    if _editor_text(path) is not None:
        return True
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_there(path: Path) -> bool:
    """Whether anything has this name: a file, a folder, a device, or a link to nothing."""
    if _editor_text(path) is not None:
        return True
    try:
        path.lstat()
    except (OSError, ValueError) as error:
        return isinstance(error, PermissionError)
    return True


def path_below(folder: Path, name: str) -> Path | None:
    """The path of a name below a folder; None if the name leads out of it, also through links.

    The path is the folder's, with the name as it is written.
    """
    try:
        inside = (folder / name).resolve().is_relative_to(folder.resolve())
    except (
        OSError,
        RuntimeError,
        ValueError,
    ):  # a name that is too long, links in a circle: there is no such file
        return folder / name
    return folder / name if inside and not Path(name).is_absolute() else None


def is_folder(path: Path) -> bool:
    """Whether there is a folder of this name."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False
