"""Compiled kicks: double bridges between places that are near each other along the tour, or in space."""

import numpy as np

from engine.stages.sequencing.kernels import compiled
from engine.stages.sequencing.kernels.arrays import Ints, reverse, wake

SEGMENT = 30  # cities between the cuts of a kick along the tour
WALK = 10  # steps between the cuts of a kick in space
SPATIAL = 0.5  # how many of the kicks are made in space


@compiled
def _near_cuts(position: Ints, near: Ints, cuts: Ints) -> bool:
    """Four different positions of cities close to each other in space go into `cuts`, in order round the tour.

    They are turned so that the longest path lies between the last and the first. False if no four were found.
    """
    n = position.shape[0]
    city = np.random.randint(n)
    for place in range(4):
        cuts[place] = position[city]
        for _ in range(1 + np.random.randint(WALK)):
            city = near[city, np.random.randint(near.shape[1])]
    cuts.sort()
    longest, turn = n - cuts[3] + cuts[0], 0
    for place in range(3):
        path = cuts[place + 1] - cuts[place]
        if path == 0:
            return False
        if path > longest:
            longest, turn = path, place + 1
    for _ in range(turn):
        cuts[0], cuts[1], cuts[2], cuts[3] = cuts[1], cuts[2], cuts[3], cuts[0]
    return True


@compiled
def _short_cuts(n: int, cuts: Ints) -> None:
    """Four different positions that follow each other closely round the tour go into `cuts`."""
    limit = max(1, min(SEGMENT, (n - 2) // 3))
    cuts[0] = np.random.randint(n)
    for place in range(3):
        cuts[place + 1] = (cuts[place] + 1 + np.random.randint(limit)) % n


@compiled
def kick(
    tour: Ints, position: Ints, cost: Ints, near: Ints, queue: Ints, waiting: Ints, journal: Ints, cuts: Ints
) -> tuple[int, int, int]:
    """A double bridge: three neighbouring paths in reverse order. The loss, the journal's length, the queue's size.

    No exchange of three edges takes it back.
    """
    n = tour.shape[0]
    if np.random.random() >= SPATIAL or not _near_cuts(position, near, cuts):
        _short_cuts(n, cuts)
    p, q, r, s = cuts[0], cuts[1], cuts[2], cuts[3]
    loss, size = 0, 0
    for place in range(4):
        last, first = tour[cuts[place]], tour[(cuts[place] + 1) % n]
        loss -= cost[last, first]
        size = wake(last, queue, waiting, 0, size)
        size = wake(first, queue, waiting, 0, size)
    loss += cost[tour[p], tour[(r + 1) % n]] + cost[tour[s], tour[(q + 1) % n]]
    loss += cost[tour[r], tour[(p + 1) % n]] + cost[tour[q], tour[(s + 1) % n]]
    stretches = (((p + 1) % n, q), ((q + 1) % n, r), ((r + 1) % n, s), ((p + 1) % n, s))
    for index in range(4):
        journal[index, 0], journal[index, 1] = stretches[index]
        reverse(tour, position, stretches[index][0], stretches[index][1])
    return loss, 4, size
