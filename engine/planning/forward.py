"""Forward search: lazy greedy best first with preferred operators in a queue of their own (Richter & Helmert 2009).

For tasks where regression drowns. States are rows of 64-bit words, evaluated by compiled kernels.
"""

import heapq
import itertools
import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engine.model.task import Bits, GroundOperator, indices
from engine.planning.backward import Answer, Effort
from engine.planning.kernels import evaluate

Ints = NDArray[np.int32]
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


class Forward:
    """One search from a state to one conjunction of goals over unconditional operators; it can be resumed."""

    def __init__(
        self, operators: Sequence[GroundOperator], initial: Bits, goals: Bits, size: int, seed: int = 0
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
        self._counter = itertools.count()
        self._queues: tuple[list[tuple[int, int, int, int]], ...] = ([], [])
        self._priorities = [0, 0]
        self._states: list[Bits] = [initial]
        self._origins: list[tuple[int, int]] = [(-1, -1)]
        self._closed: set[Bits] = set()
        self._best = -1
        self._random = random.Random(seed) if seed else None

    def run(self, effort: Effort) -> Answer | None:
        """Search on until the effort is spent: a plan, the proof that there is none, or None."""
        if not self._closed:
            plan = self._expand(self.initial, -1, -1, effort)
            if plan is not None:
                return Answer(plan, False)
        while not effort.spent():
            entry = self._next()
            if entry is None:
                return Answer(None, True)
            parent, operator = entry
            state = self._states[parent] & self._keeps[operator] | self._adds[operator]
            if state in self._closed:
                continue
            plan = self._expand(state, parent, operator, effort)
            if plan is not None:
                return Answer(plan, False)
        return None

    def _next(self) -> tuple[int, int] | None:
        """The next successor to make: from the queue whose turn it is."""
        order = (0, 1) if self._priorities[0] <= self._priorities[1] else (1, 0)
        for number in order:
            if self._queues[number]:
                self._priorities[number] += 1
                _, _, parent, operator = heapq.heappop(self._queues[number])
                return parent, operator
        return None

    def _expand(self, state: Bits, parent: int, operator: int, effort: Effort) -> list[int] | None:
        """Evaluate a state and queue its successors; the steps to it if it satisfies the goals."""
        self._closed.add(state)
        here = len(self._states) if parent >= 0 else 0
        if parent >= 0:
            self._states.append(state)
            self._origins.append((parent, operator))
        if self.goal_bits & ~state == 0:
            return self._steps(here)
        effort.expanded += 1
        estimate, everything, helpful = self.evaluate(state)
        if estimate < 0:
            return None
        if self._best < 0 or estimate < self._best:
            self._best = estimate
            self._priorities[1] -= BOOST
        effort.generated += len(everything)
        for number, queue in ((1, helpful), (0, everything)):
            for each in queue:
                heapq.heappush(self._queues[number], (estimate, self._tie(), here, each))
        return None

    def evaluate(self, state: Bits) -> tuple[int, list[int], list[int]]:
        """The cost of a relaxed plan (-1 if there is none), the applicable operators, and those it begins with."""
        words = np.frombuffer(state.to_bytes(self.width * 8, "little"), np.uint64)
        estimate, applicable, preferred = evaluate(words, *self._arguments)
        return estimate, self.applicable[:applicable].tolist(), self.preferred[:preferred].tolist()

    def _tie(self) -> int:
        """First in, first out; by chance with a seed."""
        return self._random.getrandbits(30) if self._random else next(self._counter)

    def _steps(self, here: int) -> list[int]:
        found = []
        while here > 0:
            here, operator = self._origins[here]
            found.append(operator)
        return found[::-1]
