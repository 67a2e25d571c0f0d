"""Compiled loops over scalars. Everything here is held by tests against plain NumPy.

Vectors are tuples of three floats inside a kernel: they cost no allocation. A cached kernel notices changes of its own
file only: after changing a function that others call, remove the `__pycache__` folders.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """`function`, compiled at its first call and cached on disk; without a cache where no folder can be written."""
    try:
        kernel: Any = numba.njit(cache=True, error_model="numpy", nogil=True)(function)
    except RuntimeError:  # "cannot cache function": neither beside the module nor under the home folder
        kernel = numba.njit(error_model="numpy", nogil=True)(function)
    return cast(F, kernel)


def inlined(function: F) -> F:
    """`function`, copied into every kernel that calls it: for the few lines that run hundreds of times per check."""
    return cast(F, numba.njit(error_model="numpy", nogil=True, forceinline=True)(function))
