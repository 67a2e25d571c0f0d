# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Closed tours, and exchanges of two and three edges that make them shorter.

A tour is an array of cities with its inverse (`position`). Every change is the reversal of a
stretch of positions. A reversal is its own inverse, so a journal of reversals can undo changes.

An exchange is evaluated before anything is moved. Most exchanges are rejected, and then cost no
reversal. Lin & Kernighan 1973, all choices on the first levels; Bentley 1992 (queue of cities that
are worth a look).
"""

import numpy as np

from cellwright.engine.kernels.arrays import Ints, Longs, whole
from cellwright.engine.stages.sequencing.kernels.distances import Distances

ROOM = 8  # rows of the journal that one exchange may need
JOURNAL = 16384  # rows of the journal
TWO, TWO_TWICE, SWAPPED, TURNED = 1, 2, 3, 4


class Ring:
    """A tour (n,) that is changed in place, n >= 8, under symmetric costs.

    `near` (n, k) has the candidates of each city, nearest first; `toll` (n, k) has the costs to
    them. `mate` (n,) has the city to which the edge of a city must stay, or -1. A queue holds the
    cities that are worth a look. Raises ValueError if shapes do not agree.
    """

    def __init__(
        self, tour: Ints, distances: Distances, near: Ints, toll: Longs, mate: Ints
    ) -> None:
        self.n, self.count = len(tour), near.shape[1]
        _check(tour, distances.n, near, toll, mate)
        self.distances, self.tour, self.near, self.toll = (
            distances,
            whole(tour),
            whole(near),
            whole(toll),
        )
        self.mate = whole(mate)
        self.position, self.queue, self.waiting = (
            whole(np.zeros(self.n, np.int32)) for _ in range(3)
        )
        self.journal, self.noting = whole(np.zeros((JOURNAL, 2), np.int32)), True
        self.rows, self.written, self.head, self.size = len(self.journal), 0, 0, 0
        self.kind = self.t2 = self.t3 = self.t4 = self.t5 = self.t6 = 0
        self.beside, self.ways = (
            whole(np.full((self.n, 2), -1, np.int32)),
            whole(np.zeros((self.n, 2), np.int64)),
        )
        self._begin()

    def _begin(self) -> None:
        """Note the position of each city."""
        for index in range(self.n):
            self.position[self.tour[index]] = index

    def edge(self, a: int, b: int) -> int:
        """The cost from one city to another."""
        return self.distances.between(a, b)

    def link(self, a: int, b: int) -> int:
        """The cost from a city to one that was lately beside it in the tour: the last two are
        kept for each city.
        """
        if self.beside[a, 0] == b:
            return self.ways[a, 0]
        if self.beside[a, 1] == b:
            return self.ways[a, 1]
        self.beside[a, 1], self.ways[a, 1] = self.beside[a, 0], self.ways[a, 0]
        self.beside[a, 0], self.ways[a, 0] = b, self.distances.between(a, b)
        return self.ways[a, 0]

    def fixed(self, a: int, b: int) -> bool:
        """Whether the edge between two neighbours must stay."""
        return self.mate[a] == b

    def wake(self, city: int) -> None:
        """Put a city at the end of the queue, unless it is in the queue already."""
        if self.waiting[city] == 0:
            self.waiting[city] = 1
            self.queue[(self.head + self.size) % self.n] = city
            self.size += 1

    def reverse(self, first: int, last: int) -> None:
        """Reverse the positions from `first` to `last`, cyclically: the stretch between them,
        not the rest.
        """
        n, length = self.n, last - first + 1
        if length <= 0:
            length += n
        for _ in range(length // 2):
            a, b = self.tour[first], self.tour[last]
            self.tour[first], self.position[b] = b, first
            self.tour[last], self.position[a] = a, last
            first = first + 1 if first + 1 < n else 0
            last = last - 1 if last > 0 else n - 1

    def note(self, first: int, last: int) -> None:
        """Reverse positions, and add this to the journal if there is one."""
        self.reverse(first, last)
        if self.noting:
            if self.written < self.rows:
                self.journal[self.written, 0], self.journal[self.written, 1] = first, last
            self.written += 1

    def back(self) -> None:
        """Undo the reversals in the journal. They stay there."""
        for row in range(self.written - 1, -1, -1):
            self.reverse(self.journal[row, 0], self.journal[row, 1])

    def forth(self) -> None:
        """Make the reversals in the journal again."""
        for row in range(self.written):
            self.reverse(self.journal[row, 0], self.journal[row, 1])

    def settle(self) -> int:
        """Exchange edges around the cities in the queue until no exchange gains.

        Returns the gain.
        """
        gain = 0
        while self.size > 0:
            city = self.queue[self.head]
            self.head = (self.head + 1) % self.n
            self.size -= 1
            self.waiting[city] = 0
            gain += self._improve(city)
        self.head = 0
        return gain

    def _improve(self, city: int) -> int:
        """Exchange edges beside a city until no exchange gains or the journal is full.

        Returns the gain.
        """
        gain = idle = 0
        forward = True
        while idle < 2 and self.written + ROOM < self.rows:
            won = self._best_exchange(city, forward)
            if won > 0:
                self._apply(forward)
                gain += won
                idle = 0
                self._wake_ends()
            else:
                idle += 1
                forward = not forward
        return gain

    def _wake_ends(self) -> None:
        """Put the ends of the exchanged edges into the queue again."""
        self.wake(self.t2)
        self.wake(self.t3)
        self.wake(self.t4)
        if self.kind != TWO:
            self.wake(self.t5)
            self.wake(self.t6)

    def _step(self, forward: bool, city: int) -> int:
        """The next city in one direction."""
        at = self.position[city]
        if forward:
            return self.tour[0 if at + 1 == self.n else at + 1]
        return self.tour[self.n - 1 if at == 0 else at - 1]

    def _within(self, forward: bool, first: int, city: int, last: int) -> bool:
        """Whether `city` lies on the way from `first` to `last` in the given direction."""
        a, b, c = self.position[first], self.position[city], self.position[last]
        if not forward:
            a, c = c, a
        if a <= c:
            return a <= b <= c
        return b >= a or b <= c

    def _best_exchange(self, t1: int, forward: bool) -> int:
        """The gain of the best exchange that removes the edge after `t1`.

        `kind` and `t2` to `t6` describe this exchange.
        """
        t2 = self._step(forward, t1)
        beyond = self._step(forward, t2)
        if self.fixed(t1, t2):
            return 0
        best, removed = 0, self.link(t1, t2)
        for rank in range(self.count):
            t3 = self.near[t2, rank]
            left = removed - self.toll[t2, rank]
            if left <= 0:
                break
            if t3 in (t1, beyond):
                continue
            t4 = self._step(not forward, t3)
            if not self.fixed(t3, t4):
                gain = left + self.link(t3, t4)
                closed = self._closed(gain, best, t4, t1)
                if closed > best:
                    best = closed
                    self._keep(TWO, t2, t3, t4, 0, 0)
                best = self._second_turn(forward, gain, best, t1, t2, t3, t4)
            t4 = self._step(forward, t3)
            if not self.fixed(t3, t4):
                best = self._opened_cycle(forward, left + self.link(t3, t4), best, t1, t2, t3, t4)
        return best

    def _closed(self, gain: int, best: int, last: int, first: int) -> int:
        """What is left of a gain when the tour is closed; no edge is looked at where nothing
        better can come of it.
        """
        return gain - self.edge(last, first) if gain > best else gain

    def _keep(self, kind: int, t2: int, t3: int, t4: int, t5: int, t6: int) -> None:
        """Note the best exchange so far."""
        self.kind, self.t2, self.t3, self.t4, self.t5, self.t6 = kind, t2, t3, t4, t5, t6

    def _second_turn(
        self, forward: bool, gain: int, best: int, t1: int, t2: int, t3: int, t4: int
    ) -> int:
        """The best gain so far, after a try of a second two-edge exchange at t1: first t2..t4
        is reversed.
        """
        follower = self._step(not forward, t4)
        for rank in range(self.count):
            t5 = self.near[t4, rank]
            left = gain - self.toll[t4, rank]
            if left <= best:
                break
            if t5 in (t1, t3, follower):
                continue
            t6 = self._step(forward == self._within(forward, t2, t5, t4), t5)
            if self.fixed(t5, t6):
                continue
            closed = self._closed(left + self.link(t5, t6), best, t6, t1)
            if closed > best:
                best = closed
                self._keep(TWO_TWICE, t2, t3, t4, t5, t6)
        return best

    def _opened_cycle(
        self, forward: bool, gain: int, best: int, t1: int, t2: int, t3: int, t4: int
    ) -> int:
        """The cycle t2..t3, which the first two exchanges cut off, is opened and put between t4
        and t1 again.
        """
        for rank in range(self.count):
            t5 = self.near[t4, rank]
            left = gain - self.toll[t4, rank]
            if left <= best:
                break
            if t5 == t3 or not self._within(forward, t2, t5, t3):
                continue
            for side in range(2):
                t6 = self._step(forward == (side == 0), t5)
                if (side == 1 and t5 == t2) or self.fixed(t5, t6):
                    continue
                closed = self._closed(left + self.link(t5, t6), best, t6, t1)
                if closed > best:
                    best = closed
                    self._keep(TURNED if side else SWAPPED, t2, t3, t4, t5, t6)
        return best

    def _turn(self, forward: bool, first: int, last: int) -> bool:
        """Reverse the path from city `first` to city `last`, or the rest if that is shorter.

        Returns the new forward direction.
        """
        start, end = self.position[first], self.position[last]
        if not forward:
            start, end = end, start
        length = end - start + 1
        if length <= 0:
            length += self.n
        if 2 * length > self.n:
            self.note((end + 1) % self.n, (start + self.n - 1) % self.n)
            return not forward
        self.note(start, end)
        return forward

    def _apply(self, forward: bool) -> None:
        """Make the exchange that was found."""
        if self.kind == TWO:
            self._turn(forward, self.t2, self.t4)
        elif self.kind == TWO_TWICE:
            forward = self._turn(forward, self.t2, self.t4)
            self._turn(forward, self.t4, self.t6)
        elif self.kind == TURNED:
            forward = self._turn(forward, self.t2, self.t6)
            self._turn(forward, self.t5, self.t3)
        else:
            forward = self._turn(forward, self.t2, self.t5)
            forward = self._turn(forward, self.t6, self.t3)
            self._turn(forward, self.t5, self.t6)


def _check(tour: Ints, cities: int, near: Ints, toll: Longs, mate: Ints) -> None:
    """Raises ValueError if arrays do not fit together: compiled loops do not check this."""
    n = len(tour)
    if (
        n < 8
        or cities != n
        or near.shape[:1] != (n,)
        or toll.shape != near.shape
        or mate.shape != (n,)
    ):
        shapes = f"{tour.shape}, costs of {cities}, candidates {near.shape}, tolls {toll.shape}"
        raise ValueError(
            f"eight cities or more, (n,), of n, (n, k) and (n, k) were expected, not {shapes}"
        )
    for cities_of in (tour, near):
        if cities_of.size and not 0 <= cities_of.min() <= cities_of.max() < n:
            raise ValueError(f"cities are numbered 0 to {n - 1}")
