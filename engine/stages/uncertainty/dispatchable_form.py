"""The dispatchable form of a controllable network: what each point waits for, and nothing else.

All bounds and waits that follow are computed in matrices (Morris & Muscettola 2005), from the
bypasses on that the search has found, so that few rounds are needed. Bounds that follow from two
others are then left out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.model.uncertain_times import (
    ORIGIN,
    DifferenceBound,
    DispatchableNetwork,
    UncertainNetwork,
    WaitBound,
)
from cellwright.engine.stages.uncertainty.bypass_search import BypassSearch

Lengths = NDArray[np.int64]
UNBOUNDED = 1 << 40  # longer than any path
BARELY = UNBOUNDED // 2  # what is longer is no bound


def dispatchable_form(network: UncertainNetwork, search: BypassSearch) -> DispatchableNetwork:
    """What a policy has to look at, for a network that the search has found controllable.

    Each point comes as soon as its bounds and waits allow.
    """
    closure = _MatrixClosure.of(network, search)
    closure.close()
    return _reduced(closure)


@dataclass
class _MatrixClosure:
    """`most[x, y]` is the most by which y comes after x; `waits[i, x]` is the negative length of
    the wait of x for link i.
    """

    network: UncertainNetwork
    most: Lengths
    waits: Lengths

    @classmethod
    def of(cls, network: UncertainNetwork, search: BypassSearch) -> "_MatrixClosure":
        size = len(network.points)
        most = np.full((size, size), UNBOUNDED, np.int64)
        np.fill_diagonal(most, 0)
        edges = [(bound.earlier, bound.later, bound.most) for bound in network.bounds]
        edges += [(point, ORIGIN, 0) for point in range(size)]
        for link in network.links:
            edges += [(link.start, link.end, link.most), (link.end, link.start, -link.least)]
        edges += [
            (search.tails[edge], search.heads[edge], search.weights[edge])
            for edge in range(search.first_bypass, search.edges)
        ]
        tails, heads, weights = (np.array(column, np.int64) for column in zip(*edges, strict=True))
        np.minimum.at(most, (tails, heads), weights)
        waits = np.full((len(network.links), size), UNBOUNDED, np.int64)
        for number, link in enumerate(network.links):
            waits[number, link.end] = -link.most
        return cls(network, most, waits)

    def close(self) -> None:
        """Add what follows until nothing new comes."""
        while True:
            before = self.most.copy(), self.waits.copy()
            self._add_up()
            for number in range(len(self.network.links)):
                self._spread_waits(number)
            for link in self.network.links:
                row = self.most[link.end]
                shorter = np.where(row < 0, link.least + row, UNBOUNDED)
                self.most[link.start] = np.minimum(self.most[link.start], shorter)
            if (before[0] == self.most).all() and (before[1] == self.waits).all():
                return

    def _add_up(self) -> None:
        for middle in range(len(self.most)):
            row = self.most[middle]
            into = np.flatnonzero(self.most[:, middle] < BARELY)
            out = np.flatnonzero(row < BARELY)
            if len(into) > 1 and len(out) > 1:
                square = np.ix_(into, out)
                by = self.most[into, middle][:, None] + row[out][None, :]
                self.most[square] = np.minimum(self.most[square], by)

    def _spread_waits(self, number: int) -> None:
        """Waits for waiting points, waits across other links, and what every wait is at least."""
        link, row = self.network.links[number], self.waits[number]
        set_ = np.flatnonzero(row < BARELY)
        row[:] = np.minimum(row, (self.most[:, set_] + row[set_]).min(axis=1))
        for place, other in enumerate(self.network.links):
            if place != number and row[other.end] < -link.least:
                row[other.start] = min(row[other.start], other.least + row[other.end])
        sure = np.where(row < BARELY, np.maximum(row, -link.least), UNBOUNDED)
        self.most[:, link.start] = np.minimum(self.most[:, link.start], sure)


def _reduced(closure: _MatrixClosure) -> DispatchableNetwork:
    """The bounds and waits that do not follow from others, with points in an order that fits."""
    least = -closure.most.T  # least[x, y]: y comes at least so long after x
    follows = least >= 0
    order = np.lexsort((_ranks(closure.network), follows.sum(axis=0)))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    forward = follows & (place[:, None] < place[None, :])
    kept = forward.copy()
    for middle in range(len(least)):
        into, out = np.flatnonzero(forward[:, middle]), np.flatnonzero(forward[middle])
        if len(into) and len(out):
            square = np.ix_(into, out)
            by = least[into, middle][:, None] + least[middle, out][None, :]
            kept[square] &= by < least[square]
    ends = {link.end for link in closure.network.links}
    bounds = tuple(
        DifferenceBound(int(later), int(earlier), -int(least[earlier, later]))
        for earlier, later in np.argwhere(kept)
        if later not in ends
    )
    waits = [
        WaitBound(int(point), number, -int(row[point]))
        for number, (link, row) in enumerate(zip(closure.network.links, closure.waits, strict=True))
        for point in np.flatnonzero(row < -link.least)
        if point not in ends and point != link.start
    ]
    return DispatchableNetwork(tuple(map(int, order)), bounds, _needed(closure, waits, least))


def _ranks(network: UncertainNetwork) -> Lengths:
    """Of points that always come at the same time, which comes first: the end of a link that
    varies, then others, starts of links before their ends.
    """
    ranks = np.ones(len(network.points), np.int64)
    fixed = {link.end: link.start for link in network.links if link.slack == 0}
    for link in network.links:
        if link.slack:
            ranks[link.end] = 0
        else:
            point = link.end
            while point in fixed:
                point = fixed[point]
                ranks[link.end] += 1
    return ranks


def _needed(
    closure: _MatrixClosure, waits: list[WaitBound], least: Lengths
) -> tuple[WaitBound, ...]:
    """The waits without those that bounds keep: of points that come after the end of the link
    anyhow, or long enough after its start.
    """
    links = closure.network.links
    return tuple(
        wait
        for wait in waits
        if least[links[wait.link].end, wait.waiting] < 0
        and least[links[wait.link].start, wait.waiting] < wait.time
    )
