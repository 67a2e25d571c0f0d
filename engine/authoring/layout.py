"""Lays out the files of a domain: gives each its usual form, as kb.editing.file_layout says."""

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, order_diagnostics
from cellwright.kb.editing.file_layout import format_file
from cellwright.kb.files import is_folder, read_file

LAYOUT_SUFFIXES = (".yaml", ".yml", ".lp")


@dataclass(frozen=True, slots=True)
class ArrangedFiles:
    """The files whose form was changed (or would be), how many were looked at, and what is
    wrong in those that are broken.
    """

    changed: tuple[str, ...]
    looked_at: int
    broken: int
    findings: tuple[Diagnostic, ...] = ()


def arrange_files(paths: Iterable[Path], write: bool = True) -> ArrangedFiles:
    """Give files their usual form; of folders, each file with a suffix of the language. With
    `write` off, nothing is written.

    A file is written beside itself and then put in its place, so that it is never half there.
    """
    changed: list[str] = []
    diagnostics: list[Diagnostic] = []
    broken = 0
    files = list(dict.fromkeys(file for path in paths for file in _layout_files(path, diagnostics)))
    for path in files:
        try:
            text = read_file(path).text
            laid_out = format_file(str(path), text)
            if laid_out.encode() != path.read_bytes():
                changed.append(str(path))
                if write:
                    _replace_file(path, laid_out)
        except InvalidInput as error:
            broken += 1
            diagnostics += error.diagnostics
    return ArrangedFiles(tuple(changed), len(files), broken, order_diagnostics(diagnostics))


def _layout_files(path: Path, diagnostics: list[Diagnostic]) -> Iterator[Path]:
    if not is_folder(path):
        if path.suffix in LAYOUT_SUFFIXES or not path.exists():
            yield path
        else:
            hint = f"name files that end with {', '.join(LAYOUT_SUFFIXES)}"
            diagnostics.append(
                Diagnostic(Source(str(path)), "K413", "not a file of the domain language", hint)
            )
        return
    inside = sorted(
        inside_file
        for inside_file in path.rglob("*")
        if inside_file.suffix in LAYOUT_SUFFIXES and inside_file.is_file()
    )
    if not inside:
        message = f"no file in this folder ends with {', '.join(LAYOUT_SUFFIXES)}"
        diagnostics.append(
            Diagnostic(Source(str(path)), "K401", message, "name the folder of a domain")
        )
    yield from inside


def _replace_file(path: Path, text: str) -> None:
    """Write a file anew, with its permissions. A link stays a link."""
    path = path.resolve()
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        beside.write_text(text, "utf-8", newline="\n")
        beside.chmod(path.stat().st_mode & 0o7777)
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        why_not = f"cannot be written: {(error.strerror or str(error)).lower()}"
        raise InvalidInput(
            [Diagnostic(Source(str(path)), "K415", why_not, "look at its permissions")]
        ) from None
