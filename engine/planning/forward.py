"""Forward search: lazy greedy best first over two estimates, relaxed plans and landmarks, with preferred operators in
queues of their own (Richter & Helmert 2009; Richter & Westphal 2010).

For tasks where regression drowns. States are rows of 64-bit words, evaluated by compiled kernels.
"""

import heapq
import itertools
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from engine.model.task import Bits, GroundOperator, indices
from engine.planning.backward import Answer, Effort
from engine.planning.kernels import evaluate
from engine.planning.landmarks import Landmarks

Ints = NDArray[np.int32]
UNKNOWN = 1 << 60
BOOST = 1000  # priority given to preferred operators whenever the estimate sinks


@dataclass(frozen=True, slots=True)
class Rows:
    """Lists of numbers, one after another: list i is items[starts[i]:starts[i + 1]]."""

    starts: Ints
    items: Ints


def rows(lists: Sequence[Sequence[int]]) -> Rows:
    """Lists as compressed rows."""
    starts = np.zeros(len(lists) + 1, np.int32)
    starts[1:] = np.cumsum([len(each) for each in lists], dtype=np.int64)
    return Rows(starts, np.fromiter(itertools.chain.from_iterable(lists), np.int32, int(starts[-1])))


@dataclass(frozen=True, slots=True)
class Node:
    """A state that was reached, the landmarks accepted on the way, and the step that led to it."""

    state: Bits
    accepted: Bits
    parent: int
    operator: int


@dataclass(order=True, slots=True)
class Batch:
    """Successors of one node that wait in a queue; all have the node's estimate, so they need one entry."""

    key: int
    tie: int
    node: int = field(compare=False)
    operators: Iterator[int] = field(compare=False)
    left: int = field(compare=False)


class Forward:
    """One search from a state to one conjunction of goals over unconditional operators; it can be resumed.

    With `landmarks`, queues ordered by how many landmarks are left take turns with those ordered by relaxed plans.
    """

    def __init__(
        self,
        operators: Sequence[GroundOperator],
        initial: Bits,
        goals: Bits,
        size: int,
        seed: int = 0,
        *,
        landmarks: bool = False,
    ) -> None:
        self.width = max((size + 63) // 64, 1)
        self.goals = np.fromiter(indices(goals), np.int32)
        self.goal_bits, self.initial = goals, initial
        needs = [list(indices(operator.preconditions)) for operator in operators]
        users: list[list[int]] = [[] for _ in range(size)]
        for number, needed in enumerate(needs):
            for atom in needed:
                users[atom].append(number)
        count = len(operators)
        need, add, user = rows(needs), rows([list(indices(o.adds)) for o in operators]), rows(users)
        costs = np.fromiter((max(operator.cost, 1) for operator in operators), np.int32, count)
        work = [np.zeros(size, np.int32) for _ in range(2)] + [np.zeros(count, np.int32) for _ in range(2)]
        queue = [np.zeros(size + len(add.items) + 1, np.int32) for _ in range(2)]
        self.applicable, self.preferred = np.zeros(count, np.int32), np.zeros(count, np.int32)
        missing = np.diff(need.starts)
        stack = np.zeros(len(need.items) + len(self.goals) + 1, np.int32)
        self._arguments = (
            self.goals, costs, need.starts, need.items, missing, add.starts, add.items, user.starts, user.items,
            *work, *queue, self.applicable, self.preferred, np.zeros(count, np.int32), stack,
        )  # fmt: skip
        self._adds = [operator.adds for operator in operators]
        self._keeps = [~(operator.deletes & ~operator.adds) for operator in operators]
        self._landmarks = Landmarks(operators, initial, goals, size) if landmarks else None
        self._counter = itertools.count()
        self._random = random.Random(seed) if seed else None
        self._queues: list[list[Batch]] = [
            [] for _ in range(4)
        ]  # by relaxed plan, its preferred ones; the same by landmarks
        self._priorities = [0] * 4
        self._nodes: list[Node] = []
        self._closed: set[Bits] = set()
        self._best = [UNKNOWN, UNKNOWN]

    def run(self, effort: Effort) -> Answer | None:
        """Search on until the effort is spent: a plan, the proof that there is none, or None."""
        if not self._nodes and self._expand(self.initial, -1, -1, effort):
            return Answer([], False)
        while not effort.spent():
            entry = self._next()
            if entry is None:
                return Answer(None, True)
            parent, operator = entry
            state = self._nodes[parent].state & self._keeps[operator] | self._adds[operator]
            if state not in self._closed and self._expand(state, parent, operator, effort):
                return Answer(self._steps(), False)
        return None

    def _next(self) -> tuple[int, int] | None:
        """The next successor to make: from the queue whose turn it is."""
        for number in sorted(range(4), key=self._priorities.__getitem__):
            queue = self._queues[number]
            if queue:
                self._priorities[number] += 1
                batch = queue[0]
                operator = next(batch.operators)
                batch.left -= 1
                if not batch.left:
                    heapq.heappop(queue)
                return batch.node, operator
        return None

    def _expand(self, state: Bits, parent: int, operator: int, effort: Effort) -> bool:
        """Evaluate a state and queue its successors; whether it satisfies the goals."""
        self._closed.add(state)
        here = len(self._nodes)
        accepted = self._nodes[parent].accepted if parent >= 0 else 0
        if self._landmarks:
            accepted = self._landmarks.accept(accepted, state)
        self._nodes.append(Node(state, accepted, parent, operator))
        if self.goal_bits & ~state == 0:
            return True
        effort.expanded += 1
        estimate, applicable, preferred = self.evaluate(state)
        if estimate < 0:
            return False
        effort.generated += len(applicable)
        keys = [estimate, self._landmarks.left(accepted, state)] if self._landmarks else [estimate]
        if any(key < best for key, best in zip(keys, self._best, strict=False)):
            self._best = [min(pair) for pair in zip(keys, self._best, strict=False)]
            self._priorities[1] -= BOOST
            self._priorities[3] -= BOOST
        for place, key in enumerate(keys):
            for number, operators in ((2 * place, applicable), (2 * place + 1, preferred)):
                if operators:
                    batch = Batch(key, self._tie(), here, iter(operators), len(operators))
                    heapq.heappush(self._queues[number], batch)
        return False

    def evaluate(self, state: Bits) -> tuple[int, list[int], list[int]]:
        """The cost of a relaxed plan (-1 if there is none), the applicable operators, and those it begins with."""
        words = np.frombuffer(state.to_bytes(self.width * 8, "little"), np.uint64)
        estimate, applicable, preferred = evaluate(words, *self._arguments)
        return estimate, self.applicable[:applicable].tolist(), self.preferred[:preferred].tolist()

    def _tie(self) -> int:
        """First in, first out; by chance with a seed."""
        return self._random.getrandbits(30) if self._random else next(self._counter)

    def _steps(self) -> list[int]:
        """The operators that led to the last state."""
        found, node = [], self._nodes[-1]
        while node.parent >= 0:
            found.append(node.operator)
            node = self._nodes[node.parent]
        return found[::-1]
