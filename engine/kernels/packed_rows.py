# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Lists of whole numbers stored one after another in two arrays, as compiled loops read them, and
arrays of zeros.

The module is plain Python. Cython compiles it with the types in `packed_rows.pxd`.
"""

from array import array
from collections.abc import Sequence
from typing import TypeAlias

Ints: TypeAlias = "array[int]"  # 32 bits each
Longs: TypeAlias = "array[int]"  # 64 bits each


def zero_ints(length: int) -> Ints:
    """An array of zeros, 32 bits each."""
    return array("i", bytes(4 * length))


def zero_longs(length: int) -> Longs:
    """An array of zeros, 64 bits each."""
    return array("q", bytes(8 * length))


def pack_rows(lists: Sequence[Sequence[int]]) -> "tuple[array[int], array[int]]":
    """Lists stored one after another: list i is items[starts[i]:starts[i + 1]].

    Returns starts and items.
    """
    starts, items = array("i", [0]), array("i")
    for numbers in lists:
        items.extend(numbers)
        starts.append(len(items))
    return starts, items


class PackedRows:
    """Lists of numbers, stored one after another: list i is items[starts[i]:starts[i + 1]]."""

    def __init__(self, lists: Sequence[Sequence[int]]) -> None:
        starts, items = pack_rows(lists)
        self.count, self.length = len(lists), len(items)
        self.starts, self.items = starts, items if len(items) else zero_ints(1)

    def row(self, index: int) -> list[int]:
        """The list of that number."""
        return list(self.items[self.starts[index] : self.starts[index + 1]])
