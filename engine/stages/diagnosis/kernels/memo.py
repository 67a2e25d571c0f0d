# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""The table of the states whose values are known (open addressing; keys are rows of words)."""

import numpy as np

from cellwright.engine.kernels.arrays import real, whole

WORD = 0xFFFFFFFFFFFFFFFF
FIRST, THIRD = 0x9E3779B97F4A7C15, 0x94D049BB133111EB


class Keys:
    """Rows of words of 64 bits: sets of causes, or keys of states. `words` (rows, width)."""

    def __init__(self, rows: int, width: int) -> None:
        self.width = width
        self.words = whole(np.zeros((rows, width), np.uint64))

    def number(self, row: int, first: int, last: int) -> int:
        """The words from `first` to before `last` as one number, the lowest word first."""
        found = 0
        for word in range(last - first):
            found |= int(self.words[row, first + word]) << 64 * word
        return found

    def write(self, row: int, first: int, last: int, number: int) -> None:
        """Write a number into the words from `first` to before `last`, the lowest word first."""
        for word in range(last - first):
            self.words[row, first + word] = (number >> 64 * word) & WORD


class Memo:
    """For each state a lower bound of its value, and whether this is the value itself.

    A search goes on until the table is `full` or its budget of `expansions` is `spent`.
    """

    def __init__(self, length: int, budget: int, width: int = 2) -> None:
        """An empty table with `length` slots for keys of `width` words.

        Raises `ValueError` unless `length` is a power of two.
        """
        if length < 1 or length & (length - 1):
            raise ValueError(f"a table has a power of two of slots, not {length}")
        self.keys = Keys(length, width)
        self.value = real(np.zeros(length))
        self.used = whole(np.zeros(length, np.uint8))
        self.exact = whole(np.zeros(length, np.uint8))
        self.length, self.budget, self.width = length, budget, width
        self.expansions = self.entries = 0
        self.spent = self.full = False

    def resume(self, budget: int) -> None:
        """Let the search go on up to this total of expansions, or until the table is full."""
        self.budget = budget
        self.spent = self.full = False

    def halt(self) -> None:
        """End the search here, as if its budget were spent."""
        self.spent = True

    def slot(self, keys: Keys, row: int) -> int:
        """The slot of the state in a row of keys, or the empty slot where it would go."""
        last, mixed = self.length - 1, 0
        for word in range(self.width):
            mixed = ((mixed ^ keys.words[row, word]) * FIRST) & WORD
            mixed ^= mixed >> 31
        mixed = (mixed * THIRD) & WORD
        at = (mixed ^ (mixed >> 29)) & last
        while self.used[at] and not self._holds(at, keys, row):
            at = (at + 1) & last
        return at

    def _holds(self, at: int, keys: Keys, row: int) -> bool:
        # `all` over a generator would not compile to a loop
        for word in range(self.width):  # noqa: SIM110
            if self.keys.words[at, word] != keys.words[row, word]:
                return False
        return True

    def enter(self, at: int, keys: Keys, row: int, value: float, exact: bool) -> None:
        """Fill an empty slot. After this the table may be too full to go on."""
        for word in range(self.width):
            self.keys.words[at, word] = keys.words[row, word]
        self.used[at] = 1
        self.value[at] = value
        self.exact[at] = exact
        self.entries += 1
        if 4 * self.entries > 3 * self.length:
            self.full = True

    def conclude(self, keys: Keys, row: int, floor: float, limit: float) -> float:
        """Note that a value is at least `floor`, or exactly `floor` if all below `limit` was
        searched.

        Returns what is known.
        """
        at = self.slot(keys, row)
        self.value[at] = max(self.value[at], floor)
        self.exact[at] = not self.full and not self.spent and floor < limit
        return self.value[at]

    def expand(self) -> None:
        """Count one expansion. After this the budget may be spent."""
        self.expansions += 1
        if self.expansions >= self.budget:
            self.spent = True

    def grown(self) -> "Memo":
        """A table four times as long, with the same content and counts."""
        larger = Memo(4 * self.length, self.budget, self.width)
        for i in range(self.length):
            if self.used[i]:
                at = larger.slot(self.keys, i)
                larger.enter(at, self.keys, i, self.value[i], self.exact[i] != 0)
        larger.expansions = self.expansions
        return larger
