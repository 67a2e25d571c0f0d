"""Backward chaining over sets of open conditions: the space that hill climbing and best-first search explore.

A node is the set of conditions that must hold so that the steps chosen so far reach the goals (regression, as
in ITA's task planner). Weights order the work as in ABSTRIPS (Sacerdoti 1974): among otherwise equal
operators, those for the heaviest unsatisfied condition come first. Weights never prune. Mutexes discard sets
of conditions that no reachable state satisfies. Relaxed plans are computed only once, so a successor costs a
few operations on bitsets. It becomes a node only when the search takes it up.
"""

import copy
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import or_
from typing import NamedTuple

from engine.model.outcome import Offer
from engine.model.task import Bits, GroundOperator, indices
from engine.stages.planning.composites import Composite, Pattern, composites
from engine.stages.planning.effort import SearchResult
from engine.stages.planning.relaxed import FAR, Relaxation


@dataclass(frozen=True, slots=True)
class Node:
    """Open conditions, and the step that was chosen last, which comes first in the plan.

    `depth` counts steps.
    """

    open: Bits
    step: int
    next: "Node | None"
    depth: int
    cost: int


class Successor(NamedTuple):
    """A node that is not made yet.

    `lightness` is that of the condition which the operator achieves: the heavier, the lower.
    """

    lightness: int
    estimate: int
    operator: int
    open: Bits


class Regression:
    """Operators indexed by what they achieve and by the conditions that they conflict with.

    The index is the same for every initial state.
    """

    def __init__(
        self, operators: Sequence[GroundOperator], weights: Sequence[int], excluded: Sequence[Bits]
    ) -> None:
        self.operators, self.weights, self.excluded = operators, weights, excluded
        self.relaxation = Relaxation(operators, len(excluded))
        self.adds = [operator.adds for operator in operators]
        self.preconditions = [operator.preconditions for operator in operators]
        self.charges = self.relaxation.charges
        self.composites: tuple[Composite, ...] = ()
        self.achievers: list[list[int]] = [[] for _ in excluded]
        self.conflicts = [self._conflicts(operator) for operator in operators]
        for number, operator in enumerate(operators):
            self._index(number, operator)

    def _index(self, number: int, operator: GroundOperator) -> None:
        if self.consistent(operator.preconditions):
            for atom in indices(operator.adds & ~operator.preconditions):
                self.achievers[atom].append(number)

    def with_composites(self, made: Sequence[Composite]) -> "Regression":
        """A copy with composites beside the operators.

        Composites are not part of relaxed plans, so the estimates stay the same.
        """
        extended = copy.copy(self)
        extended.composites = tuple(made)
        joined = [each.operator for each in made]
        extended.adds = self.adds + [each.adds for each in joined]
        extended.preconditions = self.preconditions + [each.preconditions for each in joined]
        extended.conflicts = self.conflicts + [self._conflicts(each) for each in joined]
        charge = self.relaxation.charge
        extended.charges = self.charges + [sum(map(charge, each.parts)) for each in made]
        extended.achievers = [list(each) for each in self.achievers]
        for number, operator in enumerate(joined, len(self.operators)):
            extended._index(number, operator)
        return extended

    def _conflicts(self, operator: GroundOperator) -> Bits:
        """The conditions that cannot be open directly after an operator.

        These are the atoms that it deletes, the atoms that exclude one that it adds, and the atoms that
        exclude one of its preconditions and that it does not add itself.
        """
        forbidden = operator.deletes & ~operator.adds
        for atom in indices(operator.preconditions):
            forbidden |= self.excluded[atom] & ~operator.adds
        for atom in indices(operator.adds):
            forbidden |= self.excluded[atom]
        return forbidden

    def consistent(self, conditions: Bits) -> bool:
        """Whether no two of the conditions exclude each other."""
        return not any(self.excluded[atom] & conditions for atom in indices(conditions))

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
        self._needs: dict[int, Bits | None] = {}

    def offered(self, patterns: Sequence[Pattern], most: int) -> "Backward":
        """The same space with at most `most` instances of patterns beside the operators."""
        made = composites(self.regression.operators, patterns, most) if patterns else []
        if not made:
            return self
        extended = copy.copy(self)
        extended.regression = self.regression.with_composites(made)
        extended._needs = dict(self._needs)
        return extended

    def root(self, goals: Bits) -> Node | None:
        """The node of the goals; None if the goals are unreachable or exclude each other."""
        if self.relaxed.plan(goals) is None or not self.regression.consistent(goals):
            return None
        return Node(goals, -1, None, 0, 0)

    def estimate(self, conditions: Bits) -> int:
        """The estimated cost until the conditions hold, which must be reachable."""
        return (self.relaxed.plan(conditions) or 0).bit_count()

    def following(self, node: Node, successor: Successor) -> Node:
        """The node that a successor stands for."""
        charge = self.regression.charges[successor.operator]
        return Node(successor.open, successor.operator, node, node.depth + 1, node.cost + charge)

    def successors(self, node: Node, room: int = FAR) -> Iterator[Successor]:
        """The successors of a node whose operator and estimate together cost less than `room`.

        An operator counts for the heaviest unsatisfied condition that it achieves. An operator that achieves
        only conditions that hold initially comes last.
        """
        open_, regression = node.open, self.regression
        conflicts, charges, needs = regression.conflicts, regression.charges, self._needs
        several: set[int] = set()
        for lightness, atom, others in self._ranked(open_):
            for number in regression.achievers[atom]:
                if conflicts[number] & open_:
                    continue
                plan = needs[number] if number in needs else self._needed(number)
                if plan is None or number in several:
                    continue
                achieved, rest = open_ & regression.adds[number], others
                if achieved & (achieved - 1):
                    several.add(number)
                    rest = self.relaxed.plan(open_ & ~achieved) or 0
                estimate = (plan | rest).bit_count()
                if charges[number] + estimate < room:
                    conditions = open_ & ~achieved | regression.preconditions[number]
                    yield Successor(lightness, estimate, number, conditions)

    def _ranked(self, conditions: Bits) -> Iterator[tuple[int, int, Bits]]:
        """Each open condition with its lightness and the relaxed plan of all others, heaviest first.

        Conditions that hold initially are the lightest.
        """
        weights = self.regression.weights
        unsatisfied = sorted(indices(conditions & ~self.initial), key=lambda atom: -weights[atom])
        plans = [self.relaxed.to(atom) or 0 for atom in unsatisfied]
        before = [0, *itertools.accumulate(plans, or_)]
        after = [0, *itertools.accumulate(reversed(plans), or_)]
        for place, atom in enumerate(unsatisfied):
            yield -weights[atom], atom, before[place] | after[len(plans) - 1 - place]
        for atom in indices(conditions & self.initial):
            yield 1, atom, before[-1]

    def _needed(self, number: int) -> Bits | None:
        """The relaxed plan of an operator's preconditions."""
        plan = self._needs[number] = self.relaxed.plan(self.regression.preconditions[number])
        return plan
