# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Quasi-random points: they fill a cube evenly, and are the same on every run (Halton 1960)."""

import functools

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs

PRIMES = 64


@functools.cache
def primes(count: int) -> Longs:
    """The first prime numbers (count,)."""
    found: list[int] = []
    number = 2
    while len(found) < count:
        if all(number % each for each in found):
            found.append(number)
        number += 1
    table: Longs = np.array(found, dtype=np.int64)
    table.flags.writeable = False
    return table


class Halton:
    """Points of the unit cube in `count` dimensions, shifted by (count,) round the cube; `drawn`
    counts them.

    Raises `ValueError` for more than 64 dimensions.
    """

    def __init__(self, shift: Floats) -> None:
        self.count = len(shift)
        if self.count > PRIMES:
            raise ValueError(f"at most {PRIMES} dimensions, not {self.count}")
        self.bases = primes(self.count)
        self.shift, self.drawn = np.array(shift, dtype=float), 0


def inverse(index: int, base: int) -> float:
    """The digits of a number, mirrored at the point: from 0 to 1."""
    found, place = 0.0, 1.0
    while index > 0:
        place /= base
        found += place * (index % base)
        index //= base
    return found


def coordinate(h: Halton, x: int) -> float:
    """One coordinate of the point that was drawn last."""
    value: float = inverse(h.drawn, h.bases[x]) + h.shift[x]
    return value - 1.0 if value >= 1.0 else value
