"""Ways on which an object may wait where it began, on its way from one place to the next.

A shortest way brings an object straight on. Where it may stay only so long, or where it would be in
the way of others, it can wait in the place that it had at the start, if the arm brings it there and
from there to where it was to go. Whether it does is decided with the times.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.stages.scheduling.flow.graph import Edge, ObjectGraph, Stride, Ways

MAX_EDGES = 4_000  # of ways to which waits are added


def with_waits(graph: ObjectGraph, ways: Ways) -> Ways:
    """The ways with two layers for each one in which the object may wait on the way to its next
    place; an act without steps stands for no wait.
    """
    if sum(map(len, ways.layers)) > MAX_EDGES:
        return ways
    return _Waits(graph, ways).ways


@dataclass(frozen=True)
class _Waits:
    graph: ObjectGraph
    of: Ways

    @cached_property
    def shared(self) -> Bits:
        """The atoms not about the object that its acts change."""
        changed = 0
        for layer in self.of.layers:
            for edge in layer:
                for each in edge.strides:
                    changed |= each.ends | each.makes
        return changed & ~self.graph.own

    @property
    def ways(self) -> Ways:
        """The ways with all waits."""
        layers, states = list[tuple[Edge, ...]](), dict(self.of.states)
        number = max(states) + 1
        for place, layer in enumerate(self.of.layers):
            nodes: dict[Bits, int] = {}
            there: dict[tuple[int, int], list[Edge]] = {}
            back: dict[tuple[int, int], list[Edge]] = {}
            for edge in layer if place > 0 else ():
                for out, state, home in self._waits(edge):
                    node = nodes.setdefault(state, number + len(nodes))
                    there[edge.before, node] = [Edge(edge.before, node, each) for each in out]
                    back[node, edge.after] = [Edge(node, edge.after, each) for each in home]
            if not there:
                layers.append(layer)
                continue
            number += len(nodes)
            states.update((node, state) for state, node in nodes.items())
            straight = dict.fromkeys(edge.after for edge in layer)
            layers.append((*layer, *_join_rows(there.values())))
            layers.append(
                (*(Edge(node, node, ()) for node in straight), *_join_rows(back.values()))
            )
        return Ways(tuple(layers), states)

    def _waits(
        self, edge: Edge
    ) -> Iterator[tuple[list[tuple[Stride, ...]], Bits, list[tuple[Stride, ...]]]]:
        """The acts to where the object began, the state there, and the acts from there to the
        end of an edge.
        """
        before, after = self.of.states[edge.before], self.of.states[edge.after]
        if not self._moves(before, after) or len(edge.strides) < 2:
            return
        for state in self._resting(before, len(edge.strides)):
            if state not in (before, after):
                out = list(self._acts(before, state, len(edge.strides)))
                home = list(self._acts(state, after, len(edge.strides)))
                if out and home:
                    yield out, state, home

    def _moves(self, before: Bits, after: Bits) -> bool:
        """Whether the object holds something else afterwards, and did not begin or end at home."""
        start = self.of.states[0]
        return bool((before ^ after) & self.shared) and not any(
            (state ^ start) & self.shared == 0 for state in (before, after)
        )

    def _resting(self, before: Bits, steps: int) -> list[Bits]:
        """The states after so many steps at most in which the object holds what it held at the
        start.
        """
        start, found = self.of.states[0], dict[Bits, None]()
        reached = {before}
        for _ in range(steps):
            reached = {after for each in reached for _, after in self._strides(each)}
            found.update(
                dict.fromkeys(s for s in sorted(reached) if (s ^ start) & self.shared == 0)
            )
        return list(found)

    def _acts(self, before: Bits, end: Bits, steps: int) -> Iterator[tuple[Stride, ...]]:
        """The rows of at most so many steps from one state to another."""
        line: list[tuple[tuple[Stride, ...], Bits]] = [((), before)]
        for strides, here in line:
            for stride, after in self._strides(here):
                if after == end:
                    yield (*strides, stride)
                elif len(strides) + 1 < steps:
                    line.append(((*strides, stride), after))

    def _strides(self, state: Bits) -> Sequence[tuple[Stride, Bits]]:
        known = self._known.get(state)
        if known is None:
            known = self._known[state] = list(self.graph.strides(state))
        return known

    @cached_property
    def _known(self) -> dict[Bits, list[tuple[Stride, Bits]]]:
        return {}


def _join_rows(rows: Iterable[list[Edge]]) -> list[Edge]:
    return [edge for row in rows for edge in row]
