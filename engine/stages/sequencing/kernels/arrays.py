"""A tour as an array of cities with its inverse (`position`); every change is the reversal of a stretch of positions.

A reversal is its own inverse, so that a journal of reversals takes changes back.
"""

import numpy as np
from numpy.typing import NDArray

from engine.stages.sequencing.kernels import compiled

Ints = NDArray[np.int32]
Longs = NDArray[np.int64]


@compiled
def reverse(tour: Ints, position: Ints, first: int, last: int) -> None:
    """Reverse the positions from `first` to `last`, cyclically; the stretch between them, not the rest."""
    n = tour.shape[0]
    length = last - first + 1
    if length <= 0:
        length += n
    for _ in range(length // 2):
        a, b = tour[first], tour[last]
        tour[first], position[b] = b, first
        tour[last], position[a] = a, last
        first += 1
        if first == n:
            first = 0
        last -= 1
        if last < 0:
            last = n - 1


@compiled
def flip(tour: Ints, position: Ints, start: int, end: int, journal: Ints, written: int) -> bool:
    """Reverse the path from city `start` to city `end`, or, if that is shorter, the rest; whether it was the rest.

    The reversal is noted in row `written` of the journal, if there is room.
    """
    n = tour.shape[0]
    first, last = position[start], position[end]
    length = last - first + 1
    if length <= 0:
        length += n
    rest = 2 * length > n
    if rest:
        first, last = (last + 1) % n, (first - 1) % n
    reverse(tour, position, first, last)
    if written < journal.shape[0]:
        journal[written, 0], journal[written, 1] = first, last
    return bool(rest)


@compiled
def undo(tour: Ints, position: Ints, journal: Ints, written: int, kept: int) -> None:
    """Take back the reversals of the journal after the first `kept`."""
    for entry in range(written - 1, kept - 1, -1):
        reverse(tour, position, journal[entry, 0], journal[entry, 1])


@compiled
def after(tour: Ints, position: Ints, city: int) -> int:
    """The next city."""
    at = position[city] + 1
    return int(tour[0] if at == tour.shape[0] else tour[at])


@compiled
def before(tour: Ints, position: Ints, city: int) -> int:
    """The city before."""
    return int(tour[position[city] - 1])  # -1 is the last


@compiled
def wake(city: int, queue: Ints, waiting: Ints, head: int, size: int) -> int:
    """Put a city at the end of the queue unless it waits there; the queue's size."""
    if waiting[city] == 0:
        waiting[city] = 1
        queue[(head + size) % queue.shape[0]] = city
        return size + 1
    return size


@compiled
def positions(tour: Ints) -> Ints:
    """Where each city stands in the tour."""
    found = np.empty(tour.shape[0], np.int32)
    for index in range(tour.shape[0]):
        found[tour[index]] = index
    return found
