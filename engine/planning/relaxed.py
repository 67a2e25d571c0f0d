"""Relaxed plans from a state: for each atom the operators that a plan without deletes would use to reach it.

Computed once forward, best supporter first by additive cost, as in the set-additive heuristic (Keyder & Geffner 2008).
The estimate for a set of goals is the cost of the union of their relaxed plans: one OR per goal and one bit count.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

from engine.model.task import Bits, GroundOperator, indices


@dataclass(frozen=True, slots=True)
class RelaxedPlans:
    """Per atom its relaxed plan as a bitset of operators, None if the atom is unreachable; 0 for what holds already."""

    plans: tuple[Bits | None, ...]
    costs: tuple[int, ...]
    unit: bool

    def plan(self, goals: Bits) -> Bits | None:
        """The union of the goals' relaxed plans; None if one is unreachable."""
        union = 0
        for atom in indices(goals):
            plan = self.plans[atom]
            if plan is None:
                return None
            union |= plan
        return union

    def cost(self, plan: Bits) -> int:
        """The cost of a set of operators."""
        if self.unit:
            return plan.bit_count()
        return sum(self.costs[index] for index in indices(plan))


def relaxed_plans(initial: Bits, operators: Sequence[GroundOperator], size: int) -> RelaxedPlans:
    """Relaxed plans from `initial` for every atom below `size` (a Dijkstra over additive costs)."""
    costs = tuple(max(operator.cost, 1) for operator in operators)
    missing = [operator.preconditions.bit_count() for operator in operators]
    consumers = _consumers(operators, size)
    plans: list[Bits | None] = [None] * size
    best = [0 if initial >> atom & 1 else -1 for atom in range(size)]
    spent = list(costs)
    queue = [(0, atom, -1) for atom in range(size) if initial >> atom & 1]
    queue += [
        (spent[n], atom, n) for n, o in enumerate(operators) if not missing[n] for atom in indices(o.adds)
    ]
    heapq.heapify(queue)
    while queue:
        cost, atom, supporter = heapq.heappop(queue)
        if plans[atom] is not None:
            continue
        plans[atom] = 0 if supporter < 0 else _joined(plans, operators[supporter], supporter)
        for number in consumers[atom]:
            missing[number] -= 1
            spent[number] += cost
            if not missing[number]:
                for added in indices(operators[number].adds):
                    if plans[added] is None and (best[added] < 0 or spent[number] < best[added]):
                        best[added] = spent[number]
                        heapq.heappush(queue, (spent[number], added, number))
    return RelaxedPlans(tuple(plans), costs, all(cost == 1 for cost in costs))


def _consumers(operators: Sequence[GroundOperator], size: int) -> list[list[int]]:
    """For each atom the operators that need it."""
    consumers: list[list[int]] = [[] for _ in range(size)]
    for number, operator in enumerate(operators):
        for atom in indices(operator.preconditions):
            consumers[atom].append(number)
    return consumers


def _joined(plans: Sequence[Bits | None], operator: GroundOperator, number: int) -> Bits:
    union = 1 << number
    for atom in indices(operator.preconditions):
        union |= plans[atom] or 0
    return union
