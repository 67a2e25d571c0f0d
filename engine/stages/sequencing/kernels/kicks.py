# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True
"""Annealing with kicks: double bridges between places that are near each other along the tour, or in space.

Martin, Otto & Felten 1991 (double-bridge kicks with annealed acceptance), the kicks kept local.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.kernels.arrays import Ints, whole
from engine.stages.sequencing.kernels.exchange import Ring
from engine.stages.sequencing.kernels.twister import Stream

SEGMENT = 30  # cities between the cuts of a kick along the tour
WALK = 10  # steps between the cuts of a kick in space
SPATIAL = 0.5  # how many of the kicks are made in space


def improve(
    tour: Ints,
    cost: NDArray[Any],
    near: Ints,
    toll: NDArray[Any],
    kicks: int,
    warmth: float,
    cooling: float,
    seed: int,
) -> tuple[Ints, int, int, float]:
    """Anneal over `kicks` local double bridges, each repaired by exchanges; n >= 8.

    `tour` (n,) is changed in place. `cost` (n, n) is symmetric, of whole numbers in 32 or 64 bits; `near` (n, k) has each
    city's candidates, nearest first, `toll` (n, k) the costs to them. Worse tours are accepted with the probability
    exp(-loss / warmth); `warmth` is multiplied by `cooling` each kick.
    Returns the best tour, what it gained over the given one, what the current one gained, and the final warmth.
    """
    kicker = Kicker(tour, cost, near, toll, seed)
    warmth = kicker.anneal(kicks, warmth, cooling)
    return np.array(kicker.best), kicker.best_gain, kicker.gain, warmth


class Kicker:
    """A tour that is annealed, the best one met, and what both gained over the one at the beginning."""

    def __init__(self, tour: Ints, cost: NDArray[Any], near: Ints, toll: NDArray[Any], seed: int) -> None:
        self.ring, self.stream = Ring(tour, cost, near, toll), Stream(seed)
        self.n, self.breadth = len(tour), int(near.shape[1])
        self.cuts, self.best = whole(np.zeros(4, np.int32)), whole(tour.copy())
        self.gain = self.best_gain = 0

    def anneal(self, kicks: int, warmth: float, cooling: float) -> float:
        """Settle, then kick and settle as often; the final warmth."""
        for index in range(self.n):
            self.ring.wake(self.ring.tour[index])
        self.gain = self.best_gain = self.ring.settle()
        self._remember()
        for _ in range(kicks):
            self.ring.written = 0
            change = -self._kick()
            change += self.ring.settle()
            if change >= 0 or self.stream.accepts(change / max(warmth, 1e-9)):
                self.gain += change
                if self.gain > self.best_gain:
                    self.best_gain = self.gain
                    self._remember()
            else:
                self.ring.undo()
            warmth *= cooling
        return warmth

    def _remember(self) -> None:
        """The tour is the best one."""
        for index in range(self.n):
            self.best[index] = self.ring.tour[index]

    def _kick(self) -> int:
        """A double bridge: three neighbouring paths in reverse order. Its loss; the cities at the cuts are woken.

        No exchange of three edges takes it back.
        """
        if self.stream.random() >= SPATIAL or not self._near_cuts():
            self._short_cuts()
        loss = 0
        for place in range(4):
            last, first = self._beside(place, 0), self._beside(place, 1)
            loss -= self.ring.edge(last, first)
            self.ring.wake(last)
            self.ring.wake(first)
        loss += self._new_edge(0, 2) + self._new_edge(3, 1) + self._new_edge(2, 0) + self._new_edge(1, 3)
        for place in range(3):
            self.ring.note((self.cuts[place] + 1) % self.n, self.cuts[place + 1])
        self.ring.note((self.cuts[0] + 1) % self.n, self.cuts[3])
        return loss

    def _beside(self, place: int, side: int) -> int:
        """The city before a cut, or behind it."""
        return self.ring.tour[(self.cuts[place] + side) % self.n]

    def _new_edge(self, place: int, other: int) -> int:
        """What it costs to go on from one cut behind another."""
        return self.ring.edge(self._beside(place, 0), self._beside(other, 1))

    def _near_cuts(self) -> bool:
        """Cut at four different places whose cities are close to each other in space, in order round the tour.

        They are turned so that the longest path lies between the last and the first. False if no four were found.
        """
        city = self.stream.below(self.n)
        for place in range(4):
            self.cuts[place] = self.ring.position[city]
            for _ in range(1 + self.stream.below(WALK)):
                city = self.ring.near[city, self.stream.below(self.breadth)]
        self._sort()
        longest, turn = self.n - self.cuts[3] + self.cuts[0], 0
        for place in range(3):
            path = self.cuts[place + 1] - self.cuts[place]
            if path == 0:
                return False
            if path > longest:
                longest, turn = path, place + 1
        for _ in range(turn):
            first = self.cuts[0]
            self.cuts[0], self.cuts[1], self.cuts[2] = self.cuts[1], self.cuts[2], self.cuts[3]
            self.cuts[3] = first
        return True

    def _sort(self) -> None:
        """Put the cuts in ascending order."""
        for place in range(1, 4):
            cut, at = self.cuts[place], place
            while at > 0 and self.cuts[at - 1] > cut:
                self.cuts[at] = self.cuts[at - 1]
                at -= 1
            self.cuts[at] = cut

    def _short_cuts(self) -> None:
        """Cut at four different places that follow each other closely round the tour."""
        limit = max(1, min(SEGMENT, (self.n - 2) // 3))
        self.cuts[0] = self.stream.below(self.n)
        for place in range(3):
            self.cuts[place + 1] = (self.cuts[place] + 1 + self.stream.below(limit)) % self.n
