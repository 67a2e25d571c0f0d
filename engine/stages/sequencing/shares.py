"""What shares of visits cost: the ways of one arm, and its best order for every set of few visits (Held & Karp 1962)."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.arrays import Longs
from cellwright.engine.model.metric import Metric
from cellwright.engine.model.tour import TourProblem

MUCH = 1 << 50  # what costs as much cannot be done


@dataclass(frozen=True)
class Ways:
    """The ways between the visits of a tour problem, changes of tools and stations with them."""

    problem: TourProblem

    def between(self, a: Longs, b: Longs) -> Longs:
        """What it costs to go from each visit of `a` to that of `b` at the same place; shapes are broadcast."""
        travel = self.problem.travel
        if isinstance(travel, Metric):
            found = travel.between(a.astype(np.int32), b.astype(np.int32))
        else:
            found = travel[a, b]
        if self.problem.changes or self.problem.shifts:
            kind, extra = self._kinds
            found = found + extra[kind[a], kind[b]]
        return np.asarray(found)

    @cached_property
    def _kinds(self) -> tuple[Longs, Longs]:
        kind, extra = self.problem.kinds
        return kind.astype(np.int64), extra


class Paths:
    """The least time that one arm takes for each set of visits; sets are bits."""

    def __init__(self, ways: "Ways", own: list[int]) -> None:
        """`own` is the number of each visit in the problem of the arm; -1 if it cannot make it."""
        problem, self.own = ways.problem, own
        self.start = -1 if problem.start is None else problem.start
        self.can = sum(1 << n for n, own in enumerate(self.own) if own >= 0)
        self.lasts = [problem.visits[own].duration if own >= 0 else 0 for own in self.own]
        index = np.array([max(own, 0) for own in self.own], np.int64)
        empty = np.zeros((len(own), len(own)), np.int64)
        self.arcs = ways.between(index[:, None], index[None]) if problem.visits else empty
        self.ends: dict[tuple[int, int], tuple[int, int]] = {}
        self.least: dict[int, int] = {0: 0}
        for bits in range(1, 1 << len(own)):
            if not bits & ~self.can:
                self.least[bits] = min(self._ending(bits, n)[0] for n in _members(bits))

    def _ending(self, bits: int, last: int) -> tuple[int, int]:
        """The least time for a set whose last visit is given, and the visit before that."""
        if (bits, last) not in self.ends:
            rest, own = bits & ~(1 << last), self.lasts[last]
            ways = ((self.ends[rest, n][0] + int(self.arcs[n, last]) + own, n) for n in _members(rest))
            starts = self.start < 0 or (self.own[last] == self.start) == (not rest)
            found = min(ways) if rest else (own, -1)
            self.ends[bits, last] = found if starts or found[0] >= MUCH else (MUCH, found[1])
        return self.ends[bits, last]

    def order(self, bits: int) -> tuple[int, ...]:
        """The visits of a set in the order that takes least time."""
        found = list[int]()
        last = min(_members(bits), key=lambda n: self.ends[bits, n][0], default=-1)
        while bits:
            found.append(self.own[last])
            bits, last = bits & ~(1 << last), self.ends[bits, last][1]
        return tuple(reversed(found))


def _members(bits: int) -> list[int]:
    return [n for n in range(bits.bit_length()) if bits >> n & 1]


def part(problem: TourProblem, members: list[int]) -> TourProblem:
    """The tour problem of some visits; pairs of which one is left out are left out."""
    number = {old: new for new, old in enumerate(members)}
    travel = problem.travel
    less = travel.part(members) if isinstance(travel, Metric) else travel[np.ix_(members, members)]
    pairs = tuple((number[a], number[b]) for a, b in problem.precedence if a in number and b in number)
    visits = tuple(problem.visits[n] for n in members)
    start = None if problem.start is None else number.get(problem.start)
    return replace(problem, visits=visits, travel=less, precedence=pairs, start=start)
