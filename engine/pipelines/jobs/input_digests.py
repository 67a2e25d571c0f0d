"""Digests of all that a result depends on: files, the domain around them, the program."""

import contextlib
import hashlib
import os
import platform
import stat
from collections.abc import Iterator
from functools import cache, lru_cache
from pathlib import Path

from cellwright.kb import loader
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

UNREAD_FOLDERS = ("problems", "golden")  # folders of a domain that no problem depends on
MOST_FILES, MOST_BYTES = 5_000, 2**26  # beyond that a file counts by its name, size and time


def content_digest(target: Path, *more: object) -> str:
    """A digest of a problem or a domain: its file, the files of its domain's folder, the
    program, and what `more` tells.
    """
    digest = hashlib.sha256(repr((program_digest(), more)).encode())
    _digest_file(digest, target)
    with_domain = _domain_folder(target)
    if with_domain is not None:
        digest.update(_folder_digest(str(with_domain.parent.resolve())).encode())
    return digest.hexdigest()


@cache
def program_digest() -> str:
    """A digest of the modules of this program, compiled ones aside: the same in all processes
    that compute the same.
    """
    root = Path(__file__).parents[3]
    digest = hashlib.sha256()
    for folder in ("kb", "engine"):
        for file in sorted((root / folder).rglob("*.py")):
            digest.update(f"{file.relative_to(root)}\0".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:32]


def _domain_folder(target: Path) -> Path | None:
    try:
        return loader.domain_of(str(target))
    except InvalidInput:  # whoever reads the file says what is wrong
        return None


def require_same(target: Path, own: str) -> None:
    """See whether a worker has the files that the command had. Raises `InvalidInput`."""
    if content_digest(target) != own:
        reason = (
            f"{platform.node()} has other files here than the command had, or they were edited "
            "since"
        )
        hint = "share the folder with all workers, or start again"
        raise InvalidInput([Diagnostic(Source(str(target)), "K430", reason, hint)])


def shared_store(store: str) -> str:
    """The name of a store for workers in other folders."""
    return store if "://" in store else str(Path(store).expanduser().absolute())


def _folder_digest(folder: str) -> str:
    """A digest of the files of a domain's folder."""
    return _contents_digest(folder, tuple(_file_stamps(folder)))


def _file_stamps(folder: str) -> Iterator[tuple[str, int, int]]:
    """Names, sizes and times of the files of a folder: as long as they are the same, their
    content is not read again.
    """
    for file in _content_files(Path(folder)):
        with contextlib.suppress(OSError):
            status = file.stat()
            yield str(file), status.st_size, status.st_mtime_ns


@lru_cache(maxsize=256)
def _contents_digest(folder: str, _stamps: tuple[tuple[str, int, int], ...]) -> str:
    digest = hashlib.sha256()
    for file in _content_files(Path(folder)):
        digest.update(f"{file.relative_to(folder)}\0".encode("utf-8", "surrogateescape"))
        _digest_file(digest, file)
    return digest.hexdigest()


def _content_files(folder: Path) -> Iterator[Path]:
    count = 0
    for path, folders, files in os.walk(folder):
        folders[:] = sorted(
            folder
            for folder in folders
            if folder not in UNREAD_FOLDERS and not folder.startswith((".", "_"))
        )
        for name in sorted(file for file in files if not file.startswith(".")):
            count += 1
            if count > MOST_FILES:
                return
            yield Path(path, name)


def _digest_file(digest: "hashlib._Hash", file: Path) -> None:
    """Add a file to a digest."""
    try:
        status = file.stat()
        whole = stat.S_ISREG(status.st_mode) and status.st_size <= MOST_BYTES
        digest.update(
            file.read_bytes() if whole else repr((status.st_size, status.st_mtime_ns)).encode()
        )
    except OSError as error:
        digest.update(repr(error.errno).encode())
