"""The index of a library: MACROPs by goal signature, then by their requirements in a set-trie.

A set-trie (Savnik 2013) stores sets as paths in a fixed order of elements; all stored subsets of a set are found by
walking only along elements of that set. So a branch is left at the first requirement that a query does not meet,
whatever number of MACROPs lies behind it.
"""

from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

from engine.macros.features import Observed, Requirement, requirements
from engine.macros.matching import Program
from engine.macros.query import Query, signature_asked, signature_of
from kb.model.macro import Macrop

UNKNOWN_COST = 1 << 62


@dataclass(frozen=True)
class Entry:
    """A MACROP of the index under the key of its library."""

    key: Hashable
    macrop: Macrop

    @cached_property
    def program(self) -> Program:
        """The order in which its parts are matched."""
        return Program(self.macrop)

    @cached_property
    def rank(self) -> tuple[int, int, str, str]:
        """Cheap ones are tried first; header and key decide between equals, so that the order repeats."""
        cost = UNKNOWN_COST if self.macrop.cost is None else self.macrop.cost
        return cost, len(self.macrop.steps), str(self.macrop.name), str(self.key)


@dataclass
class _Node:
    children: dict[int, "_Node"] = field(default_factory=dict)
    entries: dict[Hashable, Entry] = field(default_factory=dict)


class Index:
    """MACROPs that are in memory. Keys are the caller's."""

    def __init__(self) -> None:
        self._numbers: dict[Requirement, int] = {}
        self._known: list[Requirement] = []
        self._roots: dict[str, _Node] = {}
        self._places: dict[Hashable, _Node] = {}

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, key: Hashable) -> bool:
        return key in self._places

    def add(self, key: Hashable, macrop: Macrop) -> None:
        """Put a MACROP in; one under the same key is replaced."""
        self.remove(key)
        node = self._roots.setdefault(signature_of(macrop), _Node())
        for number in sorted(map(self._number, requirements(macrop))):
            node = node.children.setdefault(number, _Node())
        node.entries[key] = Entry(key, macrop)
        self._places[key] = node

    def remove(self, key: Hashable) -> None:
        """Take a MACROP out, if it is there."""
        node = self._places.pop(key, None)
        if node is not None:
            del node.entries[key]

    def candidates(self, asked: Query) -> list[Entry]:
        """The MACROPs for the query's goals whose requirements are met, the cheapest first."""
        root = self._roots.get(signature_asked(asked))
        if root is None:
            return []
        return sorted(self._walk(root, Observed(asked)), key=lambda entry: entry.rank)

    def _number(self, requirement: Requirement) -> int:
        if requirement not in self._numbers:
            self._numbers[requirement] = len(self._known)
            self._known.append(requirement)
        return self._numbers[requirement]

    def _walk(self, node: _Node, observed: Observed) -> Iterator[Entry]:
        yield from node.entries.values()
        for number, child in node.children.items():
            if observed.meets(self._known[number]):
                yield from self._walk(child, observed)
