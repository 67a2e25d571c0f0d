"""Backward chaining over sets of open conditions: the space that hill climbing and best-first search explore.

A node is what must hold so that the steps chosen so far reach the goals (ITA's task planner; regression). Weights
order the work as in ABSTRIPS (Sacerdoti 1974): operators for the heaviest unsatisfied condition come first among
equals. They never prune. Mutexes discard sets that no reachable state satisfies.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from engine.model.task import Bits, GroundOperator, Task, indices
from engine.planning.relaxed import RelaxedPlans, relaxed_plans

Interrupted = Callable[[], bool]


@dataclass(frozen=True, slots=True)
class Node:
    """Open conditions, and the step that was put in last: it comes first in the plan. `depth` counts steps."""

    open: Bits
    step: int
    next: "Node | None"
    depth: int
    cost: int

    def steps(self) -> list[int]:
        """The operators of the plan from here to the goals, in order of execution."""
        found, node = [], self
        while node.next is not None:
            found.append(node.step)
            node = node.next
        return found


@dataclass
class Effort:
    """Work counted, not timed: the search stops after `limit` expansions, or when `interrupted` says so.

    `most` bounds the nodes generated, where expansions may have very many successors.
    """

    limit: int
    interrupted: Interrupted = lambda: False
    expanded: int = 0
    generated: int = 0
    most: int = 1 << 60

    def spent(self) -> bool:
        """Whether to stop."""
        if self.expanded >= self.limit or self.generated >= self.most:
            return True
        return self.expanded % 64 == 0 and self.interrupted()


@dataclass(frozen=True, slots=True)
class Answer:
    """The steps of a plan, or None; `exhausted` if the whole space was searched."""

    steps: list[int] | None
    exhausted: bool


@dataclass
class Backward:
    """One regression search space: operators indexed by what they achieve, relaxed plans, mutexes."""

    operators: Sequence[GroundOperator]
    initial: Bits
    weights: Sequence[int]
    excluded: Sequence[Bits]
    relaxed: RelaxedPlans = field(init=False)

    def __post_init__(self) -> None:
        size = len(self.excluded)
        self.relaxed = relaxed_plans(self.initial, self.operators, size)
        self.achievers: list[list[int]] = [[] for _ in range(size)]
        self.conflicts: list[Bits] = []
        for number, operator in enumerate(self.operators):
            forbidden = operator.deletes & ~operator.adds
            for atom in indices(operator.preconditions):
                forbidden |= self.excluded[atom] & ~operator.adds
            for atom in indices(operator.adds):
                forbidden |= self.excluded[atom]
            self.conflicts.append(forbidden)
            if self.relaxed.plan(operator.preconditions) is not None and not self._spurious(operator):
                for atom in indices(operator.adds & ~operator.preconditions):
                    self.achievers[atom].append(number)

    def _spurious(self, operator: GroundOperator) -> bool:
        """Whether the preconditions can never hold together."""
        return any(self.excluded[atom] & operator.preconditions for atom in indices(operator.preconditions))

    def consistent(self, conditions: Bits) -> bool:
        """Whether no two conditions exclude each other."""
        return not any(self.excluded[atom] & conditions for atom in indices(conditions))

    def root(self, goals: Bits) -> Node | None:
        """The node of the goals themselves, or None if they are unreachable or exclude each other."""
        if self.relaxed.plan(goals) is None or not self.consistent(goals):
            return None
        return Node(goals, -1, None, 0, 0)

    def successors(self, node: Node) -> Iterator[tuple[tuple[int, int, int], Node]]:
        """The nodes one step further back, each with (lightness, estimate, operator) to sort by.

        An operator counts for the heaviest unsatisfied condition that it achieves; one that achieves only what holds
        already comes last.
        """
        seen: set[int] = set()
        unsatisfied = sorted(indices(node.open & ~self.initial), key=lambda atom: -self.weights[atom])
        ranked = [(-self.weights[atom], atom) for atom in unsatisfied]
        ranked += [(1, atom) for atom in indices(node.open & self.initial)]
        for lightness, atom in ranked:
            for number in self.achievers[atom]:
                if number in seen:
                    continue
                seen.add(number)
                if self.conflicts[number] & node.open:
                    continue
                operator = self.operators[number]
                conditions = (node.open & ~operator.adds) | operator.preconditions
                plan = self.relaxed.plan(conditions)
                if plan is not None:
                    following = Node(
                        conditions, number, node, node.depth + 1, node.cost + self.relaxed.costs[number]
                    )
                    yield (lightness, self.relaxed.cost(plan), number), following


def space(task: Task, operators: Sequence[GroundOperator], excluded: Sequence[Bits]) -> Backward:
    """The search space of a task over unconditional operators."""
    return Backward(operators, task.initial, task.weights, excluded)
