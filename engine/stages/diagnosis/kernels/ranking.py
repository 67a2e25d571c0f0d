# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Actions sorted by their values, one row for each level of a search."""

import numpy as np

from cellwright.engine.kernels.arrays import real, whole


class Ranking:
    """Rows of actions (levels, A), ascending by their values (levels, A).

    The caller remembers how many a row has.
    """

    def __init__(self, levels: int, actions: int) -> None:
        self.order = whole(np.empty((levels, actions), np.int64))
        self.values = real(np.empty((levels, actions)))

    def insert(self, level: int, action: int, value: float, count: int) -> int:
        """Insert an action among the first `count` of a row, behind those with equal values.

        Returns the new number.
        """
        place = count
        while place > 0 and self.values[level, place - 1] > value:
            self.values[level, place] = self.values[level, place - 1]
            self.order[level, place] = self.order[level, place - 1]
            place -= 1
        self.values[level, place] = value
        self.order[level, place] = action
        return count + 1
