"""Forward search: lazy greedy best-first search with two estimates, relaxed plans and landmarks.

Preferred operators have queues of their own (Richter & Helmert 2009; Richter & Westphal 2010). This search is
for tasks that have too many nodes for regression. Compiled kernels evaluate the states.
"""

import heapq
import itertools
import random
from collections.abc import Sequence
from typing import NamedTuple

from engine.model.axioms import Axioms
from engine.model.outcome import Offer
from engine.model.task import Bits, GroundOperator, Task, after
from engine.stages.planning.composites import Pattern
from engine.stages.planning.effort import NO_PLAN, Effort, SearchResult
from engine.stages.planning.forward.evaluation import Evaluation
from engine.stages.planning.forward.landmarks import Landmarks
from engine.stages.planning.forward.suggestions import Suggestions
from kb.terms import Function

UNKNOWN = 1 << 60
_MEETS = Function("_meets")
BOOST = 1000  # turns that preferred operators get whenever the estimate improves


class Node(NamedTuple):
    """A state that was reached, the landmarks accepted on the way, and the step that led to it."""

    state: Bits
    accepted: bytes
    parent: int
    operator: int


class Batch(NamedTuple):
    """Successors of one node that wait in a queue; the last one in `operators` is taken first.

    All have the estimate of the node, so they need only one entry in the queue.
    """

    key: int
    tie: int
    node: int
    operators: list[int]


