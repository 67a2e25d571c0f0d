"""Forward search for goals about quantities, guided by how often each operator must be done.

The estimate is the sum of the counts, and the cost of a relaxed plan for what the counted operators
need besides quantities that the counts look after, and for all other goals. An operator that is
counted several times is done so often at once, if it is applicable (as Coles, Fox, Long & Smith
2008 join linear programs and relaxed plans).
"""

import heapq
import math
from collections.abc import Sequence

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.model.ground_axioms import Axioms
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.stages.planning.forward.balances import ALMOST, Balances
from cellwright.engine.stages.planning.forward.forward_search import (
    PREFERRED,
    ForwardSearch,
    SuccessorBatch,
    in_order,
    with_one_goal,
)
from cellwright.engine.stages.planning.forward.state_evaluation import StateEvaluation
from cellwright.engine.stages.planning.search_control import (
    NO_PLAN,
    Effort,
    OutOfRange,
    SearchResult,
)

KEPT = 200  # evaluations for sets of conditions that are kept


class Counting(ForwardSearch):
    """One search from a state to one conjunction of goals; it can be resumed.

    It never proves that there is no plan.
    """

    def __init__(
        self,
        operators: Sequence[GroundOperator],
        initial: Bits,
        goals: Bits,
        size: int,
        seed: int,
        axioms: Axioms,
    ) -> None:
        super().__init__(operators, initial, goals, size, seed, axioms=axioms, joint=True)
        self._balances = Balances(operators, goals, axioms)
        self._places = frozenset(self._balances.operators)
        self._rest = goals & ~self._balances.covered
        self._evaluations: dict[Bits, StateEvaluation] = {}

    @property
    def useful(self) -> bool:
        """Whether a goal asks for quantities that operators change by fixed amounts."""
        return bool(self._places)

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent, which is None; so it is if
        nothing is left to search.
        """
        try:
            answer = super().run(effort)
        except OutOfRange:
            return None
        return None if answer is NO_PLAN else answer

    def _expand(self, state: bytes, parent: int, operator: int, effort: Effort) -> bool:
        """As in other searches.

        Counted operators that are applicable come before all others with the same estimate.
        """
        self._counted: list[int] = []
        if super()._expand(state, parent, operator, effort):
            return True
        if self._counted:
            here = len(self._nodes) - 1
            batch = SuccessorBatch(self._estimate - 1, self._tie(), here, in_order(self._counted))
            heapq.heappush(self._queues[PREFERRED], batch)
        return False

    def _evaluated(self, state: bytes) -> tuple[int, list[int], list[int]]:
        counts = self._balances.counts(self._space.values(state))
        if counts is None:
            return -1, [], []
        needs = self._rest
        for number in counts.times:
            needs |= self.operators[number].preconditions & ~self._balances.covered
        evaluate = self._towards(needs)
        estimate, applicable, preferred = evaluate(state)
        if estimate < 0:
            return -1, [], []
        self._counted = [
            number + math.floor(times + ALMOST) * len(self.operators)
            for number in applicable
            if (times := counts.times.get(number, 0)) >= 1 - ALMOST
        ]
        jumps = [place + times * len(self.operators) for place, times in evaluate.jumps]
        self._estimate = math.ceil(counts.total - ALMOST) + estimate
        return self._estimate, applicable, [*jumps, *preferred]

    def _towards(self, needs: Bits) -> StateEvaluation:
        found = self._evaluations.pop(needs, None) or self.evaluate.towards(needs)
        self._evaluations[needs] = found
        if len(self._evaluations) > KEPT:
            del self._evaluations[next(iter(self._evaluations))]
        return found


def search_by_counts(task: GroundTask, seed: int) -> Counting | None:
    """The search for a task; None if no goal asks for quantities that operators change by fixed
    amounts.
    """
    if task.axioms is None or not task.axioms.tests:
        return None
    operators, goal, size = with_one_goal(task)
    found = Counting(operators, task.initial, goal, size, seed, task.axioms)
    return found if found.useful else None
