# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True
"""What is known of the value of each state: a table with open addressing, whose keys are two words."""

import numpy as np

from engine.kernels.arrays import real, whole

WORD = 0xFFFFFFFFFFFFFFFF
FIRST, SECOND, THIRD = 0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x94D049BB133111EB


class Memo:
    """For each state (`possible`, `rest`) a lower bound of its value, and whether this is the value itself.

    In an empty slot `possible` is 0, since a state without causes has no value. A search goes on until the
    table is `full` or its budget of `expansions` is `spent`.
    """

    def __init__(self, length: int, budget: int) -> None:
        """An empty table with `length` slots. Raises `ValueError` unless `length` is a power of two."""
        if length < 1 or length & (length - 1):
            raise ValueError(f"a table has a power of two of slots, not {length}")
        self.possible = whole(np.zeros(length, np.int64))
        self.rest = whole(np.zeros(length, np.int64))
        self.value = real(np.zeros(length))
        self.exact = whole(np.zeros(length, np.uint8))
        self.length, self.budget = length, budget
        self.expansions = self.entries = 0
        self.spent = self.full = False

    def resume(self, budget: int) -> None:
        """Let the search go on up to this total of expansions, or until the table is full."""
        self.budget = budget
        self.spent = self.full = False

    def slot(self, possible: int, rest: int) -> int:
        """The slot of a state, or the empty slot where it would go."""
        last = self.length - 1
        mixed = ((possible * FIRST) ^ (rest * SECOND)) & WORD
        mixed ^= mixed >> 31
        mixed = (mixed * THIRD) & WORD
        at = (mixed ^ (mixed >> 29)) & last
        while self.possible[at] != 0 and (self.possible[at] != possible or self.rest[at] != rest):
            at = (at + 1) & last
        return at

    def enter(self, at: int, possible: int, rest: int, value: float, exact: bool) -> None:
        """Fill an empty slot. After this the table may be too full to go on."""
        self.possible[at] = possible
        self.rest[at] = rest
        self.value[at] = value
        self.exact[at] = exact
        self.entries += 1
        if 4 * self.entries > 3 * self.length:
            self.full = True

    def conclude(self, possible: int, rest: int, floor: float, limit: float) -> float:
        """Note that a value is at least `floor`, or exactly `floor` if all below `limit` was searched.

        Returns what is known.
        """
        at = self.slot(possible, rest)
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
        larger = Memo(4 * self.length, self.budget)
        for i in range(self.length):
            if self.possible[i] != 0:
                at = larger.slot(self.possible[i], self.rest[i])
                larger.enter(at, self.possible[i], self.rest[i], self.value[i], self.exact[i] != 0)
        larger.expansions = self.expansions
        return larger