class Forward:
    """One search from a state to one conjunction of goals; it can be resumed.

    Operators may have conditional effects. A successor is the number of an operator; one that repeats an operator has as many
    times the number of all operators added.

    With `landmarks`, additional queues are ordered by the number of landmarks that are left; they take turns
    with the queues ordered by relaxed plans. Then every operator counts as one step, because short plans are
    easier to find than cheap ones, and improvement makes them cheaper later. If all steps of an instance of
    `patterns` are in the relaxed plan of a state, the instance is used there as a preferred operator.
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
        patterns: Sequence[Pattern] = (),
        axioms: Axioms | None = None,
    ) -> None:
        self.goals, self.initial, self._axioms = goals, initial, axioms
        self._suggestions = Suggestions(operators, patterns) if patterns else None
        self.operators = self._suggestions.operators if self._suggestions else operators
        self.evaluate = Evaluation(operators, goals, size, unit=landmarks, axioms=axioms)
        self._landmarks = self._found_landmarks(size) if landmarks else None
        self._counter = itertools.count()
        self._random = random.Random(seed) if seed else None
        self._queues: list[list[Batch]] = [
            [] for _ in range(4)
        ]  # by relaxed plans: all, preferred; by landmarks: all, preferred
        self._priorities = [0] * 4
        self._nodes: list[Node] = []
        self._closed: set[Bits] = set()
        self._best = [UNKNOWN, UNKNOWN]

    def _found_landmarks(self, size: int) -> Landmarks:
        hidden = (1 << self.evaluate.size) - (1 << size)
        return Landmarks(
            self.evaluate.operators,
            self.initial & self.evaluate.seen,
            self.goals,
            self.evaluate.size,
            hidden,
        )

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent.

        The answer is a plan, or `NO_PLAN` if there is provably none. None means that the effort is spent.
        """
        if not self._nodes and self._expand(self.initial, -1, -1, effort):
            return SearchResult([])
        while not effort.spent():
            entry = self._next()
            if entry is None:
                return NO_PLAN
            parent, operator = entry
            state, operator = self._reached(self._nodes[parent].state, operator)
            if state not in self._closed and self._expand(state, parent, operator, effort):
                return self._answer()
        return None

    def _reached(self, state: Bits, number: int) -> tuple[Bits, int]:
        """The state after a successor's operator, and its number. A repeated operator ends where it is not applicable."""
        times, place = divmod(number, len(self.operators))
        operator = self.operators[place]
        state = after(self._axioms, state, operator)
        for done in range(1, times):
            if operator.preconditions & ~state:
                return state, place + done * len(self.operators)
            state = after(self._axioms, state, operator)
        return state, number

    def _next(self) -> tuple[int, int] | None:
        """The next successor to make, as (node, operator). None if all queues are empty."""
        number, least = -1, UNKNOWN
        for place, queue in enumerate(self._queues):
            if queue and self._priorities[place] < least:
                number, least = place, self._priorities[place]
        if number < 0:
            return None
        self._priorities[number] += 1
        batch = self._queues[number][0]
        operator = batch.operators.pop()
        if not batch.operators:
            heapq.heappop(self._queues[number])
        return batch.node, operator

    def _expand(self, state: Bits, parent: int, operator: int, effort: Effort) -> bool:
        """Evaluates a state and queues its successors. Returns whether the state satisfies the goals."""
        self._closed.add(state)
        here = len(self._nodes)
        accepted = b""
        if self._landmarks:
            before = self._nodes[parent].accepted if parent >= 0 else self._landmarks.none
            accepted = self._landmarks.accept(before, state & self.evaluate.seen)
        self._nodes.append(Node(state, accepted, parent, operator))
        if self.goals & ~state == 0:
            return True
        effort.expanded += 1
        estimate, applicable, preferred = self._evaluated(state)
        if estimate < 0:
            return False
        effort.generated += len(applicable)
        keys = (
            [estimate, self._landmarks.left(accepted, state & self.evaluate.seen)]
            if self._landmarks
            else [estimate]
        )
        if any(key < best for key, best in zip(keys, self._best, strict=False)):
            self._best = [min(pair) for pair in zip(keys, self._best, strict=False)]
            self._priorities[1] -= BOOST
            self._priorities[3] -= BOOST
        for place, key in enumerate(keys):
            for number, operators in ((2 * place, applicable), (2 * place + 1, preferred)):
                if operators:
                    heapq.heappush(self._queues[number], Batch(key, self._tie(), here, operators[::-1]))
        return False

    def _evaluated(self, state: Bits) -> tuple[int, list[int], list[int]]:
        """A state's estimate, its applicable operators and its preferred ones.

        Suggested composites are in both lists.
        """
        estimate, applicable, preferred = self.evaluate(state)
        if estimate >= 0 and (jumps := self.evaluate.jumps):
            preferred = [*(place + times * len(self.operators) for place, times in jumps), *preferred]
        if self._suggestions is None or estimate < 0:
            return estimate, applicable, preferred
        composites = self._suggestions.suggested(state, preferred, self.evaluate.relaxed)
        return estimate, composites + applicable, composites + preferred

    def _tie(self) -> int:
        """The rank among equal keys: first in, first out; with a seed, by chance."""
        return self._random.getrandbits(30) if self._random else next(self._counter)

    def _answer(self) -> SearchResult:
        """The operators that led to the last state. Composites are replaced by their parts."""
        path, node = [], self._nodes[-1]
        while node.parent >= 0:
            times, place = divmod(node.operator, len(self.operators))
            path += [place] * max(times, 1)
            node = self._nodes[node.parent]
        path.reverse()
        if self._suggestions is None:
            return SearchResult(
                [self.operators[each] for each in path if self.operators[each].instance != _MEETS]
            )
        steps = [step for each in path for step in self._suggestions.unfolded(each)]
        used = [pattern for each in path if (pattern := self._suggestions.pattern(each)) is not None]
        offer = Offer("forward", tuple(self._suggestions.patterns), tuple(dict.fromkeys(used)))
        return SearchResult([step for step in steps if step.instance != _MEETS], offer)


def forward(task: Task, seed: int, *, landmarks: bool = False, patterns: Sequence[Pattern] = ()) -> Forward:
    """The search for a task.

    If the goals have several alternatives, a new atom becomes the goal. For each alternative there is an
    internal operator that adds this atom.
    """
    size, operators, goals = len(task.atoms), task.operators, task.goals
    if len(goals) != 1:
        task.reserve(size)
        meet = (GroundOperator(_MEETS, goal, 1 << size, 0, cost=0) for goal in goals)
        operators, goals, size = (*operators, *meet), (1 << size,), size + 1
    return Forward(
        operators,
        task.initial,
        goals[0],
        size,
        seed,
        landmarks=landmarks,
        patterns=() if task.axioms else patterns,
        axioms=task.axioms,
    )
