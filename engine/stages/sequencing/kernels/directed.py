# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Annealing over orders whose costs depend on the direction, or on the visits before.

A move puts a stretch of the order at another place, in the same direction or reversed. Without
windows, precedence and reversal, only the changed arcs are priced; else the whole order is priced.
"""

import numpy as np

from cellwright.engine.kernels.arrays import Ints, Longs, whole
from cellwright.engine.stages.sequencing.kernels.twister import Stream

LONGEST = 30


def price(order: Ints, arcs: Longs, closed: bool, times: Longs, pairs: Longs, fine: Longs) -> int:
    """The cost of an order with fines.

    fine[0] is paid for each unit of lateness, fine[1] for each pair (m, 2) in the wrong order.
    `times` (3, n) are durations, earliest beginnings and latest beginnings.
    """
    return Orders(order, arcs, closed, times, pairs, fine).price()


def anneal(
    order: Ints,
    arcs: Longs,
    near: Ints,
    closed: bool,
    low: int,
    high: int,
    times: Longs,
    pairs: Longs,
    fine: Longs,
    moves: int,
    warmth: float,
    cooling: float,
    seed: int,
) -> tuple[Ints, int, float]:
    """Anneal over `moves` moves of the positions low..high - 1; the other positions stay as they
    are.

    `order` (n,) is changed in place; `near` (n, k) are cities from which each city is near. Fines
    of 0 mean that there are neither windows nor precedence. Returns the best order, its price and
    the final warmth.
    """
    orders = Orders(order, arcs, closed, times, pairs, fine)
    annealed = Annealing(orders, near, low, high, seed)
    warmth = annealed.run(moves, warmth, cooling)
    return np.array(annealed.kept), annealed.best, warmth


class Orders:
    """An order (n,) that is changed in place, a move of it, and prices. The arrays are those of
    `price`.

    `moved` has the cities between the positions `start` and `end` after the move. Raises ValueError
    if shapes do not agree.
    """

    def __init__(
        self, order: Ints, arcs: Longs, closed: bool, times: Longs, pairs: Longs, fine: Longs
    ) -> None:
        n = self.n = len(order)
        if (arcs.shape, times.shape, pairs.shape[1:], fine.shape) != (
            (n, n),
            (3, n),
            (2,),
            (2,),
        ) or not n:
            raise ValueError("arcs (n, n), times (3, n), pairs (m, 2) and two fines were expected")
        for cities in (order, pairs):
            if cities.size and not 0 <= cities.min() <= cities.max() < n:
                raise ValueError(f"cities are numbered 0 to {n - 1}")
        self.order, self.arcs, self.times = whole(order), whole(arcs), whole(times)
        self.pairs, self.count = whole(pairs), len(pairs)
        self.late, self.wrong, self.closed = int(fine[0]), int(fine[1]), bool(closed)
        self.moved, self.rank = whole(order.copy()), whole(np.argsort(order).astype(np.int32))
        self.start, self.end = 0, -1

    def price(self) -> int:
        """The cost of the order after the move, with fines."""
        total = late = wrong = 0
        clock = before = 0
        for index in range(self.n):
            city = self.moved[index] if self.start <= index <= self.end else self.order[index]
            if index:
                step = self.arcs[before, city]
                total += step
                clock += step + self.times[0, before]
            clock = max(clock, self.times[1, city])
            late += max(0, clock - self.times[2, city])
            self.rank[city] = index
            before = city
        for pair in range(self.count):
            wrong += self.rank[self.pairs[pair, 0]] > self.rank[self.pairs[pair, 1]]
        if self.closed:
            first = self.moved[0] if self.start <= 0 <= self.end else self.order[0]
            total += self.arcs[before, first]
        return total + self.late * late + self.wrong * wrong

    def move(self, first: int, last: int, behind: int, turned: bool) -> None:
        """Put the stretch first..last behind the position `behind` outside it; -1 means the
        front.
        """
        length = last - first + 1
        if behind < first:
            self.start, self.end, at = behind + 1, last, behind + 1
            for index in range(behind + 1, first):
                self.moved[index + length] = self.order[index]
        else:
            self.start, self.end, at = first, behind, behind + 1 - length
            for index in range(last + 1, behind + 1):
                self.moved[index - length] = self.order[index]
        for step in range(length):
            self.moved[at + step] = self.order[last - step] if turned else self.order[first + step]

    def difference(self, first: int, last: int, behind: int) -> int:
        """How much a move of a stretch without reversal changes the cost."""
        n = self.n
        if self.closed and ((first == 0 and behind == n - 1) or (last == n - 1 and behind == -1)):
            return 0  # the circle stays the same
        head, tail = self.order[first], self.order[last]
        before, beyond = self._city(first - 1), self._city(last + 1)
        left, right = self._city(behind), self._city(behind + 1)
        change = 0
        if before >= 0:
            change -= self.arcs[before, head]
        if beyond >= 0:
            change -= self.arcs[tail, beyond]
        if before >= 0 and beyond >= 0:
            change += self.arcs[before, beyond]
        if left >= 0 and right >= 0:
            change -= self.arcs[left, right]
        if left >= 0:
            change += self.arcs[left, head]
        if right >= 0:
            change += self.arcs[tail, right]
        return change

    def _city(self, position: int) -> int:
        """The city at a position.

        Just outside the order it is the city at the other end of a closed tour, else -1.
        """
        if 0 <= position < self.n:
            return self.order[position]
        if self.closed:
            return self.order[0 if position > 0 else self.n - 1]
        return -1


class Annealing:
    """Random moves of the positions low..high - 1.

    `kept` is the best order so far, and `best` is its price.
    """

    def __init__(self, orders: Orders, near: Ints, low: int, high: int, seed: int) -> None:
        self.orders = orders
        order = np.asarray(self.orders.order)
        n = len(order)
        if (
            near.ndim != 2
            or len(near) != n
            or not near.size
            or not 0 <= near.min() <= near.max() < n
        ):
            raise ValueError(f"candidates (n, k) numbered 0 to {n - 1} were expected")
        if not 0 <= low < high <= n:
            raise ValueError(f"positions {low} to {high - 1} of {n} cannot be moved")
        self.stream, self.near, self.breadth = Stream(seed), whole(near), near.shape[1]
        self.low, self.high, self.first, self.last, self.behind = low, high, 0, 0, 0
        self.kept, self.place = whole(order.copy()), whole(np.argsort(order).astype(np.int32))
        self.best = orders.price()

    def run(self, moves: int, warmth: float, cooling: float) -> float:
        """Try this many moves. Returns the final warmth."""
        now = self.best
        for _ in range(moves):
            warmth *= cooling
            if not self._propose():
                continue
            turned = self.stream.random() < 0.3
            after = self._price_after(now, turned)
            if after > now and not self.stream.accepts(float(now - after) / max(warmth, 1e-9)):
                continue
            if self.orders.late == 0 and not turned:
                self.orders.move(self.first, self.last, self.behind, turned)
            self._take()
            now = after
            if now < self.best:
                self.best = now
                self._keep()
        return warmth

    def _propose(self) -> bool:
        """Choose a stretch and a place for it, mostly behind a city that is near its first city.

        Returns whether the move is allowed.
        """
        width = self.high - self.low
        first = self.low + self.stream.below(width)
        last = min(self.high - 1, first + self.stream.below(min(LONGEST, width)))
        if self.stream.random() < 0.3:
            last = min(self.high - 1, first + self.stream.below(min(3, width)))
        city = self.near[self.orders.order[first], self.stream.below(self.breadth)]
        if self.stream.random() < 0.8:
            behind = self.place[city]
        else:
            behind = self.low - 1 + self.stream.below(width + 1)
        self.first, self.last, self.behind = first, last, behind
        if (
            (first - 1 <= behind <= last and first > 0)
            or behind >= self.high
            or behind < self.low - 1
        ):
            return False
        return first > 0 or not (behind <= last or last == self.orders.n - 1)

    def _price_after(self, now: int, turned: bool) -> int:
        """The price after the move.

        If the changed arcs do not determine it, the whole order is priced.
        """
        if self.orders.late == 0 and not turned:
            return now + self.orders.difference(self.first, self.last, self.behind)
        self.orders.move(self.first, self.last, self.behind, turned)
        return self.orders.price()

    def _take(self) -> None:
        """Make the move."""
        for index in range(self.orders.start, self.orders.end + 1):
            city = self.orders.moved[index]
            self.orders.order[index] = city
            self.place[city] = index

    def _keep(self) -> None:
        """Keep the order as the best one."""
        for index in range(self.orders.n):
            self.kept[index] = self.orders.order[index]
