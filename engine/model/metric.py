"""Costs between points that are computed when they are needed: memory grows with the number of points alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Ints, Longs

PI, RADIUS_KM = 3.141592, 6378.388  # as TSPLIB prescribes
MICROMETRES = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Metric:
    """Whole-number costs between points (n, d), d is 2 or 3: one of `KINDS`, by which TSPLIB rounds, or `micrometres`."""

    kind: str
    points: Floats

    def __len__(self) -> int:
        return len(self.points)

    def between(self, a: Ints, b: Ints) -> Longs:
        """The cost from each city of `a` to the city of `b` at the same place; shapes are broadcast."""
        u, v = self.points[a], self.points[b]
        found = KINDS[self.kind](u, v).astype(np.int64)
        return np.where(np.asarray(a) == np.asarray(b), 0, found)

    def part(self, members: Sequence[int]) -> "Metric":
        """The costs between some of the points."""
        return Metric(self.kind, self.points[list(members)])

    def matrix(self) -> Longs:
        """All costs (n, n)."""
        n = len(self)
        every, made = np.arange(n, dtype=np.int32), np.empty((n, n), np.int64)
        for city in range(n):
            made[city] = self.between(every[city : city + 1], every)
        return made


def _euclidean(u: Floats, v: Floats) -> Floats:
    """Square roots of sums in the order of the coordinates, so that kernels compute the same figures."""
    squares = (u - v) ** 2
    total = squares[..., 0] + squares[..., 1]
    for axis in range(2, squares.shape[-1]):
        total = total + squares[..., axis]
    found: Floats = np.sqrt(total)
    return found


def _rounded(u: Floats, v: Floats) -> Floats:
    return np.floor(_euclidean(u, v) + 0.5)


def _raised(u: Floats, v: Floats) -> Floats:
    return np.ceil(_euclidean(u, v))


def _manhattan(u: Floats, v: Floats) -> Floats:
    found: Floats = np.floor(np.abs(u - v).sum(axis=-1) + 0.5)
    return found


def _largest(u: Floats, v: Floats) -> Floats:
    found: Floats = np.floor(np.abs(u - v) + 0.5).max(axis=-1)
    return found


def _pseudo_euclidean(u: Floats, v: Floats) -> Floats:
    exact = np.sqrt(((u - v) ** 2).sum(axis=-1) / 10.0)
    near = np.floor(exact + 0.5)
    found: Floats = near + (near < exact)
    return found


def _micrometres(u: Floats, v: Floats) -> Floats:
    return np.rint(_euclidean(u, v) * MICROMETRES)


def _geographical(u: Floats, v: Floats) -> Floats:
    """Distances on the sphere in kilometres; coordinates are DDD.MM."""
    (a, c), (b, d) = np.moveaxis(radians(u), -1, 0), np.moveaxis(radians(v), -1, 0)
    q1, q2, q3 = np.cos(c - d), np.cos(a - b), np.cos(a + b)
    cosine = np.clip(0.5 * ((1.0 + q1) * q2 - (1.0 - q1) * q3), -1.0, 1.0)
    found: Floats = np.trunc(RADIUS_KM * np.arccos(cosine) + 1.0)
    return found


def radians(coordinates: Floats) -> Floats:
    """Angles of coordinates that TSPLIB writes as degrees and minutes, DDD.MM."""
    degrees = np.trunc(coordinates)
    found: Floats = PI * (degrees + 5.0 * (coordinates - degrees) / 3.0) / 180.0
    return found


KINDS: dict[str, Callable[[Floats, Floats], Floats]] = {
    "rounded": _rounded,
    "raised": _raised,
    "manhattan": _manhattan,
    "largest": _largest,
    "pseudo_euclidean": _pseudo_euclidean,
    "micrometres": _micrometres,
    "geographical": _geographical,
}
