"""Two backward searches: hill climbing with chronological backtracking, and best-first search.

Both can be resumed, so that strategies can take turns. With a seed, hill climbing breaks ties by chance, so
that a restart takes another way.
"""

import heapq
import itertools
from collections.abc import Iterator, Sequence
from hashlib import blake2b

from cellwright.engine.model.task import Bits
from cellwright.engine.stages.planning.effort import NO_PLAN, Effort, SearchResult
from cellwright.engine.stages.planning.regression.expansion import Successor
from cellwright.engine.stages.planning.regression.space import Backward, Node
from cellwright.engine.stages.planning.relaxed import FAR
from cellwright.engine.stages.planning.ties import chance

OPERATOR, OPEN = 2, 3  # the places of the operator and of the open conditions in a successor
NOTHING = -1  # in place of an operator: the node itself waits
SHORT = 512  # bits
DIGEST = 16  # bytes


def _short(conditions: Bits) -> Bits | bytes:
    """What stands for conditions where only their equality counts: long sets of them become a digest of 128 bits."""
    if conditions.bit_length() <= SHORT:
        return conditions
    return blake2b(
        conditions.to_bytes((conditions.bit_length() + 7) // 8, "little"), digest_size=DIGEST
    ).digest()


class Climb:
    """Depth-first search that takes the best successor first and steps back when there is none.

    It is complete, because it visits no set of conditions twice.
    """

    def __init__(self, space: Backward, root: Node, seed: int = 0) -> None:
        self.space, self.root = space, root
        self._random = chance(seed)
        self._closed: set[Bits] = {root.open}
        self._stack: list[tuple[Node, Iterator[Successor]]] | None = None

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent.

        The answer is a plan, or `NO_PLAN` if there is provably none. None means that the effort is spent.
        """
        if self.root.open & ~self.space.initial == 0:
            return SearchResult([])
        if self._stack is None:
            if effort.spent():
                return None
            self._stack = [(self.root, self._ordered(self.root, effort))]
        while self._stack:
            if effort.spent():
                return None
            node, successors = self._stack[-1]
            successor = next((each for each in successors if each[OPEN] not in self._closed), None)
            if successor is None:
                self._stack.pop()
                continue
            self._closed.add(successor[OPEN])
            node = self.space.following(node, successor[OPERATOR])
            if node.open & ~self.space.initial == 0:
                return self.space.regression.plan(node)
            self._stack.append((node, self._ordered(node, effort)))
        return NO_PLAN

    def _ordered(self, node: Node, effort: Effort) -> Iterator[Successor]:
        effort.expanded += 1
        found = self.space.successors(node)
        effort.generated += len(found)
        if self._random:
            self._random.shuffle(found)
            return iter(sorted(found, key=lambda each: each[:2]))
        return iter(sorted(found, key=lambda each: each[:3]))


class BestFirst:
    """Best-first search by cost + greed * estimate.

    Nodes whose cost and estimate together are not less than `below` are left out. With `greed` 0 and unit
    costs the search is breadth first and finds shortest plans.
    """

    def __init__(self, space: Backward, roots: Sequence[Node], greed: int, below: int = FAR) -> None:
        self.space, self.greed, self.below = space, greed, below
        self._counter = itertools.count()
        # A node that waits is the one before it and an operator, so that its conditions are made again if its turn comes: most never do.
        self._queue: list[tuple[int, int, int, Node, int]] = []
        self._best: dict[Bits | bytes, int] = {}
        for root in roots:
            self._best[_short(root.open)] = 0
            key = greed * space.estimate(root.open)
            heapq.heappush(self._queue, (key, 0, next(self._counter), root, NOTHING))

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent.

        The answer is a plan, or `NO_PLAN` if there is provably none. None means that the effort is spent.
        """
        while self._queue:
            if effort.spent():
                return None
            _, _, _, node, operator = heapq.heappop(self._queue)
            if operator != NOTHING:
                node = self.space.following(node, operator)
            if self._best[_short(node.open)] < node.cost:
                continue
            if node.open & ~self.space.initial == 0:
                return self.space.regression.plan(node)
            self._expand(node, effort)
        return NO_PLAN

    def _expand(self, node: Node, effort: Effort) -> None:
        effort.expanded += 1
        best, charges = self._best, self.space.regression.indexed.charges
        for successor in self.space.successors(node, self.below - node.cost):
            lightness, estimate, operator, open_ = successor
            cost, conditions = node.cost + charges[operator], _short(open_)
            known = best.get(conditions)
            if known is None or cost < known:
                best[conditions] = cost
                effort.generated += 1
                key = cost + self.greed * estimate
                entry = (key, lightness, next(self._counter), node, operator)
                heapq.heappush(self._queue, entry)
