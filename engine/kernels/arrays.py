"""Arrays that kernels take. A module that needs NumPy for its types alone imports them from here."""

from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Truths = NDArray[np.bool_]
Whole: TypeAlias = "memoryview[int]"
Real: TypeAlias = "memoryview[float]"


def whole(array: NDArray[Any]) -> Whole:
    """The same array of whole numbers or truths, whose entries are read as numbers of Python: they never overflow."""
    return memoryview(cast(Any, array))


def real(array: Floats) -> Real:
    """The same array, whose entries are read as numbers of Python: a loop that is not compiled reads them faster."""
    return memoryview(cast(Any, array))
