"""Libraries that stay open, for a process that plans again and again: its lookups find in memory what they have read before.

A process that plans once opens its library, asks, and closes it. From its second problem for a library and a domain on, all stays:
the connection, the outlines, the MACROPs, and the evaluated facts of the last cells. After each problem it reads as many MACROPs ahead
as it has read so far. So reading ahead takes no longer than what it is for, and nobody waits for it all.

What is kept is no copy of the truth: each problem begins with the question whether it is still true, new MACROPs are fetched by lookups,
and a library is begun anew if one of its MACROPs was removed, if its file is another one, or after any error. All that a problem changes
is written before its turn ends.
"""

import contextlib
import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from cellwright.engine.pipelines.reuse.practice import Cells, Practice
from cellwright.engine.stages.macros.lookup.repertoire import AHEAD, Repertoire
from cellwright.engine.stages.planning import Limits
from cellwright.kb.cycles import search_now
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.amounts import version_of_cell
from cellwright.kb.model.domain import Domain
from cellwright.kb.store import Library
from cellwright.kb.store.opening import note_opened

MOST = 4  # libraries and domains that a thread keeps
LARGEST = 20_000  # MACROPs of a domain; above that its outlines are not kept
FIRST = 8  # MACROPs that are read ahead at first
CELLS = 2  # cells whose evaluated facts are kept with a library


@dataclass(frozen=True, slots=True)
class _Standing:
    """A library that stays open, with what is known of a domain, and of its cells as long as the file of places has its `version`.

    `known` says what the library held, see `Library.holdings`.
    """

    store: str
    file: tuple[int, int] | None
    library: Library
    repertoire: Repertoire
    known: tuple[int, int, str]
    cells: Cells | None = None
    version: tuple[Path, int, int] | None = None

    def serves(self, store: str, domain: Domain) -> bool:
        """Whether it is the library of a store for a domain."""
        own = self.repertoire.domain
        return self.store == store and (own is domain or own == domain)

    def is_true(self) -> bool:
        """Whether all that was known is still there."""
        held = self.library.holdings(self.repertoire.domain.name, self.known[1])
        return self.file == _identity(self.store) and held == self.known


@dataclass
class _Kept(threading.local):
    """What a thread keeps: the latest last. `asked` are the stores for which it has planned once."""

    standing: list[_Standing] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)


_KEPT = _Kept()
_INHERITED: list[list[_Standing]] = []  # connections of a parent process: never used, never closed


def _begin_apart() -> None:
    _INHERITED.append(_KEPT.standing)
    _KEPT.standing = []


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_apart)


@contextlib.contextmanager
def standing(store: str, domain: Domain, limits: Limits) -> Iterator[Practice]:
    """A library in use for one problem of a domain; it stays open if the process has asked before. Raises `InvalidInput`."""
    own, version = _taken(store, domain), version_of_cell(domain)
    cells = own.cells if own and own.cells and own.version == version else Cells(CELLS)
    with contextlib.ExitStack() as closing:
        library = closing.enter_context(own.library if own else Library(store, beside=True))
        note_opened(store)
        with Practice(library, limits, cells=cells) as practice:
            repertoire = practice.repertoire(domain, own.repertoire if own else None)
            yield practice
        if store not in _KEPT.asked:
            _KEPT.asked = [*_KEPT.asked[1 - MOST :], store]
        elif library.writable and not (library.loss or store.startswith("sqlite:")):
            with contextlib.suppress(
                InvalidInput
            ):  # the answer is there; next time the library is opened anew
                known = own or _begun(store, library, repertoire.domain)
                if _kept(replace(known, cells=cells, version=version)):
                    closing.pop_all()


def close_standing() -> None:
    """Close the libraries that this thread keeps open, and forget that it asked."""
    for each in _KEPT.standing:
        each.library.close()
    _KEPT.standing, _KEPT.asked = [], []


def _taken(store: str, domain: Domain) -> _Standing | None:
    """The library that stays open for a domain, if what it knows is still true; nobody else has it meanwhile."""
    found = next((each for each in _KEPT.standing if each.serves(store, domain)), None)
    if found is None:
        return None
    _KEPT.standing = [each for each in _KEPT.standing if each is not found]
    with contextlib.ExitStack() as closing:
        closing.callback(found.library.close)
        with contextlib.suppress(InvalidInput):  # who opens it anew hears why
            if found.is_true():
                closing.pop_all()
                return found
    return None


def _begun(store: str, library: Library, domain: Domain) -> _Standing:
    """A library with the outlines as they are now: those that a problem has used may have been removed since."""
    file, known = _identity(store), library.holdings(domain.name)
    repertoire = Repertoire(library, domain)
    if known[0] <= LARGEST:
        repertoire.load()
    return _Standing(store, file, library, repertoire, known)


def _kept(own: _Standing) -> bool:
    """Keep a library open, with more MACROPs read; whether it is kept."""
    repertoire = own.repertoire
    if repertoire.newest > own.known[1]:
        held = own.library.holdings(repertoire.domain.name)
        if not own.is_true():
            return False
        own = replace(own, known=held)
    if own.known[0] > LARGEST or repertoire.read > 2 * AHEAD:
        return False
    if repertoire.read_ahead(min(max(FIRST, repertoire.read), AHEAD - min(AHEAD, repertoire.read))):
        search_now()
    _KEPT.standing.append(own)
    while len(_KEPT.standing) > MOST:
        _KEPT.standing.pop(0).library.close()
    return True


def _identity(store: str) -> tuple[int, int] | None:
    """Which file a store is, whatever its name; None for a server or no file."""
    try:
        said = None if "://" in store else Path(store).expanduser().stat()
    except (OSError, RuntimeError, ValueError):
        return None
    return (said.st_dev, said.st_ino) if said else None
