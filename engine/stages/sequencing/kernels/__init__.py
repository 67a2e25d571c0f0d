"""Compiled loops of the sequencer: moves on tours, minimum 1-trees, and shortest paths over poses.

Held by tests against plain Python. A cached kernel notices changes of its own file only: after changing a function that
others call, remove the `__pycache__` folders.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """`function`, compiled at its first call and cached on disk; without a cache where no folder can be written."""
    try:
        kernel: Any = numba.njit(cache=True)(function)
    except RuntimeError:  # "cannot cache function": neither beside the module nor under the home folder
        kernel = numba.njit(function)
    return cast(F, kernel)
