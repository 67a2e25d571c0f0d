"""Whether a network is dynamically controllable, with a cycle that shows why if it is not."""

from cellwright.engine.model.uncertain_times import (
    Controllable,
    CycleEdge,
    DerivedBound,
    DispatchableNetwork,
    EdgeKind,
    NegativeCycle,
    UncertainNetwork,
)
from cellwright.engine.stages.uncertainty.bypass_search import BypassSearch
from cellwright.engine.stages.uncertainty.dispatchable_form import dispatchable_form

NOTHING = -1  # in the arrays of the search


def check_controllability(network: UncertainNetwork) -> Controllable | NegativeCycle:
    """Whether some policy that sees which links have ended keeps all bounds.

    Whoever acts may act at the very moment when a link ends. The cycle passes `replay_cycle`.
    """
    search = _search_of(network)
    return Controllable() if search.run() else _CycleReading(search).cycle()


def find_policy(network: UncertainNetwork) -> DispatchableNetwork | NegativeCycle:
    """A policy that keeps all bounds, however long the links take, or why there is none."""
    search = _search_of(network)
    return dispatchable_form(network, search) if search.run() else _CycleReading(search).cycle()


def _search_of(network: UncertainNetwork) -> BypassSearch:
    return BypassSearch(
        len(network.points),
        [(bound.earlier, bound.later, bound.most) for bound in network.bounds],
        [(link.start, link.end, link.least, link.most) for link in network.links],
    )


class _CycleReading:
    """Reads the cycle out of a search that ended without success."""

    def __init__(self, search: BypassSearch) -> None:
        self.search = search
        self.numbers: dict[int, int] = {}  # of derived bounds, by their edges
        self.derived: list[DerivedBound] = []

    def cycle(self) -> NegativeCycle:
        """The cycle, with only those derived bounds that it uses."""
        search = self.search
        if search.closing_link != NOTHING:
            waits = tuple(
                DerivedBound(link, self._read(self._path(link, search.starts[following])))
                for link, following in self._open_pairs()
            )
            return NegativeCycle(tuple(self.derived), waits=waits)
        if search.late_link != NOTHING:
            return self._waiting_for_itself(search.late_link, search.early_point)
        edges = self._read(self._loop())
        return NegativeCycle(tuple(self.derived), edges=edges)

    def _open_pairs(self) -> list[tuple[int, int]]:
        """The open links from the one that closes the cycle on, each with the link that it waits
        for; in the order in which each begins where the next one leads to.
        """
        opened = [self.search.stack[place] for place in range(self.search.depth)]
        opened = opened[opened.index(self.search.closing_link) :]
        return list(zip(opened, [*opened[1:], opened[0]], strict=True))[::-1]

    def _waiting_for_itself(self, link: int, early: int) -> NegativeCycle:
        """A point that comes before the end of a link, and waits for it: if the link is short, the
        point comes soon after its start, so the start waits for its own link.
        """
        search, edges = self.search, list[int]()
        point = early
        while point != search.ends[link]:
            edges.append(search.parents[point])
            point = search.tails[edges[-1]]
        edges = [search.first_link + 2 * link + 1, *edges[::-1], *self._path(link, early)]
        bound = DerivedBound(link, self._read(edges))
        slack = search.most[link] - search.weights[search.first_link + 2 * link + 1]
        if sum(search.weights[edge] for edge in edges) < slack:
            return NegativeCycle(tuple(self.derived), waits=(bound,))
        closed = (CycleEdge(EdgeKind.DERIVED, len(self.derived)),)
        return NegativeCycle((*self.derived, bound), edges=closed)

    def _loop(self) -> list[int]:
        """The edges of a closed path, one after another."""
        search = self.search
        if search.cycle_edge != NOTHING:
            edges = [search.cycle_edge]
            start = search.tails[search.cycle_edge]
        else:
            start = search.cycle_point
            edges = [search.parents[start]]
        while search.heads[edges[-1]] != start:
            edges.append(search.parents[search.heads[edges[-1]]])
        return edges

    def _path(self, link: int, point: int) -> list[int]:
        """The edges that lead from a point to the end of a link, as the search found them."""
        row, edges = link * self.search.points, list[int]()
        while point != self.search.ends[link]:
            edges.append(self.search.trees[row + point])
            point = self.search.heads[edges[-1]]
        return edges

    def _read(self, edges: list[int]) -> tuple[CycleEdge, ...]:
        """Edges as they are told; the derived ones among them are read first."""
        for edge in edges:
            if edge >= self.search.first_bypass:
                self._derive(edge)
        return tuple(self._edge(edge) for edge in edges)

    def _derive(self, last: int) -> None:
        """Read a derived bound after those that it uses."""
        pending = [last]
        while pending:
            edge = pending[-1]
            if edge in self.numbers:
                pending.pop()
                continue
            path = self._path(self.search.origins[edge], self.search.tails[edge])
            unread = [
                part
                for part in path
                if part >= self.search.first_bypass and part not in self.numbers
            ]
            if unread:
                pending += unread
                continue
            pending.pop()
            self.numbers[edge] = len(self.derived)
            parts = tuple(self._edge(part) for part in path)
            self.derived.append(DerivedBound(self.search.origins[edge], parts))

    def _edge(self, edge: int) -> CycleEdge:
        search = self.search
        if edge < search.first_link:
            return CycleEdge(EdgeKind.BOUND, edge)
        if edge >= search.first_bypass:
            return CycleEdge(EdgeKind.DERIVED, self.numbers[edge])
        link, shortest = divmod(edge - search.first_link, 2)
        return CycleEdge(EdgeKind.SHORTEST if shortest else EdgeKind.AT_LEAST, link)
