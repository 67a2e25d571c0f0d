"""Backward search over sets of open conditions: hill climbing with backtracking, and best-first.

A node is the set of conditions that must hold so that the steps chosen so far reach the goals
(regression, as in ITA's task planner). Weights order the work as in ABSTRIPS (Sacerdoti 1974):
among otherwise equal operators, those for the heaviest unsatisfied condition come first. Weights
never prune. Mutexes discard sets of conditions that no reachable state satisfies. Relaxed plans are
computed only once, so a successor costs a few operations on bitsets (`expansion.py`). It becomes a
node only when the search takes it up.
"""

import copy
import heapq
import itertools
from collections.abc import Iterator, Sequence
from hashlib import blake2b
from typing import NamedTuple

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.model.ground_task import GroundOperator
from cellwright.engine.model.outcome import MacroOffer
from cellwright.engine.stages.planning.composites import Composite, Pattern, find_composites
from cellwright.engine.stages.planning.delete_relaxation import UNREACHABLE_COST, Relaxation
from cellwright.engine.stages.planning.regression.expansion import Expansion, Operators, Successor
from cellwright.engine.stages.planning.search_control import (
    NO_PLAN,
    Effort,
    SearchResult,
    random_source,
)


class RegressionNode(NamedTuple):
    """Open conditions, and the step that was chosen last, which comes first in the plan.

    `depth` counts steps.
    """

    open: Bits
    step: int
    next: "RegressionNode | None"
    depth: int
    cost: int


class Regression:
    """The operators of a task for backward chaining from any initial state.

    `excluded` has for each atom those that cannot be true together with it.
    """

    def __init__(
        self, operators: Sequence[GroundOperator], weights: Sequence[int], excluded: Sequence[Bits]
    ) -> None:
        self.operators, self.excluded = operators, excluded
        self.relaxation = Relaxation(operators, len(excluded))
        self.composites: tuple[Composite, ...] = ()
        self.indexed = Operators(list(excluded), [-weight for weight in weights])
        for operator, charge in zip(operators, self.relaxation.charges, strict=True):
            self.indexed.add(operator.preconditions, operator.adds, operator.deletes, charge)

    def with_composites(self, new_composites: Sequence[Composite]) -> "Regression":
        """A copy with composites beside the operators.

        Composites are not part of relaxed plans, so the estimates stay the same.
        """
        extended, charge = copy.copy(self), self.relaxation.charge
        extended.composites, extended.indexed = tuple(new_composites), self.indexed.copy()
        for composite in new_composites:
            joined, charged = composite.operator, sum(map(charge, composite.parts))
            extended.indexed.add(joined.preconditions, joined.adds, joined.deletes, charged)
        return extended

    def plan(self, node: RegressionNode) -> SearchResult:
        """The steps from a node to the goals, in order of execution.

        Composites are replaced by their parts.
        """
        steps: list[GroundOperator] = []
        used: dict[Pattern, None] = {}
        while node.next is not None:
            place = node.step - len(self.operators)
            if place < 0:
                steps.append(self.operators[node.step])
            else:
                steps += self.composites[place].parts
                used[self.composites[place].pattern] = None
            node = node.next
        if not self.composites:
            return SearchResult(steps)
        offered = dict.fromkeys(composite.pattern for composite in self.composites)
        return SearchResult(steps, MacroOffer("backward", tuple(offered), tuple(used)))


class BackwardSpace:
    """The regression space of one initial state.

    Atoms that no chain of supporters with a cost of at most `bound` reaches count as unreachable.
    """

    def __init__(
        self, regression: Regression, initial: Bits, bound: int = UNREACHABLE_COST
    ) -> None:
        self.regression, self.initial = regression, initial
        self.relaxed = regression.relaxation.plans(initial, bound)
        self._expansion = Expansion(regression.indexed, self.relaxed)

    def offered(self, patterns: Sequence[Pattern], most: int) -> "BackwardSpace":
        """The same space with at most `most` instances of patterns beside the operators."""
        new_composites = (
            find_composites(self.regression.operators, patterns, most) if patterns else []
        )
        if not new_composites:
            return self
        extended = copy.copy(self)
        extended.regression = self.regression.with_composites(new_composites)
        extended._expansion = Expansion(extended.regression.indexed, self.relaxed)
        return extended

    def root(self, goals: Bits) -> RegressionNode | None:
        """The node of the goals; None if the goals are unreachable or exclude each other."""
        if self.relaxed.plan(goals) is None or not self.regression.indexed.consistent(goals):
            return None
        return RegressionNode(goals, -1, None, 0, 0)

    def estimate(self, conditions: Bits) -> int:
        """The estimated cost until the conditions hold, which must be reachable."""
        return (self.relaxed.plan(conditions) or 0).bit_count()

    def following(self, node: RegressionNode, operator: int) -> RegressionNode:
        """The node before a node, from which an operator leads to it."""
        indexed = self.regression.indexed
        open_ = node.open & ~indexed.adds[operator] | indexed.preconditions[operator]
        return RegressionNode(
            open_, operator, node, node.depth + 1, node.cost + indexed.charges[operator]
        )

    def successors(self, node: RegressionNode, room: int = UNREACHABLE_COST) -> list[Successor]:
        """The successors of a node whose operator and estimate together cost less than `room`."""
        return self._expansion.successors(node.open, room)


