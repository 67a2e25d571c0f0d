"""Lists of whole numbers stored one after another in two arrays, as compiled loops read them."""

from array import array
from collections.abc import Sequence


def rows(lists: Sequence[Sequence[int]]) -> "tuple[array[int], array[int]]":
    """Lists stored one after another: list i is items[starts[i]:starts[i + 1]].

    Returns starts and items.
    """
    starts, items = array("i", [0]), array("i")
    for numbers in lists:
        items.extend(numbers)
        starts.append(len(items))
    return starts, items
