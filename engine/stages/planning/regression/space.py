"""Backward chaining over sets of open conditions: the space that hill climbing and best-first search explore.

A node is the set of conditions that must hold so that the steps chosen so far reach the goals (regression, as
in ITA's task planner). Weights order the work as in ABSTRIPS (Sacerdoti 1974): among otherwise equal
operators, those for the heaviest unsatisfied condition come first. Weights never prune. Mutexes discard sets
of conditions that no reachable state satisfies. Relaxed plans are computed only once, so a successor costs a
few operations on bitsets (`expansion.py`). It becomes a node only when the search takes it up.
"""

import copy
from collections.abc import Sequence
from typing import NamedTuple

from cellwright.engine.model.outcome import Offer
from cellwright.engine.model.task import Bits, GroundOperator
from cellwright.engine.stages.planning.composites import Composite, Pattern, composites
from cellwright.engine.stages.planning.effort import SearchResult
from cellwright.engine.stages.planning.regression.expansion import Expansion, Operators, Successor
from cellwright.engine.stages.planning.relaxed import FAR, Relaxation


class Node(NamedTuple):
    """Open conditions, and the step that was chosen last, which comes first in the plan.

    `depth` counts steps.
    """

    open: Bits
    step: int
    next: "Node | None"
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
        for each, charge in zip(operators, self.relaxation.charges, strict=True):
            self.indexed.add(each.preconditions, each.adds, each.deletes, charge)

    def with_composites(self, made: Sequence[Composite]) -> "Regression":
        """A copy with composites beside the operators.

        Composites are not part of relaxed plans, so the estimates stay the same.
        """
        extended, charge = copy.copy(self), self.relaxation.charge
        extended.composites, extended.indexed = tuple(made), self.indexed.copy()
        for each in made:
            joined, charged = each.operator, sum(map(charge, each.parts))
            extended.indexed.add(joined.preconditions, joined.adds, joined.deletes, charged)
        return extended

    def plan(self, node: Node) -> SearchResult:
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
        offered = dict.fromkeys(each.pattern for each in self.composites)
        return SearchResult(steps, Offer("backward", tuple(offered), tuple(used)))


class Backward:
    """The regression space of one initial state.

    Atoms that no chain of supporters with a cost of at most `bound` reaches count as unreachable.
    """

    def __init__(self, regression: Regression, initial: Bits, bound: int = FAR) -> None:
        self.regression, self.initial = regression, initial
        self.relaxed = regression.relaxation.plans(initial, bound)
        self._expansion = Expansion(regression.indexed, self.relaxed)

    def offered(self, patterns: Sequence[Pattern], most: int) -> "Backward":
        """The same space with at most `most` instances of patterns beside the operators."""
        made = composites(self.regression.operators, patterns, most) if patterns else []
        if not made:
            return self
        extended = copy.copy(self)
        extended.regression = self.regression.with_composites(made)
        extended._expansion = Expansion(extended.regression.indexed, self.relaxed)
        return extended

    def root(self, goals: Bits) -> Node | None:
        """The node of the goals; None if the goals are unreachable or exclude each other."""
        if self.relaxed.plan(goals) is None or not self.regression.indexed.consistent(goals):
            return None
        return Node(goals, -1, None, 0, 0)

    def estimate(self, conditions: Bits) -> int:
        """The estimated cost until the conditions hold, which must be reachable."""
        return (self.relaxed.plan(conditions) or 0).bit_count()

    def following(self, node: Node, operator: int) -> Node:
        """The node before a node, from which an operator leads to it."""
        indexed = self.regression.indexed
        open_ = node.open & ~indexed.adds[operator] | indexed.preconditions[operator]
        return Node(open_, operator, node, node.depth + 1, node.cost + indexed.charges[operator])

    def successors(self, node: Node, room: int = FAR) -> list[Successor]:
        """The successors of a node whose operator and estimate together cost less than `room`."""
        return self._expansion.successors(node.open, room)
