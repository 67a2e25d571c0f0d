"""The index of a library: MACROPs by goal signature, then by what they require.

Each requirement has the set of MACROPs that have it, as the bits of one number. A query evaluates every requirement once, for
however many MACROPs share it, and takes away the sets of those that it does not meet (inverted files; Zobel and Moffat
2006). MACROPs are read and matched only when they are left.
"""

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from functools import cached_property

from engine.stages.macros.lookup.features import Observed, Profiles, requirements
from engine.stages.macros.lookup.program import Program
from engine.stages.macros.lookup.query import Query, signature_asked, signature_of
from kb.model.macro import Macrop
from kb.store import Requirement

UNKNOWN_COST = 1 << 62

Rank = tuple[int, int, str, str]


@dataclass(frozen=True)
class Entry:
    """A MACROP of the index under the key of its library. Cheap ones are tried first; `rank` is an order that repeats."""

    key: Hashable
    rank: Rank
    read: Callable[[], Macrop | None] = field(compare=False)

    @property
    def cost(self) -> int | None:
        """What every instance costs; None if that depends on the binding."""
        return None if self.rank[0] == UNKNOWN_COST else self.rank[0]

    @cached_property
    def macrop(self) -> Macrop | None:
        """The MACROP, read when first asked for; None if it has gone meanwhile."""
        return self.read()

    @cached_property
    def program(self) -> Program | None:
        """The order in which its parts are matched."""
        return Program(self.macrop) if self.macrop is not None else None


def rank(key: Hashable, name: str, cost: int | None, steps: int) -> Rank:
    """The place of a MACROP among those that fit: by cost, then by steps; header and key decide between equals."""
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
        """The entries whose requirements are met; what none of those left requires is not looked at."""
        if not self.order:
            self.order = sorted(
                self.requiring, key=lambda text: not text.startswith("state\n\n")
            )  # one look each
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
    """MACROPs that can be had. Keys are the caller's."""

    def __init__(self) -> None:
        self._shelves: dict[str, _Shelf] = {}
        self._places: dict[Hashable, tuple[_Shelf, int]] = {}
        self._profiles = Profiles()

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, key: Hashable) -> bool:
        return key in self._places

    def add(self, key: Hashable, macrop: Macrop) -> None:
        """Put a MACROP in; one under the same key is replaced."""
        order = rank(key, str(macrop.name), macrop.cost, len(macrop.steps))
        self.put(signature_of(macrop), Entry(key, order, lambda: macrop), requirements(macrop))

    def put(self, signature: str, entry: Entry, required: Iterable[Requirement]) -> None:
        """Put in what is known of a MACROP that may not have been read yet."""
        self.remove(entry.key)
        shelf = self._shelves.setdefault(signature, _Shelf())
        self._places[entry.key] = shelf, shelf.add(entry, required)

    def remove(self, key: Hashable) -> None:
        """Take a MACROP out, if it is there."""
        found = self._places.pop(key, None)
        if found is not None:
            shelf, place = found
            shelf.remove(place)

    def candidates(self, asked: Query) -> list[Entry]:
        """The MACROPs for the query's goals whose requirements are met, the cheapest first."""
        shelf = self._shelves.get(signature_asked(asked))
        if shelf is None:
            return []
        return sorted(shelf.fitting(Observed(asked, self._profiles)), key=lambda entry: entry.rank)
