# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True
"""Closed tours, and exchanges of two and three edges that make them shorter.

A tour is an array of cities with its inverse (`position`). Every change is the reversal of a stretch of
positions. A reversal is its own inverse, so a journal of reversals can undo changes.

An exchange is evaluated before anything is moved. Most exchanges are rejected, and then cost no reversal. Lin
& Kernighan 1973, all choices on the first levels; Bentley 1992 (queue of cities that are worth a look).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.kernels.arrays import Ints, whole

ROOM = 8  # rows of the journal that one exchange may need
TWO, TWO_TWICE, SWAPPED, TURNED = 1, 2, 3, 4


class Ring:
    """A tour (n,) that is changed in place, n >= 8, under symmetric costs (n, n) of 32 or 64 bits.

    `near` (n, k) has the candidates of each city, nearest first; `toll` (n, k) has the costs to them. A queue
    holds the cities that are worth a look. Raises ValueError if shapes do not agree.
    """

    def __init__(self, tour: Ints, cost: NDArray[Any], near: Ints, toll: NDArray[Any]) -> None:
        self.n, self.count = len(tour), near.shape[1]
        _check(tour, cost, near, toll)
        narrow = cost.dtype == np.int32
        none: NDArray[Any] = np.zeros((1, 1), np.int64 if narrow else np.int32)
        self.is_narrow, self.tour, self.near = narrow, whole(tour), whole(near)
        self.narrow_cost, self.wide_cost = map(whole, (cost, none) if narrow else (none, cost))
        self.narrow_toll, self.wide_toll = map(whole, (toll, none) if narrow else (none, toll))
        self.position, self.queue, self.waiting = (whole(np.zeros(self.n, np.int32)) for _ in range(3))
        self.journal = whole(np.zeros((max(40 * self.n, 4096), 2), np.int32))
        self.rows, self.written, self.head, self.size = len(self.journal), 0, 0, 0
        self.kind = self.t2 = self.t3 = self.t4 = self.t5 = self.t6 = 0
        self._begin()

    def _begin(self) -> None:
        """Note the position of each city."""
        for index in range(self.n):
            self.position[self.tour[index]] = index

    def edge(self, a: int, b: int) -> int:
        """The cost from one city to another."""
        if self.is_narrow:
            return self.narrow_cost[a, b]
        return self.wide_cost[a, b]

    def wake(self, city: int) -> None:
        """Put a city at the end of the queue, unless it is in the queue already."""
        if self.waiting[city] == 0:
            self.waiting[city] = 1
            self.queue[(self.head + self.size) % self.n] = city
            self.size += 1

    def reverse(self, first: int, last: int) -> None:
        """Reverse the positions from `first` to `last`, cyclically: the stretch between them, not the rest."""
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
        """Reverse positions and add this to the journal."""
        self.reverse(first, last)
        if self.written < self.rows:
            self.journal[self.written, 0], self.journal[self.written, 1] = first, last
        self.written += 1

    def undo(self) -> None:
        """Undo the reversals in the journal."""
        while self.written > 0:
            self.written -= 1
            self.reverse(self.journal[self.written, 0], self.journal[self.written, 1])

    def settle(self) -> int:
        """Exchange edges around the cities in the queue until no exchange gains. Returns the gain."""
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
        """Exchange edges beside a city until no exchange gains or the journal is full. Returns the gain."""
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

    def _toll(self, city: int, rank: int) -> int:
        """The cost to a candidate."""
        if self.is_narrow:
            return self.narrow_toll[city, rank]
        return self.wide_toll[city, rank]

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
        best, removed = 0, self.edge(t1, t2)
        for rank in range(self.count):
            t3 = self.near[t2, rank]
            left = removed - self._toll(t2, rank)
            if left <= 0:
                break
            if t3 in (t1, beyond):
                continue
            t4 = self._step(not forward, t3)
            gain = left + self.edge(t3, t4)
            if gain - self.edge(t4, t1) > best:
                best = gain - self.edge(t4, t1)
                self._keep(TWO, t2, t3, t4, 0, 0)
            best = self._second_turn(forward, gain, best, t1, t2, t3, t4)
            t4 = self._step(forward, t3)
            best = self._opened_cycle(forward, left + self.edge(t3, t4), best, t1, t2, t3, t4)
        return best

    def _keep(self, kind: int, t2: int, t3: int, t4: int, t5: int, t6: int) -> None:
        """Note the best exchange so far."""
        self.kind, self.t2, self.t3, self.t4, self.t5, self.t6 = kind, t2, t3, t4, t5, t6

    def _second_turn(self, forward: bool, gain: int, best: int, t1: int, t2: int, t3: int, t4: int) -> int:
        """The best gain so far, after a try of a second two-edge exchange at t1: first t2..t4 is reversed."""
        follower = self._step(not forward, t4)
        for rank in range(self.count):
            t5 = self.near[t4, rank]
            left = gain - self._toll(t4, rank)
            if left <= best:
                break
            if t5 in (t1, t3, follower):
                continue
            t6 = self._step(forward == self._within(forward, t2, t5, t4), t5)
            closed = left + self.edge(t5, t6) - self.edge(t6, t1)
            if closed > best:
                best = closed
                self._keep(TWO_TWICE, t2, t3, t4, t5, t6)
        return best

    def _opened_cycle(self, forward: bool, gain: int, best: int, t1: int, t2: int, t3: int, t4: int) -> int:
        """The cycle t2..t3, which the first two exchanges cut off, is opened and put between t4 and t1 again."""
        for rank in range(self.count):
            t5 = self.near[t4, rank]
            left = gain - self._toll(t4, rank)
            if left <= best:
                break
            if t5 == t3 or not self._within(forward, t2, t5, t3):
                continue
            for side in range(2):
                if side == 1 and t5 == t2:
                    continue
                t6 = self._step(forward == (side == 0), t5)
                closed = left + self.edge(t5, t6) - self.edge(t6, t1)
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


def _check(tour: Ints, cost: NDArray[Any], near: Ints, toll: NDArray[Any]) -> None:
    """Raises ValueError if arrays do not fit together: compiled loops do not check this."""
    n = len(tour)
    if n < 8 or cost.shape != (n, n) or near.shape[:1] != (n,) or toll.shape != near.shape:
        shapes = f"{tour.shape}, costs {cost.shape}, candidates {near.shape}, tolls {toll.shape}"
        raise ValueError(f"eight cities or more, (n, n), (n, k) and (n, k) were expected, not {shapes}")
    for cities in (tour, near):
        if cities.size and not 0 <= cities.min() <= cities.max() < n:
            raise ValueError(f"cities are numbered 0 to {n - 1}")
