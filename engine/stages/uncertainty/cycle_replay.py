"""Checks a negative cycle by itself: each derived bound follows, and the whole contradicts itself.

Nothing is shared with the search. A derived bound follows from a path to the end of a link by three
rules (Morris & Muscettola 2005; Cairo, Hunsberger & Rizzi 2018):

- Edges that follow one another add up.
- A link may be as short as it can only where what follows has to come before its end: a piece of
  the path that begins there is negative. Or else where the rest of the path is shorter than what
  the link at the end of the path varies by: who acts then cannot wait for that end, so the short
  link has to be reckoned with. In that case it is never the link at the end of the path itself.
- The link at the end of the path may take as long as it can. If the path is not shorter than what
  it varies by, that holds whether the link has ended or not; else it is a wait.
"""

import itertools
from collections.abc import Sequence

from cellwright.engine.model.uncertain_times import (
    CycleEdge,
    DerivedBound,
    EdgeKind,
    NegativeCycle,
    UncertainNetwork,
)

WeightedEdge = tuple[int, int, int]  # from, to, weight


def replay_cycle(network: UncertainNetwork, cycle: NegativeCycle) -> str:
    """Why a cycle does not show that no policy exists; empty if it shows that."""
    return _CycleReplay(network, cycle).fault()


class _CycleReplay:
    def __init__(self, network: UncertainNetwork, cycle: NegativeCycle) -> None:
        self.network, self.told = network, cycle
        self.derived: list[WeightedEdge] = []

    def fault(self) -> str:
        """What is wrong first."""
        for number, bound in enumerate(self.told.derived):
            wrong, edge = self._follow(bound, waits=False)
            if wrong:
                return f"derived bound {number}: {wrong}"
            self.derived.append(edge)
        if self.told.waits:
            return self._fault_of_waits()
        edges, wrong = self._edges(self.told.edges)
        if wrong or not edges:
            return wrong or "the cycle is empty"
        if edges[0][0] != edges[-1][1]:
            return "the path is not closed"
        total = sum(weight for _, _, weight in edges)
        return "" if total < 0 else f"the cycle has length {total}"

    def _fault_of_waits(self) -> str:
        """What is wrong with links each of whose starts waits for another."""
        closed = []
        for number, wait in enumerate(self.told.waits):
            wrong, edge = self._follow(wait, waits=True)
            if wrong:
                return f"wait {number}: {wrong}"
            closed.append(edge)
        gaps = zip(closed, [*closed[1:], closed[0]], strict=True)
        return "" if all(one[1] == other[0] for one, other in gaps) else "the waits are not closed"

    def _follow(self, bound: DerivedBound, waits: bool) -> tuple[str, WeightedEdge]:
        """What is wrong with a derived bound, and the edge that follows."""
        link = self.network.links[bound.link]
        edges, wrong = self._edges(bound.path)
        if wrong:
            return wrong, (0, 0, 0)
        if edges and edges[-1][1] != link.end:
            return "the path does not lead to the end of its link", (0, 0, 0)
        wrong = self._fault_of_short_links(bound, [weight for _, _, weight in edges], link.slack)
        length = sum(weight for _, _, weight in edges)
        if not wrong and (length < link.slack) is not waits:
            wrong = f"the path has length {length}, and the link varies by {link.slack}"
        return wrong, (edges[0][0] if edges else link.end, link.start, length - link.most)

    def _fault_of_short_links(self, bound: DerivedBound, weights: Sequence[int], slack: int) -> str:
        for place, edge in enumerate(bound.path):
            if edge.kind is not EdgeKind.SHORTEST:
                continue
            if min(itertools.accumulate(weights[place + 1 :]), default=0) < 0:
                continue
            if edge.number == bound.link:
                return "a link is as short and as long as it can be at once"
            if sum(weights[place + 1 :]) >= slack:
                return "a short link is left before it has to be"
        return ""

    def _edges(self, path: Sequence[CycleEdge]) -> tuple[list[WeightedEdge], str]:
        """The edges of a path, and whether there is a gap."""
        edges = [self._edge(edge) for edge in path]
        gaps = itertools.pairwise(edges)
        return edges, "" if all(one[1] == other[0] for one, other in gaps) else "there is a gap"

    def _edge(self, edge: CycleEdge) -> WeightedEdge:
        match edge.kind:
            case EdgeKind.BOUND:
                bound = self.network.bounds[edge.number]
                return bound.earlier, bound.later, bound.most
            case EdgeKind.SHORTEST:
                link = self.network.links[edge.number]
                return link.start, link.end, link.least
            case EdgeKind.AT_LEAST:
                link = self.network.links[edge.number]
                return link.end, link.start, -link.least
            case _:
                return self.derived[edge.number]
