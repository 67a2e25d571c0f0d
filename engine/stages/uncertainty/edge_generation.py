"""The slow, plain way: all bounds and waits that follow, until nothing new comes.

Morris & Muscettola (2005), with the reaction at once of Morris (2006). It shares nothing with the
kernel. What comes of it is complete: every bound and every wait between two points is there.
"""

import itertools
from dataclasses import dataclass, field

from cellwright.engine.model.uncertain_times import UncertainNetwork

UNBOUNDED = 1 << 60


@dataclass
class BoundClosure:
    """The tightest bounds that follow: `bounds[x][y]` is the most by which y comes after x.

    `waits[i][x]` is the length of the wait of x for link i: x comes neither before its end nor
    before `-waits[i][x]` after its start.
    """

    network: UncertainNetwork
    bounds: list[list[int]] = field(default_factory=list)
    waits: list[list[int]] = field(default_factory=list)
    changed: bool = True

    def __post_init__(self) -> None:
        size, links = len(self.network.points), self.network.links
        self.bounds = [[UNBOUNDED] * size for _ in range(size)]
        self.waits = [[UNBOUNDED] * size for _ in links]
        for point in range(size):
            self.bounds[point][point] = 0
        for bound in self.network.bounds:
            self._bound(bound.earlier, bound.later, bound.most)
        for number, link in enumerate(links):
            self._bound(link.start, link.end, link.most)
            self._bound(link.end, link.start, -link.least)
            self.waits[number][link.end] = -link.most

    def _bound(self, earlier: int, later: int, most: int) -> None:
        if most < self.bounds[earlier][later]:
            self.bounds[earlier][later], self.changed = most, True

    def _wait(self, link: int, point: int, length: int) -> None:
        if length < self.waits[link][point]:
            self.waits[link][point], self.changed = length, True

    def close(self) -> bool:
        """Whether a policy exists; then everything that follows is there."""
        size, links = len(self.network.points), len(self.network.links)
        for _ in range(size * size + size * links + links + 2):
            if not self._consistent():
                return False
            if not self.changed:
                return True
            self.changed = False
            self._add_up()
            for link in range(links):
                self._spread_waits(link)
                self._shorten(link)
        return False

    def _add_up(self) -> None:
        """No-case reduction: two bounds one after another."""
        size = range(len(self.network.points))
        for middle, first in itertools.product(size, size):
            if self.bounds[first][middle] < UNBOUNDED:
                for last in size:
                    if self.bounds[middle][last] < UNBOUNDED:
                        total = self.bounds[first][middle] + self.bounds[middle][last]
                        self._bound(first, last, total)

    def _spread_waits(self, number: int) -> None:
        """Upper-case reduction, cross-case reduction, and waits that are bounds (label removal)."""
        link, row = self.network.links[number], self.waits[number]
        size = range(len(self.network.points))
        for first, middle in itertools.product(size, size):
            if row[middle] < UNBOUNDED and self.bounds[first][middle] < UNBOUNDED:
                self._wait(number, first, self.bounds[first][middle] + row[middle])
        for other_number, other in enumerate(self.network.links):
            if other_number != number and row[other.end] < -link.least:
                self._wait(number, other.start, other.least + row[other.end])
        for point in size:
            if row[point] < UNBOUNDED and row[point] >= -link.least:
                self._bound(point, link.start, row[point])

    def _shorten(self, number: int) -> None:
        """Lower-case reduction: what comes before the end of a link reckons with the shortest."""
        link = self.network.links[number]
        for last in range(len(self.network.points)):
            if self.bounds[link.end][last] < 0:
                self._bound(link.start, last, link.least + self.bounds[link.end][last])

    def _consistent(self) -> bool:
        """Whether bounds and waits fit together where each link takes as long as it can."""
        size = range(len(self.network.points))
        latest = [list(row) for row in self.bounds]
        for number, link in enumerate(self.network.links):
            for point in size:
                latest[point][link.start] = min(
                    latest[point][link.start], self.waits[number][point]
                )
        for middle, first in itertools.product(size, size):
            if latest[first][middle] < UNBOUNDED:
                for last in size:
                    total = latest[first][middle] + latest[middle][last]
                    if latest[middle][last] < UNBOUNDED and total < latest[first][last]:
                        latest[first][last] = total
        return all(latest[point][point] >= 0 for point in size)


def has_policy(network: UncertainNetwork) -> bool:
    """Whether some policy keeps all bounds, however long the links take."""
    return BoundClosure(network).close()
