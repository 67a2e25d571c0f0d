# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Annealing of closed tours by kicks: double bridges between places near each other.

Martin, Otto & Felten 1991 (double-bridge kicks with annealed acceptance); here the kicks are local.
"""

import numpy as np

from cellwright.engine.kernels.arrays import Ints, Longs, whole
from cellwright.engine.stages.sequencing.kernels.distances import Distances
from cellwright.engine.stages.sequencing.kernels.exchange import Ring
from cellwright.engine.stages.sequencing.kernels.twister import Stream

SEGMENT = 30  # cities between the cuts of a kick along the tour
WALK = 10  # steps between the cuts of a kick in space
SPATIAL = 0.5  # the share of kicks that are made in space
SPAN = 50_000  # a kick in space turns no more cities than this
TRIES = 100  # to cut no edge that must stay


class Kicker:
    """A tour that is annealed, the best tour since the last `begin`, and the gain of both over the
    tour then.

    The arguments are those of `Ring`; `tour` (n,) is changed in place, n >= 8.
    """

    def __init__(
        self, tour: Ints, distances: Distances, near: Ints, toll: Longs, mate: Ints, seed: int
    ) -> None:
        self.ring, self.stream = Ring(tour, distances, near, toll, mate), Stream(seed)
        self.n, self.breadth = len(tour), int(near.shape[1])
        self.cuts, self.kept = whole(np.zeros(4, np.int32)), whole(tour.copy())
        self.gain = self.best_gain = 0
        self.stale = False

    def settle(self, first: int, last: int) -> int:
        """Exchange edges around the cities at the positions first..last - 1, until nothing helps.

        Returns the gain.
        """
        for index in range(max(0, first), min(last, self.n)):
            self.ring.wake(self.ring.tour[index])
        self.ring.noting = False
        won = self.ring.settle()
        self.ring.noting = True
        self.gain += won
        self.begin()
        return won

    def begin(self) -> None:
        """From now on the present tour is the best."""
        self.gain = self.best_gain = 0
        self.stale = True

    def best(self) -> Ints:
        """The best tour."""
        if self.stale:
            self._remember()
        return np.array(self.kept)

    def anneal(self, kicks: int, warmth: float, cooling: float) -> float:
        """Make local double bridges, each repaired by exchanges. Returns the final warmth.

        A worse tour is accepted with the probability exp(-loss / warmth); `warmth` is multiplied by
        `cooling` after each kick.
        """
        for _ in range(kicks):
            self.ring.written = 0
            change = -self._kick()
            change += self.ring.settle()
            if change < 0 and not self.stream.accepts(change / max(warmth, 1e-9)):
                self.ring.back()
            else:
                self._accept(change)
            warmth *= cooling
        return warmth

    def _accept(self, change: int) -> None:
        """Count the gain of a kick.

        The best tour is not copied before a worse one takes its place.
        """
        if change < 0 and self.stale:
            self.ring.back()
            self._remember()
            self.ring.forth()
        self.gain += change
        if self.gain > self.best_gain:
            self.best_gain = self.gain
            self.stale = True

    def _remember(self) -> None:
        """Keep the tour as the best one."""
        for index in range(self.n):
            self.kept[index] = self.ring.tour[index]
        self.stale = False

    def _kick(self) -> int:
        """Make a double bridge: put three neighbouring paths in reverse order. Returns the loss.

        The cities at the cuts are woken. No exchange of three edges undoes this kick.
        """
        if self.stream.random() >= SPATIAL or not self._near_cuts() or self._cuts_fixed():
            self._short_cuts()
            for _ in range(TRIES):
                if not self._cuts_fixed():
                    break
                self._short_cuts()
            if self._cuts_fixed():
                return 0
        loss = 0
        for place in range(4):
            last, first = self._beside(place, 0), self._beside(place, 1)
            loss -= self.ring.edge(last, first)
            self.ring.wake(last)
            self.ring.wake(first)
        loss += (
            self._new_edge(0, 2)
            + self._new_edge(3, 1)
            + self._new_edge(2, 0)
            + self._new_edge(1, 3)
        )
        for place in range(3):
            self.ring.note((self.cuts[place] + 1) % self.n, self.cuts[place + 1])
        self.ring.note((self.cuts[0] + 1) % self.n, self.cuts[3])
        return loss

    def _cuts_fixed(self) -> bool:
        """Whether a cut parts two cities that must stay together."""
        for place in range(4):
            if self.ring.fixed(self._beside(place, 0), self._beside(place, 1)):
                return True
        return False

    def _beside(self, place: int, side: int) -> int:
        """The city before a cut, or the city after it."""
        return self.ring.tour[(self.cuts[place] + side) % self.n]

    def _new_edge(self, place: int, other: int) -> int:
        """The cost of going on from one cut after another."""
        return self.ring.edge(self._beside(place, 0), self._beside(other, 1))

    def _near_cuts(self) -> bool:
        """Cut at four different places whose cities are close to each other in space, in the order
        of the tour.

        The cuts are rotated so that the longest path lies between the last and the first. Returns
        False if four such places were not found.
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
        if self.n - longest > SPAN:
            return False
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
        """Cut at four different places that are close to each other along the tour."""
        limit = max(1, min(SEGMENT, (self.n - 2) // 3))
        self.cuts[0] = self.stream.below(self.n)
        for place in range(3):
            self.cuts[place + 1] = (self.cuts[place] + 1 + self.stream.below(limit)) % self.n