OPERATOR, OPEN = 2, 3  # the places of the operator and of the open conditions in a successor
NO_STEP = -1  # in place of an operator: the node itself waits
SHORT_CONDITION_BITS = 512  # bits
DIGEST_BYTES = 16  # bytes


def _conditions_key(conditions: Bits) -> Bits | bytes:
    """What stands for conditions where only their equality counts: long sets of them become a
    digest of 128 bits.
    """
    if conditions.bit_length() <= SHORT_CONDITION_BITS:
        return conditions
    return blake2b(
        conditions.to_bytes((conditions.bit_length() + 7) // 8, "little"), digest_size=DIGEST_BYTES
    ).digest()


class HillClimbing:
    """Depth-first search that takes the best successor first and steps back when there is none.

    It is complete, because it visits no set of conditions twice.
    """

    def __init__(self, space: BackwardSpace, root: RegressionNode, seed: int = 0) -> None:
        self.space, self.root = space, root
        self._random = random_source(seed)
        self._closed: set[Bits] = {root.open}
        self._stack: list[tuple[RegressionNode, Iterator[Successor]]] | None = None

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent.

        The answer is a plan, or `NO_PLAN` if there is provably none. None means that the effort is
        spent.
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
            successor = next(
                (candidate for candidate in successors if candidate[OPEN] not in self._closed), None
            )
            if successor is None:
                self._stack.pop()
                continue
            self._closed.add(successor[OPEN])
            node = self.space.following(node, successor[OPERATOR])
            if node.open & ~self.space.initial == 0:
                return self.space.regression.plan(node)
            self._stack.append((node, self._ordered(node, effort)))
        return NO_PLAN

    def _ordered(self, node: RegressionNode, effort: Effort) -> Iterator[Successor]:
        effort.expanded += 1
        successors = self.space.successors(node)
        effort.generated += len(successors)
        if self._random:
            self._random.shuffle(successors)
            return iter(sorted(successors, key=lambda successor: successor[:2]))
        return iter(sorted(successors, key=lambda successor: successor[:3]))


class BestFirstRegression:
    """Best-first search by cost + greed * estimate.

    Nodes whose cost and estimate together are not less than `below` are left out. With `greed` 0
    and unit costs the search is breadth first and finds shortest plans.
    """

    def __init__(
        self,
        space: BackwardSpace,
        roots: Sequence[RegressionNode],
        greed: int,
        below: int = UNREACHABLE_COST,
    ) -> None:
        self.space, self.greed, self.below = space, greed, below
        self._counter = itertools.count()
        # A node that waits is the one before it and an operator, so that its conditions are made
        # again if its turn comes: most never do.
        self._queue: list[tuple[int, int, int, RegressionNode, int]] = []
        self._best: dict[Bits | bytes, int] = {}
        for root in roots:
            self._best[_conditions_key(root.open)] = 0
            key = greed * space.estimate(root.open)
            heapq.heappush(self._queue, (key, 0, next(self._counter), root, NO_STEP))

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent.

        The answer is a plan, or `NO_PLAN` if there is provably none. None means that the effort is
        spent.
        """
        while self._queue:
            if effort.spent():
                return None
            _, _, _, node, operator = heapq.heappop(self._queue)
            if operator != NO_STEP:
                node = self.space.following(node, operator)
            if self._best[_conditions_key(node.open)] < node.cost:
                continue
            if node.open & ~self.space.initial == 0:
                return self.space.regression.plan(node)
            self._expand(node, effort)
        return NO_PLAN

    def _expand(self, node: RegressionNode, effort: Effort) -> None:
        effort.expanded += 1
        best, charges = self._best, self.space.regression.indexed.charges
        for successor in self.space.successors(node, self.below - node.cost):
            lightness, estimate, operator, open_ = successor
            cost, conditions = node.cost + charges[operator], _conditions_key(open_)
            best_cost = best.get(conditions)
            if best_cost is None or cost < best_cost:
                best[conditions] = cost
                effort.generated += 1
                key = cost + self.greed * estimate
                entry = (key, lightness, next(self._counter), node, operator)
                heapq.heappush(self._queue, entry)
