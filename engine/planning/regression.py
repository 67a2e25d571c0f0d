"""Two ways through the space of backward chaining: hill climbing with chronological backtracking, and best first.

Both can be resumed, so that strategies take turns.
"""

import heapq
import itertools
from collections.abc import Iterator, Sequence

from engine.model.task import Bits
from engine.planning.backward import Answer, Backward, Effort, Node


class Climb:
    """Depth first, best successor first, stepping back when there is none: complete, as no set is met twice."""

    def __init__(self, space: Backward, root: Node) -> None:
        self.space, self.root = space, root
        self._closed: set[Bits] = {root.open}
        self._stack: list[Iterator[Node]] | None = None

    def run(self, effort: Effort) -> Answer | None:
        """Search on until the effort is spent: a plan, the proof that there is none, or None."""
        if self.root.open & ~self.space.initial == 0:
            return Answer([], False)
        if self._stack is None:
            if effort.spent():
                return None
            self._stack = [self._ordered(self.root, effort)]
        while self._stack:
            if effort.spent():
                return None
            node = next((each for each in self._stack[-1] if each.open not in self._closed), None)
            if node is None:
                self._stack.pop()
                continue
            self._closed.add(node.open)
            if node.open & ~self.space.initial == 0:
                return Answer(node.steps(), False)
            self._stack.append(self._ordered(node, effort))
        return Answer(None, True)

    def _ordered(self, node: Node, effort: Effort) -> Iterator[Node]:
        effort.expanded += 1
        found = sorted(self.space.successors(node), key=lambda pair: pair[0])
        effort.generated += len(found)
        return iter([each for _, each in found])


class BestFirst:
    """Best first by cost + greed * estimate. `greed` 0 with unit costs is breadth first and finds shortest plans."""

    def __init__(self, space: Backward, roots: Sequence[Node], greed: int) -> None:
        self.space, self.greed = space, greed
        self._counter = itertools.count()
        self._queue: list[tuple[int, int, int, Node]] = []
        self._best: dict[Bits, int] = {}
        for root in roots:
            self._best[root.open] = 0
            estimate = space.relaxed.cost(space.relaxed.plan(root.open) or 0)
            heapq.heappush(self._queue, (greed * estimate, 0, next(self._counter), root))

    def run(self, effort: Effort) -> Answer | None:
        """Search on until the effort is spent: a plan, the proof that there is none, or None."""
        while self._queue:
            if effort.spent():
                return None
            _, _, _, node = heapq.heappop(self._queue)
            if self._best[node.open] < node.cost:
                continue
            if node.open & ~self.space.initial == 0:
                return Answer(node.steps(), False)
            effort.expanded += 1
            for (lightness, estimate, _), following in self.space.successors(node):
                known = self._best.get(following.open)
                if known is None or following.cost < known:
                    self._best[following.open] = following.cost
                    effort.generated += 1
                    key = following.cost + self.greed * estimate
                    heapq.heappush(self._queue, (key, lightness, next(self._counter), following))
        return Answer(None, True)
