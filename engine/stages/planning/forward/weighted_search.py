"""Weighted search: lazy weighted A* forward for a plan that costs less than a bound.

What a way has cost counts besides what the estimate says is left; the less the estimate weighs, the
cheaper the plans and the longer the search. A state that is reached again at less cost is followed
again. Searches begin anew with each better plan, because a search that goes on stays near its first
decisions (Richter, Thayer & Ruml 2010).
"""

import copy
from collections.abc import Sequence

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.model.ground_axioms import Axioms
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.stages.planning.forward.forward_search import (
    UNKNOWN_ESTIMATE,
    ForwardSearch,
    with_one_goal,
)
from cellwright.engine.stages.planning.forward.landmarks import LandmarkHints
from cellwright.engine.stages.planning.search_control import NO_PLAN, Effort, SearchResult


class WeightedSearch(ForwardSearch):
    """One search from a state to one conjunction of goals, for plans that cost less than a bound;
    it can be resumed.

    Where all ways that cost less than the bound have been followed to their ends, the answer is
    `NO_PLAN`.
    """

    def __init__(
        self,
        operators: Sequence[GroundOperator],
        initial: Bits,
        goals: Bits,
        size: int,
        *,
        landmarks: LandmarkHints | None = None,
        axioms: Axioms | None = None,
    ) -> None:
        self._weight, self._limit = 1, UNKNOWN_ESTIMATE
        super().__init__(operators, initial, goals, size, landmarks=landmarks, axioms=axioms)

    def _begin(self, seed: int) -> None:
        super()._begin(seed)
        self._costs = list[int]()  # of the way to each node
        self._least = {self.initial: 0}  # of the ways to each state

    def anew(self, weight: int, bound: int, seed: int) -> "WeightedSearch":
        """A search from the beginning with another weight, bound and seed.

        The two share what evaluates states.
        """
        fresh = copy.copy(self)
        fresh._weight, fresh._limit = weight, bound
        fresh._begin(seed)
        return fresh

    def between(self, state: Bits, goals: Bits, bound: int) -> "WeightedSearch":
        """A search from another state to other goals, without landmarks, with weight 1."""
        fresh = copy.copy(self)
        fresh.initial, fresh._goals = self._space.packed(state), goals
        fresh.evaluate, fresh._landmarks = self.evaluate.towards(goals), None
        fresh._weight, fresh._limit = 1, bound
        fresh._begin(0)
        return fresh

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent, which is None."""
        if self._limit <= 0:
            return NO_PLAN
        if not self._nodes and self._follow(self.initial, -1, -1, 0, effort):
            return SearchResult([])
        while not effort.spent():
            entry = self._next()
            if entry is None:
                return self._space.exhausted()
            parent, operator = entry
            state, operator = self._reached(self._nodes[parent].state, operator)
            cost = self._costs[parent] + self._charge(operator)
            if not state or cost >= self._limit or self._least.get(state, UNKNOWN_ESTIMATE) <= cost:
                continue
            self._least[state] = cost
            if self._follow(state, parent, operator, cost, effort):
                return self._answer()
        return None

    def _follow(self, state: bytes, parent: int, operator: int, cost: int, effort: Effort) -> bool:
        self._costs.append(cost)
        return self._expand(state, parent, operator, effort)

    def _charge(self, number: int) -> int:
        """What a successor costs."""
        times, place = divmod(number, len(self.operators))
        return max(times, 1) * self.operators[place].cost

    def _rank(self, key: int, node: int) -> int:
        return self._costs[node] + self._weight * key


def start_weighted_search(task: GroundTask, *, landmarks: bool = False) -> WeightedSearch:
    """The search for a task."""
    operators, goal, size = with_one_goal(task)
    return WeightedSearch(
        operators,
        task.initial,
        goal,
        size,
        landmarks=LandmarkHints.of(task) if landmarks else None,
        axioms=task.axioms,
    )


def search_between(operators: Sequence[GroundOperator], size: int) -> WeightedSearch:
    """The search `between` states of a plan, by operators without conditional effects over
    atoms below `size`.
    """
    return WeightedSearch(operators, 0, 0, size)
