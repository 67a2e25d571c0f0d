# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Linear sums of quantities compared with 0, and how often a step must be repeated until a
comparison holds.

Plain Python, compiled with the types in `sums.pxd`. Comparison i belongs to atom `atoms[i]`; where
it is false, the atom `others[i]` is true (-1: there is none). A set of atoms is a row of bytes, in
which atom j is bit `j % 8` of byte `j // 8`.
"""

from array import array
from collections.abc import Sequence
from itertools import accumulate

EQUAL, DIFFERENT, LESS, AT_MOST, MORE, AT_LEAST = range(6)
NEVER = 1 << 60  # what repeating never achieves
MOST = 1 << 40


class Comparisons:
    """Comparison i holds if constants[i] plus the sum of factor * value over `parts[i]`, as
    (place of the value, factor), does so.
    """

    def __init__(
        self,
        parts: Sequence[Sequence[tuple[int, int]]],
        constants: Sequence[int],
        relations: Sequence[int],
        atoms: Sequence[int],
        others: Sequence[int],
        width: int,
    ) -> None:
        self.count, self.width = len(parts), width
        items = [item for each in parts for item in each]
        self.places, self.factors = (
            array("i", [place for place, _ in items]),
            array("q", [factor for _, factor in items]),
        )
        self.starts = array("i", [0, *accumulate(map(len, parts))])
        self.constants, self.relations = array("q", constants), array("i", relations)
        self.atoms, self.others = array("i", atoms), array("i", others)
        self.totals = array("q", bytes(8 * max(self.count, 1)))

    def true(self, values: "array[int]") -> bytes:
        """The atoms of the comparisons that hold, and the other atoms of those that do not."""
        found = bytearray(self.width)
        self.add(values)
        for index in range(self.count):
            atom = (
                self.atoms[index]
                if _holds(self.totals[index], self.relations[index])
                else self.others[index]
            )
            if atom >= 0:
                found[atom >> 3] |= 1 << (atom & 7)
        return bytes(found)

    def add(self, values: "array[int] | memoryview[int]") -> None:
        """Adds up all sums, into `totals`."""
        for index in range(self.count):
            self.totals[index] = self._total(index, values)

    def look(self, index: int, values: "memoryview[int]", atoms: bytearray) -> None:
        """Sets the atom of one comparison in a row of bytes, and its other atom, as the values
        are.
        """
        held = _holds(self._total(index, values), self.relations[index])
        _put(atoms, self.atoms[index], held)
        _put(atoms, self.others[index], not held)

    def _total(self, index: int, values: "array[int] | memoryview[int]") -> int:
        total = self.constants[index]
        for place in range(self.starts[index], self.starts[index + 1]):
            total += self.factors[place] * values[self.places[place]]
        return total


def _put(atoms: bytearray, atom: int, held: bool) -> None:
    """Sets or clears an atom in a row of bytes; none if the number is -1."""
    if atom >= 0 and held:
        atoms[atom >> 3] |= 1 << (atom & 7)
    elif atom >= 0:
        atoms[atom >> 3] &= 255 ^ (1 << (atom & 7))


def _holds(total: int, relation: int) -> bool:
    if relation == EQUAL:
        return total == 0
    if relation == DIFFERENT:
        return total != 0
    if relation == LESS:
        return total < 0
    if relation == AT_MOST:
        return total <= 0
    if relation == MORE:
        return total > 0
    return total >= 0


class Repetitions:
    """Repetition i: a step of the cost `costs[i]` adds gains[i] to the sum of comparison tests[i],
    until `relations[i]` holds.

    A gain of 0 stands for an amount that differs from state to state: one step is taken to do.
    """

    def __init__(
        self,
        comparisons: Comparisons,
        tests: Sequence[int],
        relations: Sequence[int],
        gains: Sequence[int],
        costs: Sequence[int],
    ) -> None:
        self.comparisons, self.count = comparisons, len(tests)
        self.tests, self.relations = array("i", tests), array("i", relations)
        self.gains, self.costs = array("q", gains), array("q", costs)
        self.found = array("q", bytes(8 * max(self.count, 1)))

    def needed(self, values: "array[int] | memoryview[int]") -> "array[int]":
        """The cost of as many steps as each repetition needs; NEVER if no number of them is
        enough.
        """
        found = self.found
        self.comparisons.add(values)
        for index in range(self.count):
            times = _times(
                self.comparisons.totals[self.tests[index]], self.relations[index], self.gains[index]
            )
            found[index] = NEVER if times < 0 else min(times * self.costs[index], MOST)
        return self.found


def _times(total: int, relation: int, gain: int) -> int:
    """How many steps a sum needs until it compares with 0 as wanted, at least 1; -1 if they
    lead away from it.
    """
    if gain == 0 or relation == DIFFERENT or _holds(total, relation):
        return 1
    if relation == LESS:
        total += 1
    elif relation == MORE:
        total -= 1
    if (total > 0) == (gain > 0):
        return -1
    if total < 0:
        total, gain = -total, -gain
    return (total - gain - 1) // -gain  # rounded up
