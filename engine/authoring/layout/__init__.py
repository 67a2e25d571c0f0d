"""Gives the files of a domain their usual form, one after another. `cellwright.kb.editing.layout` says what that is."""

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, in_order
from cellwright.kb.editing.layout import formatted
from cellwright.kb.files import is_folder, read_file

SUFFIXES = (".yaml", ".yml", ".lp")


@dataclass(frozen=True, slots=True)
class Arranged:
    """The files whose form was changed (or would be), how many were looked at, and what is wrong in those that are broken."""

    changed: tuple[str, ...]
    looked_at: int
    broken: int
    findings: tuple[Diagnostic, ...] = ()


def arrange(paths: Iterable[Path], write: bool = True) -> Arranged:
    """Give files their usual form; of folders, each file with a suffix of the language. With `write` off, nothing is written.

    A file is written beside itself and then put in its place, so that it is never half there.
    """
    changed: list[str] = []
    found: list[Diagnostic] = []
    broken = 0
    files = list(dict.fromkeys(each for path in paths for each in _files(path, found)))
    for path in files:
        try:
            text = read_file(path).text
            made = formatted(str(path), text)
            if made.encode() != path.read_bytes():
                changed.append(str(path))
                if write:
                    _replace(path, made)
        except InvalidInput as error:
            broken += 1
            found += error.diagnostics
    return Arranged(tuple(changed), len(files), broken, in_order(found))


def _files(path: Path, found: list[Diagnostic]) -> Iterator[Path]:
    if not is_folder(path):
        if path.suffix in SUFFIXES or not path.exists():
            yield path
        else:
            hint = f"name files that end with {', '.join(SUFFIXES)}"
            found.append(Diagnostic(Source(str(path)), "K413", "not a file of the domain language", hint))
        return
    inside = sorted(each for each in path.rglob("*") if each.suffix in SUFFIXES and each.is_file())
    if not inside:
        message = f"no file in this folder ends with {', '.join(SUFFIXES)}"
        found.append(Diagnostic(Source(str(path)), "K401", message, "name the folder of a domain"))
    yield from inside


def _replace(path: Path, text: str) -> None:
    """Write a file anew, with its permissions. A link stays a link."""
    path = path.resolve()
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        beside.write_text(text, "utf-8", newline="\n")
        beside.chmod(path.stat().st_mode & 0o7777)
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        said = f"cannot be written: {(error.strerror or str(error)).lower()}"
        raise InvalidInput([Diagnostic(Source(str(path)), "K415", said, "look at its permissions")]) from None
