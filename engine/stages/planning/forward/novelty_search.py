"""Novelty search: next is the state with most facts that no state as near to the goals had.

How near a state is says how many steps its goals take, each by itself; without quantities this is
the number of open goals. Each successor is looked at when it is made (Lipovetzky & Geffner 2017;
with quantities: Chen & Thiebaux 2024). Where a relaxed plan repeats a step, the state after all
these steps is a successor, too.
"""

import heapq
import itertools
from typing import NamedTuple

from cellwright.engine.kernels.bits import indices
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.stages.planning.forward.forward_search import plan_of_path, with_one_goal
from cellwright.engine.stages.planning.forward.packed_states import make_fronts
from cellwright.engine.stages.planning.forward.state_evaluation import (
    StateEvaluation,
    goal_distance,
)
from cellwright.engine.stages.planning.forward.transitions import Novelty
from cellwright.engine.stages.planning.search_control import Effort, SearchResult, random_source


class NoveltyNode(NamedTuple):
    """A packed state that was made, and the step that led to it."""

    state: bytes
    parent: int
    step: int


class NoveltySearch:
    """One search; it can be resumed.

    A step is the number of an operator, plus that of all operators for each time that it is done.
    """

    def __init__(self, task: GroundTask, seed: int = 0) -> None:
        self.operators, self._goals, size = with_one_goal(task)
        self._evaluate = StateEvaluation(
            self.operators, self._goals, size, unit=True, axioms=task.axioms
        )
        self._space = self._evaluate.space
        self._distance = goal_distance(
            self.operators, indices(self._goals), task.axioms, self._space.width
        )
        self._novelty = Novelty(self._space.width, self._space.quantities)
        self._fronts = make_fronts(self.operators, self._goals, task.axioms, self._space)
        self._random, self._counter = random_source(seed), itertools.count()
        self._nodes = [NoveltyNode(self._space.packed(task.initial), -1, -1)]
        # how new, how far, what breaks ties, and the number of the node
        self._queue = [(0, 0, 0, 0)]

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent.

        The answer is a plan, or `NO_PLAN` if there is provably none. None means that the effort is
        spent.
        """
        if len(self._nodes) == 1 and self._at_goal(self._nodes[0].state):
            return SearchResult([])
        while not effort.spent():
            if not self._queue:
                return self._space.exhausted()
            node = heapq.heappop(self._queue)[-1]
            effort.expanded += 1
            if self._expand(node, effort):
                return plan_of_path(self.operators, self._path())
        return None

    def _at_goal(self, state: bytes) -> bool:
        return self._goals & ~self._space.atoms(state) == 0

    def _expand(self, node: int, effort: Effort) -> bool:
        """Makes the successors of a node that are not met yet.

        Returns whether the last one satisfies the goals.
        """
        state, count = self._nodes[node].state, len(self.operators)
        estimate, applicable, _ = self._evaluate(state)
        if estimate < 0:
            return False
        repeated = [place + times * count for place, times in self._evaluate.jumps]
        effort.generated += len(applicable)
        for step in repeated + applicable:
            times, place = divmod(step, count)
            after, done = self._space.after(state, place, max(times, 1))
            if not after or self._fronts.met(after):
                continue
            self._nodes.append(NoveltyNode(after, node, place + done * count))
            if self._at_goal(after):
                return True
            distance_left = self._distance.of(after)
            entry = (
                self._novelty.rank(after, distance_left),
                distance_left,
                self._tie(),
                len(self._nodes) - 1,
            )
            heapq.heappush(self._queue, entry)
        return False

    def _tie(self) -> int:
        """The rank among equal states: first in, first out; with a seed, by chance."""
        return self._random.getrandbits(30) if self._random else next(self._counter)

    def _path(self) -> list[int]:
        """The steps to the last node."""
        path, node = [], self._nodes[-1]
        while node.parent >= 0:
            path.append(node.step)
            node = self._nodes[node.parent]
        return path[::-1]
