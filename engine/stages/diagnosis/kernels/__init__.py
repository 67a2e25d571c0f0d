"""Compiled search over beliefs. Everything here is held by tests against plain recursion.

Values are weighted with the probability of coming to a state, so that the parts of a sum add up without division. A
cached kernel notices changes of its own file only: after changing a function that others call, remove `__pycache__`.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """`function`, compiled at its first call and cached on disk; without a cache where no folder can be written."""
    try:
        kernel: Any = numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # "cannot cache function": neither beside the module nor under the home folder
        kernel = numba.njit(error_model="numpy")(function)
    return cast(F, kernel)
