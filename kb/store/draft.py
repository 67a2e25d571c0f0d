"""A library whose changes wait in memory until they are written all together: in one transaction, with the note that they are made.

Who is killed before has written nothing, and who is killed after has written all. So work that is done again after a kill counts once.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

from sqlalchemy import Connection, select

from cellwright.kb.store.counts import add_trials, add_uses
from cellwright.kb.store.documents import dumps
from cellwright.kb.store.engines import transaction
from cellwright.kb.store.library import Library, removed
from cellwright.kb.store.outlines import chunks
from cellwright.kb.store.records import Record, Stored, Use
from cellwright.kb.store.schema import fingerprint, macrops
from cellwright.kb.store.utilities import Figures, Utility, add_figures

FIRST = 2**31  # the first number of a MACROP that is not written: above all numbers that a database gives
NO_USE = Use(0, 0.0)


class Draft(Library):
    """A library as one who changes it sees it: what is stored, and the changes. Nobody else sees them before `write`.

    A new MACROP has a number above all stored ones until it is written; `numbers` then gives its number in the library.
    """

    def __init__(self, target: str) -> None:
        super().__init__(target)
        self.numbers: dict[int, int] = {}
        self._new: dict[int, tuple[Record, str]] = {}
        self._gone: set[int] = set()
        self._uses: dict[int, Use] = {}
        self._trials: Counter[tuple[str, str, bool]] = Counter()
        self._utilities: dict[tuple[int, str], Utility] = {}
        self._next = FIRST

    def settled(self, number: int | None) -> int | None:
        """The number of a MACROP in the library; None for one that was not written."""
        return number if number is None or number < FIRST else self.numbers.get(number)

    def add(self, records: Iterable[Record]) -> list[int | None]:
        """See `Library`."""
        return [self._added(each, dumps(each.macrop)) for each in records]

    def _added(self, record: Record, text: str) -> int | None:
        if any(text == other for _, other in self._new.values()) or self._is_stored(text):
            return None
        self._next += 1
        self._new[self._next] = record, text
        return self._next

    def _is_stored(self, text: str) -> bool:
        with transaction(self._engine, self.target) as connection:
            return bool(_stored(connection, [text]))

    def serving(self, domain: str, signature: str) -> list[Stored]:
        """See `Library`."""
        stored = [each for each in super().serving(domain, signature) if each.id not in self._gone]
        new = [
            Stored(number, record.macrop, signature, planning_s=record.planning_s)
            for number, (record, _) in self._new.items()
            if (record.macrop.domain, record.signature) == (domain, signature)
        ]
        return [self._used(each) for each in (*stored, *new)]

    def _used(self, each: Stored) -> Stored:
        more = self._uses.get(each.id, NO_USE)
        return replace(each, uses=each.uses + more.times, lookup_s=each.lookup_s + more.lookup_s)

    def forget(self, numbers: Collection[int]) -> int:
        """See `Library`."""
        for number in numbers:
            if self._new.pop(number, None) is None:
                self._gone.add(number)
        return len(numbers)

    def note_uses(self, uses: Mapping[int, Use]) -> None:
        """See `Library`."""
        for number, more in uses.items():
            before = self._uses.get(number, NO_USE)
            self._uses[number] = Use(before.times + more.times, before.lookup_s + more.lookup_s)

    def trials(self, domain: str, signature: str) -> tuple[int, int]:
        """See `Library`."""
        successes, failures = super().trials(domain, signature)
        return successes + self._trials[domain, signature, True], failures + self._trials[
            domain, signature, False
        ]

    def note_trial(self, domain: str, signature: str, success: bool) -> None:
        """See `Library`."""
        self._trials[domain, signature, success] += 1

    def utilities(self, domain: str = "") -> dict[tuple[int, str], Utility]:
        """See `Library`. Those of other domains are not asked of a draft."""
        found = super().utilities(domain)
        for key, more in self._utilities.items():
            found[key] = found.get(key, Utility()) + more
        return found

    def note_utilities(self, more: Figures) -> None:
        """See `Library`."""
        for key, each in more.items():
            self._utilities[key] = self._utilities.get(key, Utility()) + each

    def write(self, connection: Connection) -> None:
        """Write all changes in a transaction. A MACROP that another process has stored meanwhile counts for this one."""
        self._shared.forget()
        made = self._stored_by(connection, list(self._new.values()))
        others = _stored(
            connection, (t for n, (_, t) in zip(made, self._new.values(), strict=True) if n is None)
        )
        self.numbers = {
            own: number if number is not None else others[text]
            for number, (own, (_, text)) in zip(made, self._new.items(), strict=True)
        }
        add_uses(connection, self._by_number(self._uses))
        for domain, signature in sorted({key[:2] for key in self._trials}):
            counts = (self._trials[domain, signature, success] for success in (True, False))
            add_trials(connection, domain, signature, *counts)
        figures = {(self.settled(n), search): each for (n, search), each in self._utilities.items()}
        add_figures(connection, {(n, search): each for (n, search), each in figures.items() if n is not None})
        removed(connection, self._gone)

    def _by_number(self, uses: Mapping[int, Use]) -> dict[int, Use]:
        found = {self.settled(number): use for number, use in uses.items()}
        return {number: use for number, use in found.items() if number is not None}


def _stored(connection: Connection, texts: Iterable[str]) -> dict[str, int]:
    """The numbers of those MACROPs, given by their documents, that are stored."""
    digests = {fingerprint(text): text for text in texts}
    found: dict[str, int] = {}
    for chunk in chunks(sorted(digests)):
        asked = select(macrops.c.fingerprint, macrops.c.id).where(macrops.c.fingerprint.in_(chunk))
        found.update((digests[digest], number) for digest, number in connection.execute(asked))
    return found
