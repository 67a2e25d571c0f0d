"""Repertoire: the MACROPs of a library for one domain in its present form.

They are fetched by goal signature, at the first query with that signature. Stale ones are left out.
"""

import itertools
import time
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import replace
from functools import partial

from cellwright.engine.stages.lifted.domain_digests import DomainDigests
from cellwright.engine.stages.macros.lookup.macro_index import (
    IndexEntry,
    MacroIndex,
    macro_rank,
    macro_requirements,
)
from cellwright.engine.stages.macros.lookup.macro_lookup import LookupHit, look_up
from cellwright.engine.stages.macros.lookup.macro_query import (
    MacroQuery,
    query_variants,
    signature_asked,
    signature_of,
)
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.plan_model import Macrop
from cellwright.kb.store import Library, Outline, Record, Use

USES_BEFORE_FLUSH = 1024  # uses that are noted in memory before they are written to the library
DOUBT_S = 1.0
MAX_READ_AHEAD = 2_000  # MACROPs; each takes about 35 kB of memory


class Repertoire:
    """The MACROPs of a library that serve one domain.

    Other processes may write to the library. So if nothing is found, the library is read again.
    What a lookup takes is counted in seconds of the processor, as planning is: a busy machine or
    database makes no MACROP worse.
    """

    def __init__(
        self, library: Library, domain: Domain, clock: Callable[[], float] = time.process_time
    ) -> None:
        self.library, self.domain = library, domain
        self._clock = clock
        self._digests = DomainDigests(domain)
        self._index = MacroIndex()
        self._seen: dict[str, int] = {}
        self._fresh: dict[int, bool] = {}
        self._unread: dict[int, IndexEntry] = {}
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
        for outline in self._whole(self.library.outlines(self.domain.name)):
            self._seen[outline.signature] = max(self._seen.get(outline.signature, 0), outline.id)
            self._put(outline)

    def read_ahead(self, most: int = MAX_READ_AHEAD) -> int:
        """Read the MACROPs that were fetched, at most so many, and prepare them. Returns how many
        were read.

        For programs that look up for a long time, before somebody waits for them: their lookups ask
        the library less often.
        """
        first = dict(itertools.islice(self._unread.items(), most))
        self._ahead = {record.id: record.macrop for record in self.library.among(first)}
        for entry in first.values():
            if entry.program is not None:
                entry.program.prepare()
        self._ahead.clear()
        return len(first)

    def find(self, asked: MacroQuery) -> LookupHit | None:
        """A checked plan from the library, also from MACROPs that other processes have added since.

        The key of a hit is the number of its MACROP.
        """
        self._since = self._clock()
        fetched: set[str] = set()
        hit = self._first(query_variants(asked), fetched) or self._first(
            self._renewed(asked, fetched), fetched
        )
        if hit is not None:
            self._note(hit.key, 1)
        return hit

    def has(self, asked: MacroQuery) -> bool:
        """Whether there is a MACROP for goals of this kind."""
        return self._index.has(signature_asked(asked))

    def _first(self, ways: Iterable[MacroQuery], fetched: set[str]) -> LookupHit | None:
        """The first hit for readings of a query; adds the signatures that were fetched, each at
        its first query.
        """
        for variant in ways:
            signature = signature_asked(variant)
            if signature not in self._seen:
                self._fetch(signature)
                fetched.add(signature)
            hit = look_up(self._index, variant, in_vain=self._in_vain)
            if hit is not None:
                return hit
        return None

    def _renewed(self, asked: MacroQuery, fetched: set[str]) -> Iterator[MacroQuery]:
        """The readings of a query for which the library has new MACROPs since they were fetched."""
        for reading in query_variants(asked):
            signature = signature_asked(reading)
            if signature not in fetched and self._fetch(signature):
                yield reading

    def _in_vain(self, entry: IndexEntry) -> None:
        self._note(entry.key, 0)

    def learn(self, macrop: Macrop, planning_s: float = 0.0) -> int | None:
        """Store a MACROP. Returns its number, or None if the library already has it."""
        record = macro_record(macrop, planning_s)
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
        """Fetch the MACROPs of a signature that are new in the library.

        Returns whether there are any.
        """
        outlines = self.library.outlines(self.domain.name, signature, self._seen.get(signature, 0))
        self._seen[signature] = outlines[-1].id if outlines else self._seen.get(signature, 0)
        for outline in self._whole(outlines):
            self._put(outline)
        return bool(outlines)

    def _whole(self, outlines: list[Outline]) -> Iterator[Outline]:
        """The outlines, all with requirements.

        Older versions stored outlines without requirements. These are computed now and written to
        the library. Sub-sequences have no requirements and are left out, because searches use them
        as operators.
        """
        bare = [outline.id for outline in outlines if outline.requirements is None]
        read = {record.id: record.macrop for record in self.library.among(bare)}
        macrops = {number: macrop for number, macrop in read.items() if not macrop.subsequence}
        worked_out = {number: macro_requirements(macrop) for number, macrop in macrops.items()}
        if worked_out:
            self.library.note_outlines(
                [(macrops[number], number, own) for number, own in worked_out.items()]
            )
        for outline in outlines:
            if outline.requirements is not None:
                yield outline
            elif outline.id in macrops:
                yield replace(
                    outline, cost=macrops[outline.id].cost, requirements=worked_out[outline.id]
                )

    def _put(self, outline: Outline) -> None:
        if outline.proof not in self._fresh:
            self._fresh[outline.proof] = self._digests.fresh(outline.depends)
        if outline.id not in self._index and pays_off(outline) and self._fresh[outline.proof]:
            order = macro_rank(outline.id, outline.name, outline.cost, outline.steps)
            entry = self._unread[outline.id] = IndexEntry(
                outline.id, order, partial(self._macrop, outline.id)
            )
            self._index.put(outline.signature, entry, outline.requirements or ())
            self.newest = max(self.newest, outline.id)

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
        if self._noted >= USES_BEFORE_FLUSH:
            self.flush()


def macro_record(macrop: Macrop, planning_s: float = 0.0) -> Record:
    """The record of a MACROP for the library."""
    return Record(macrop, signature_of(macrop), planning_s, macro_requirements(macrop))


def pays_off(outline: Outline) -> bool:
    """Whether a MACROP is still offered: its lookups have not cost much more time than it saved.

    The utility of a MACROP is measured (Minton 1988): the seconds of planning that it saved, less
    the seconds of lookup, both of the processor. It may fall below zero by the time of one
    planning, or by `DOUBT_S` if that is longer.
    """
    return outline.saved_s > -max(outline.planning_s, DOUBT_S)
