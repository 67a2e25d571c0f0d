# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Shortens a path: leaves corners out, then joins two places by a straight line (Geraerts &
Overmars 2007).

The places are quasi-random, so that the same path is always shortened in the same way.
"""

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry import edges
from cellwright.engine.kernels.geometry.edges import Edges
from cellwright.engine.kernels.motion import halton
from cellwright.engine.kernels.motion.halton import Halton


class Route:
    """A path (m, k) with room for `tries` bridges.

    Raises `ValueError` for one without a line, or with what is no number.
    """

    def __init__(self, path: Floats, tries: int) -> None:
        if path.ndim != 2 or len(path) < 2 or not np.isfinite(path).all():
            raise ValueError(
                f"a path must be (m, k), finite, with two configurations or more, not {path.shape}"
            )
        self.size, self.count = path.shape
        self.rows = np.empty((self.size + tries + 2, self.count))
        self.rows[: self.size] = path
        self._rows, self.ends = self.rows, np.empty((2, self.count))
        self.along = np.zeros(len(self.rows))
        self.halton = Halton(np.zeros(2))

    def path(self) -> Floats:
        """The configurations (m, k) as they are now."""
        found: Floats = self.rows[: self.size].copy()
        return found


def shorten(r: Route, e: Edges, tries: int, budget: int) -> None:
    """Shorten a path by free lines, until `tries` bridges are tried or `e` has looked at `budget`
    configurations.

    Raises `ValueError` for more tries than there is room for.
    """
    if e.count != r.count or tries > len(r.rows) - r.size - 2:
        raise ValueError(
            f"a path of {r.count} joints with room for {len(r.rows) - r.size - 2} bridges"
        )
    with cython.nogil:
        _skip_corners(r, e, budget)
        for n in range(tries):
            if e.looked >= budget or r.size < 3:
                break
            _measure(r)
            _bridge(r, e, 1.0 if n % 2 else 0.25)
        _drop_close(r, e)


def _skip_corners(r: Route, e: Edges, budget: int) -> int:
    """Join each corner with the last one that a free line leads to."""
    i = 0
    while i < r.size - 2:
        j = r.size - 1
        while j > i + 1 and e.looked < budget:
            free = e.free(r._rows, i, r._rows, j)
            if free:
                _cut(r, i, j, 0)
                break
            j -= 1
        i += 1
    return 0


def _drop_close(r: Route, e: Edges) -> int:
    """Leave out corners that are nearer than a step to the one before, where the line past them
    is free.
    """
    i = 1
    while i < r.size - 1:
        close = edges.length(r._rows, i - 1, r._rows, i, r.count) < e.step
        close = close or edges.length(r._rows, i, r._rows, i + 1, r.count) < e.step
        free = e.free(r._rows, i - 1, r._rows, i + 1) if close else 0
        if free:
            _cut(r, i - 1, i + 1, 0)
        else:
            i += 1
    return 0


def _cut(r: Route, i: int, j: int, middle: int) -> None:
    """Put `middle` rows of `ends` in place of what is between rows `i` and `j`."""
    left_out = j - i - 1 - middle
    if left_out >= 0:
        for n in range(j, r.size):
            for x in range(r.count):
                r._rows[n - left_out, x] = r._rows[n, x]
    else:
        for n in range(r.size - 1, j - 1, -1):
            for x in range(r.count):
                r._rows[n - left_out, x] = r._rows[n, x]
    for n in range(middle):
        for x in range(r.count):
            r._rows[i + 1 + n, x] = r.ends[n, x]
    r.size -= left_out


def _measure(r: Route) -> None:
    """Note how far along the path each corner is."""
    r.along[0] = 0.0
    for n in range(1, r.size):
        r.along[n] = r.along[n - 1] + edges.length(r._rows, n - 1, r._rows, n, r.count)


def _bridge(r: Route, e: Edges, window: float) -> int:
    """Try a line between two places that are at most a share `window` of the path apart."""
    r.halton.drawn += 1
    whole = r.along[r.size - 1]
    one = whole * halton.coordinate(r.halton, 0)
    other = one + whole * window * halton.coordinate(r.halton, 1)
    if other > whole:
        other = whole
    i, j = _locate(r, one, 0), _locate(r, other, 1)
    if i == j or edges.length(r.ends, 0, r.ends, 1, r.count) > 0.9999 * (other - one):
        return 0
    free = e.free(r.ends, 0, r.ends, 1)
    if free and other >= whole:
        _cut(r, i, j + 1, 1)
    elif free:
        _cut(r, i, j + 1, 2)
    return free


def _locate(r: Route, way: float, row: int) -> int:
    """The line on which a place of the path lies; the place itself is written to a row of
    `ends`.
    """
    n = 0
    while n < r.size - 2 and r.along[n + 1] < way:
        n += 1
    length = r.along[n + 1] - r.along[n]
    t = (way - r.along[n]) / length if length > 0.0 else 0.0
    for x in range(r.count):
        r.ends[row, x] = r._rows[n, x] + t * (r._rows[n + 1, x] - r._rows[n, x])
    return n
