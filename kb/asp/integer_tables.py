"""Tables of integers read from clingo's text: lists if they are small, arrays if large.

NumPy is imported only for large tables, because importing it takes longer than grounding a small
problem.
"""

from collections.abc import Iterator
from math import prod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Array = npt.NDArray[np.int64]

# characters of text; from this length on NumPy is worth its import
LARGE_TABLE_CHARACTERS = 300_000
CHUNK_ROWS = 10_000  # rows that are Python numbers at the same time
# if the spans of the columns multiply to less, each row is sorted by one integer
LARGEST_KEY = 2**62
_NUMBERS_ALONE = str.maketrans(";", ",", "()")  # clingo writes a negative number as (-1)


class IntegerTable:
    """Different rows of integers in lexicographic order, so that nothing depends on clingo's
    order.
    """

    def __init__(self, rows: "list[list[int]] | Array") -> None:
        self._rows = rows

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[list[int]]:
        if isinstance(self._rows, list):
            yield from self._rows
            return
        for start in range(0, len(self._rows), CHUNK_ROWS):
            yield from self._rows[start : start + CHUNK_ROWS].tolist()


def read_integer_table(text: str, width: int) -> IntegerTable:
    """The rows in the text of a theory atom, between its braces."""
    numbers = text[text.index("{") + 1 : -1].translate(_NUMBERS_ALONE)
    if not numbers.strip():
        return IntegerTable([])
    if len(numbers) >= LARGE_TABLE_CHARACTERS:
        return IntegerTable(_read_array(numbers, width))
    cells = iter(map(int, numbers.split(",")))
    return IntegerTable(sorted(map(list, zip(*[cells] * width, strict=True))))


def _read_array(numbers: str, width: int) -> "Array":
    import numpy as np

    rows = np.fromstring(numbers, dtype=np.int64, sep=",").reshape(-1, width)
    lowest = rows.min(axis=0)
    spans = [int(span) for span in rows.max(axis=0) - lowest + 1]
    if prod(spans) >= LARGEST_KEY:
        return rows[np.lexsort(rows.T[::-1])]
    keys = rows[:, 0] - lowest[0]
    for column in range(1, width):
        keys = keys * spans[column] + (rows[:, column] - lowest[column])
    return rows[np.argsort(keys)]
