"""The index of a library: MACROPs by goal signature, then by what they require.

Each requirement has the set of the MACROPs that demand it, as the bits of one number. A query evaluates a
requirement once for all these MACROPs. If the query does not meet it, the set is removed from the candidates
(inverted files; Zobel and Moffat 2006). Only the MACROPs that remain are read and matched.
"""

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from functools import cached_property

from cellwright.engine.stages.macros.lookup.features import Observed, Profiles, requirements
from cellwright.engine.stages.macros.lookup.program import Program
from cellwright.engine.stages.macros.lookup.query import Query, signature_asked, signature_of
from cellwright.kb.model.macro import Macrop
from cellwright.kb.store.notation import Requirement

UNKNOWN_COST = 1 << 62

Rank = tuple[int, int, str, str]


@dataclass(frozen=True)
class Entry:
    """A MACROP of the index under the key of its library.

    Entries are tried in the order of `rank`, cheap ones first. This order is the same every time.
    """

    key: Hashable
    rank: Rank
    read: Callable[[], Macrop | None] = field(compare=False)

    @property
    def cost(self) -> int | None:
        """What every instance costs; None if that depends on the binding."""
        return None if self.rank[0] == UNKNOWN_COST else self.rank[0]

    @cached_property
    def macrop(self) -> Macrop | None:
        """The MACROP, read at the first use; None if it was removed since then."""
        return self.read()

    @cached_property
    def program(self) -> Program | None:
        """The order in which its parts are matched."""
        return Program(self.macrop) if self.macrop is not None else None


def rank(key: Hashable, name: str, cost: int | None, steps: int) -> Rank:
    """The sort key of a MACROP among those that fit: cost, then number of steps, then header and key."""
    return UNKNOWN_COST if cost is None else cost, steps, name, str(key)


class _Shelf:
    """The MACROPs of one signature, one bit each."""

    def __init__(self) -> None:
        self.entries: list[Entry | None] = []
        self.present = 0
        self.requiring: dict[str, dict[int, int]] = {}
        self.order: list[str] = []

    def add(self, entry: Entry, required: Iterable[Requirement]) -> int:
        place = len(self.entries)
        bit = 1 << place
        self.entries.append(entry)
        self.present |= bit
        for feature, least in required:
            sets = self.requiring.get(feature)
            if sets is None:
                sets = self.requiring[feature] = {}
                self.order.clear()
            sets[least] = sets.get(least, 0) | bit
        return place

    def remove(self, place: int) -> None:
        self.entries[place] = None
        self.present &= ~(1 << place)

    def fitting(self, observed: Observed) -> list[Entry]:
        """The entries whose requirements are met. A requirement that no remaining entry has is skipped."""
        if not self.order:
            # features without a goal come first: each costs a single test
            self.order = sorted(self.requiring, key=lambda text: not text.startswith("state\n\n"))
        left = self.present
        for text in self.order:
            sets = self.requiring[text]
            if any(left & those for those in sets.values()):
                count = observed.count(text)
                for least, those in sets.items():
                    if count < least:
                        left &= ~those
        return [entry for place in _bits(left) if (entry := self.entries[place]) is not None]


def _bits(number: int) -> Iterable[int]:
    while number:
        lowest = number & -number
        yield lowest.bit_length() - 1
        number ^= lowest


class Index:
    """The MACROPs that lookup can use. The caller chooses the keys."""

    def __init__(self) -> None:
        self._shelves: dict[str, _Shelf] = {}
        self._places: dict[Hashable, tuple[_Shelf, int]] = {}
        self._profiles = Profiles()

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, key: Hashable) -> bool:
        return key in self._places

    def add(self, key: Hashable, macrop: Macrop) -> None:
        """Add a MACROP. It replaces one with the same key."""
        order = rank(key, str(macrop.name), macrop.cost, len(macrop.steps))
        self.put(signature_of(macrop), Entry(key, order, lambda: macrop), requirements(macrop))

    def put(self, signature: str, entry: Entry, required: Iterable[Requirement]) -> None:
        """Add an entry with its requirements. Its MACROP need not have been read yet."""
        self.remove(entry.key)
        shelf = self._shelves.setdefault(signature, _Shelf())
        self._places[entry.key] = shelf, shelf.add(entry, required)

    def remove(self, key: Hashable) -> None:
        """Remove a MACROP, if the index has it."""
        found = self._places.pop(key, None)
        if found is not None:
            shelf, place = found
            shelf.remove(place)

    def candidates(self, asked: Query) -> list[Entry]:
        """The MACROPs for the query's goals that have all requirements met, the cheapest first."""
        shelf = self._shelves.get(signature_asked(asked))
        if shelf is None:
            return []
        return sorted(shelf.fitting(Observed(asked, self._profiles)), key=lambda entry: entry.rank)
