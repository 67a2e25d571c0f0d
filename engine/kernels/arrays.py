"""Array types of the compiled kernels, and checks of shape and range before one runs.

A module that needs NumPy for its types alone imports them from here.
"""

from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Words = NDArray[np.uint64]  # sets, 64 members in each word
Truths = NDArray[np.bool_]
Bytes = NDArray[np.uint8]  # truths, as kernels see them
Whole: TypeAlias = "memoryview[int]"
Real: TypeAlias = "memoryview[float]"


def refuse_unless(what: str, array: NDArray[Any], kind: type, shape: tuple[int, ...]) -> None:
    """Raise `ValueError` unless an array has this kind of entries and this shape, row after row
    in memory.
    """
    if array.shape != shape:
        raise ValueError(f"{what}: the array must have the shape {shape}, not {array.shape}")
    if array.dtype.type is not kind or not array.flags.c_contiguous:
        raise ValueError(
            f"{what}: the array must be of {kind.__name__}, row after row, not {array.dtype}"
        )


def refuse_beyond(what: str, numbers: Longs, count: int) -> None:
    """Raise `ValueError` unless all numbers are from 0 up to, but not including, `count`."""
    if numbers.size and (int(numbers.min()) < 0 or int(numbers.max()) >= count):
        raise ValueError(f"{what}: numbers must be from 0 to {count - 1}")


def whole(array: NDArray[Any]) -> Whole:
    """The same array of whole numbers or truths, whose entries are read as numbers of Python:
    they never overflow.
    """
    return memoryview(cast(Any, array))


def real(array: Floats) -> Real:
    """The same array, whose entries are read as numbers of Python: a loop that is not compiled
    reads them faster.
    """
    return memoryview(cast(Any, array))
