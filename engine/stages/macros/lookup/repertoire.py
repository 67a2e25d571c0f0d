"""The MACROPs of a library for one domain in its present form.

They are fetched by goal signature, at the first query with that signature. Stale ones are left out.
"""

import itertools
import time
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import replace
from functools import partial

from cellwright.engine.stages.macros.lifted.digests import Digests
from cellwright.engine.stages.macros.lookup.features import requirements
from cellwright.engine.stages.macros.lookup.index import Entry, Index, rank
from cellwright.engine.stages.macros.lookup.lookup import Hit, look_up
from cellwright.engine.stages.macros.lookup.query import Query, readings, signature_asked, signature_of
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.macro import Macrop
from cellwright.kb.store import Library, Outline, Record, Use

FLUSH = 1024  # uses that are noted in memory before they are written to the library
DOUBT_S = 1.0
AHEAD = 2_000  # MACROPs; each takes about 35 kB of memory


class Repertoire:
    """The MACROPs of a library that serve one domain.

    Other processes may write to the library. So if nothing is found, the library is read again. What a lookup takes is counted in
    seconds of the processor, as planning is: a busy machine or database makes no MACROP worse.
    """

    def __init__(
        self, library: Library, domain: Domain, clock: Callable[[], float] = time.process_time
    ) -> None:
        self.library, self.domain = library, domain
        self._clock = clock
        self._digests = Digests(domain)
        self._index = Index()
        self._seen: dict[str, int] = {}
        self._fresh: dict[int, bool] = {}
        self._unread: dict[int, Entry] = {}
        self._ahead: dict[int, Macrop] = {}
        self._uses: dict[int, Use] = {}
        self._noted = 0
        self._since = clock()
        self.newest = 0
        """The greatest number of a MACROP that was fetched or learned."""

    def __len__(self) -> int:
        return len(self._index)

    def of_domain(self, domain: Domain) -> "Repertoire":
        """This repertoire for a domain that equals its own, which was read again."""
        assert self.domain == domain
        self.domain = domain
        return self

    @property
    def read(self) -> int:
        """How many MACROPs are in memory, not their outlines alone."""
        return len(self._index) - len(self._unread)

    def load(self) -> None:
        """Fetch the MACROPs of all signatures now."""
        for each in self._whole(self.library.outlines(self.domain.name)):
            self._seen[each.signature] = max(self._seen.get(each.signature, 0), each.id)
            self._put(each)

    def read_ahead(self, most: int = AHEAD) -> int:
        """Read the MACROPs that were fetched, at most so many, and prepare them. Returns how many were read.

        For programs that look up for a long time, before somebody waits for them: their lookups ask the library less often.
        """
        first = dict(itertools.islice(self._unread.items(), most))
        self._ahead = {each.id: each.macrop for each in self.library.among(first)}
        for entry in first.values():
            if entry.program is not None:
                entry.program.prepare()
        self._ahead.clear()
        return len(first)

    def find(self, asked: Query) -> Hit | None:
        """A checked plan from the library, also from MACROPs that other processes have added since.

        The key of a hit is the number of its MACROP.
        """
        self._since = self._clock()
        fetched: set[str] = set()
        hit = self._first(readings(asked), fetched) or self._first(self._renewed(asked, fetched), fetched)
        if hit is not None:
            self._note(hit.key, 1)
        return hit

    def _first(self, ways: Iterable[Query], fetched: set[str]) -> Hit | None:
        """The first hit for readings of a query; adds the signatures that were fetched, each at its first query."""
        for each in ways:
            signature = signature_asked(each)
            if signature not in self._seen:
                self._fetch(signature)
                fetched.add(signature)
            hit = look_up(self._index, each, in_vain=self._in_vain)
            if hit is not None:
                return hit
        return None

    def _renewed(self, asked: Query, fetched: set[str]) -> Iterator[Query]:
        """The readings of a query for which the library has new MACROPs since they were fetched."""
        for each in readings(asked):
            signature = signature_asked(each)
            if signature not in fetched and self._fetch(signature):
                yield each

    def _in_vain(self, entry: Entry) -> None:
        self._note(entry.key, 0)

    def learn(self, macrop: Macrop, planning_s: float = 0.0) -> int | None:
        """Store a MACROP. Returns its number, or None if the library already has it."""
        record = record_of(macrop, planning_s)
        signature = record.signature
        if signature not in self._seen:
            self._fetch(signature)
        (number,) = self.library.add([record])
        if number is not None:
            self._index.add(number, macrop)
            self.newest = max(self.newest, number)
        else:
            self._seen[signature] = 0  # another process was quicker: fetch its MACROPs
        return number

    def outdated(self) -> dict[int, tuple[str, ...]]:
        """The stale MACROPs in the library, with the parts of the domain that have changed."""
        return self.library.outdated(self.domain.name, self._digests.of)

    def forget(self, numbers: Iterable[int]) -> int:
        """Remove MACROPs here and in the library. Returns how many the library had."""
        gone = list(numbers)
        for number in gone:
            self._index.remove(number)
            self._unread.pop(number, None)
        return self.library.forget(gone)

    def flush(self) -> None:
        """Write to the library how often its MACROPs were used."""
        if self._uses:
            self.library.note_uses(self._uses)
            self._uses.clear()
            self._noted = 0

    def _fetch(self, signature: str) -> bool:
        """Fetch the MACROPs of a signature that are new in the library. Returns whether there are any."""
        found = self.library.outlines(self.domain.name, signature, self._seen.get(signature, 0))
        self._seen[signature] = found[-1].id if found else self._seen.get(signature, 0)
        for each in self._whole(found):
            self._put(each)
        return bool(found)

    def _whole(self, found: list[Outline]) -> Iterator[Outline]:
        """The outlines, all with requirements.

        Older versions stored outlines without requirements. These are computed now and written to the
        library. Sub-sequences have no requirements and are left out, because searches use them as operators.
        """
        bare = [each.id for each in found if each.requirements is None]
        read = {each.id: each.macrop for each in self.library.among(bare)}
        macrops = {number: macrop for number, macrop in read.items() if not macrop.subsequence}
        worked_out = {number: requirements(macrop) for number, macrop in macrops.items()}
        if worked_out:
            self.library.note_outlines([(macrops[number], number, own) for number, own in worked_out.items()])
        for each in found:
            if each.requirements is not None:
                yield each
            elif each.id in macrops:
                yield replace(each, cost=macrops[each.id].cost, requirements=worked_out[each.id])

    def _put(self, each: Outline) -> None:
        if each.proof not in self._fresh:
            self._fresh[each.proof] = self._digests.fresh(each.depends)
        if each.id not in self._index and pays(each) and self._fresh[each.proof]:
            order = rank(each.id, each.name, each.cost, each.steps)
            entry = self._unread[each.id] = Entry(each.id, order, partial(self._macrop, each.id))
            self._index.put(each.signature, entry, each.requirements or ())
            self.newest = max(self.newest, each.id)

    def _macrop(self, number: int) -> Macrop | None:
        self._unread.pop(number, None)
        return self._ahead.pop(number, None) or self.library.macrop(number)

    def _note(self, key: Hashable, times: int) -> None:
        """Note a use of a MACROP, and the time since the last use was noted."""
        assert isinstance(key, int)
        now = self._clock()
        before = self._uses.get(key, Use(0, 0.0))
        self._uses[key] = Use(before.times + times, before.lookup_s + now - self._since)
        self._since = now
        self._noted += 1
        if self._noted >= FLUSH:
            self.flush()


def record_of(macrop: Macrop, planning_s: float = 0.0) -> Record:
    """The record of a MACROP for the library."""
    return Record(macrop, signature_of(macrop), planning_s, requirements(macrop))


def pays(each: Outline) -> bool:
    """Whether a MACROP is still offered: its lookups have not cost much more time than it saved.

    The utility of a MACROP is measured (Minton 1988): the seconds of planning that it saved, less the seconds
    of lookup, both of the processor. It may fall below zero by the time of one planning, or by `DOUBT_S` if that is longer.
    """
    return each.saved_s > -max(each.planning_s, DOUBT_S)
