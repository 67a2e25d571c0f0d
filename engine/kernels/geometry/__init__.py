"""Compiled loops over scalars. Everything here is held by tests against plain NumPy.

Vectors are tuples of three floats inside a kernel: they cost no allocation.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])
FOLDER = Path(__file__).parent


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


def forget_stale(folder: Path = FOLDER) -> bool:
    """Delete what is cached if a source has changed since, and say whether it had.

    A cached kernel notices changes of its own file alone, not of those whose functions it calls.
    """
    sources = sorted(folder.glob("*.py"))
    digest = hashlib.sha256(b"".join(each.read_bytes() for each in sources)).hexdigest()
    stamp = folder / "__pycache__" / "sources.sha256"
    try:
        if stamp.is_file() and stamp.read_text() == digest:
            return False
        for old in stamp.parent.glob("*.nb[ic]"):
            old.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(digest)
    except OSError:  # nothing can be written there, so nothing is cached there
        return False
    return True


forget_stale()
