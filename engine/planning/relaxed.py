"""Relaxed plans from a state: for each atom the operators that a plan without deletes would use to reach it.

Computed once forward, best supporter first by additive cost, as in the set-additive heuristic (Keyder & Geffner 2008).
The estimate for a set of goals is the size of the union of their relaxed plans: one OR per goal and one bit count.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

from engine.model.task import Bits, GroundOperator, indices

FAR = 1 << 60
MAX_CHARGE = 8  # bits that the costliest operator takes up in a relaxed plan


@dataclass(frozen=True, slots=True)
class RelaxedPlans:
    """Per atom its relaxed plan, None if the atom is unreachable, 0 for what holds already.

    A plan is a bitset in which every supporter has as many bits of its own as its charge, so that the bit count is the
    cost. `supporters` names the operator that reaches each atom, -1 if none.
    """

    initial: Bits
    plans: list[Bits | None]
    supporters: list[int]

    def plan(self, goals: Bits) -> Bits | None:
        """The union of the goals' relaxed plans; None if one is unreachable."""
        union = 0
        for atom in indices(goals & ~self.initial):
            plan = self.plans[atom]
            if plan is None:
                return None
            union |= plan
        return union


class Relaxation:
    """Operators indexed for relaxed plans; what does not depend on the state is made once."""

    def __init__(self, operators: Sequence[GroundOperator], size: int) -> None:
        self.operators = operators
        self._most = max((operator.cost for operator in operators), default=1)
        self.charges = [self.charge(operator) for operator in operators]
        self.adds = [tuple(indices(operator.adds)) for operator in operators]
        self.missing = [operator.preconditions.bit_count() for operator in operators]
        self.free = [number for number, count in enumerate(self.missing) if not count]
        self.consumers: list[list[int]] = [[] for _ in range(size)]
        for number, operator in enumerate(operators):
            for atom in indices(operator.preconditions):
                self.consumers[atom].append(number)

    def charge(self, operator: GroundOperator) -> int:
        """An operator's cost as a small whole number, at least 1."""
        if self._most <= MAX_CHARGE:
            return max(operator.cost, 1)
        return max(round(operator.cost * MAX_CHARGE / self._most), 1)

    def plans(self, initial: Bits, bound: int = FAR) -> RelaxedPlans:
        """Relaxed plans for every atom that a chain of supporters of cost at most `bound` reaches from `initial`."""
        return _Wave(self, initial, bound).spread()


class _Wave:
    """One Dijkstra search over additive costs."""

    def __init__(self, relaxation: Relaxation, initial: Bits, bound: int) -> None:
        self.relaxation, self.initial, self.bound = relaxation, initial, bound
        size = len(relaxation.consumers)
        self.plans: list[Bits | None] = [None] * size
        self.supporters, self.best, self.depths = [-1] * size, [FAR] * size, [0] * size
        self.missing, self.spent = relaxation.missing.copy(), relaxation.charges.copy()
        self.ends = (
            relaxation.charges.copy()
        )  # of the longest chain of supporters to each operator, itself included
        self.queue = [(0, atom) for atom in indices(initial)]
        for _, atom in self.queue:
            self.best[atom] = 0
        self.own: dict[int, Bits] = {}
        self.bits = 0

    def spread(self) -> RelaxedPlans:
        """Settle atoms, cheapest first, until none is left."""
        self._offer(self.relaxation.free)
        while self.queue:
            cost, atom = heapq.heappop(self.queue)
            if self.plans[atom] is None:
                self.plans[atom] = self._joined(self.supporters[atom])
                self._offer(self._ready(atom, cost))
        return RelaxedPlans(self.initial, self.plans, self.supporters)

    def _offer(self, ready: Sequence[int]) -> None:
        """Note what operators add, where that is cheaper than before."""
        best, adds = self.best, self.relaxation.adds
        for number in ready:
            cost = self.spent[number]
            if self.ends[number] > self.bound:
                continue
            for atom in adds[number]:
                if cost < best[atom]:
                    best[atom], self.supporters[atom], self.depths[atom] = cost, number, self.ends[number]
                    heapq.heappush(self.queue, (cost, atom))

    def _ready(self, atom: int, cost: int) -> list[int]:
        """The operators whose last condition was `atom`."""
        missing, spent, ends, ready = self.missing, self.spent, self.ends, []
        charges, depth = self.relaxation.charges, self.depths[atom]
        for number in self.relaxation.consumers[atom]:
            missing[number] -= 1
            spent[number] += cost
            ends[number] = max(ends[number], depth + charges[number])
            if not missing[number]:
                ready.append(number)
        return ready

    def _joined(self, supporter: int) -> Bits:
        """The plan that ends in a supporter, which takes new bits when it is first used."""
        if supporter < 0:
            return 0
        if supporter not in self.own:
            charge = self.relaxation.charges[supporter]
            self.own[supporter] = (1 << charge) - 1 << self.bits
            self.bits += charge
        union = self.own[supporter]
        for atom in indices(self.relaxation.operators[supporter].preconditions):
            union |= self.plans[atom] or 0
        return union


def levels(initial: Bits, operators: Sequence[GroundOperator], size: int) -> tuple[list[int], list[int]]:
    """The steps after which atoms, and at which operators, are first possible without deletes; -1 for never."""
    reached, first = [-1] * size, [-1] * len(operators)
    for atom in indices(initial):
        reached[atom] = 0
    state, waiting, step = initial, list(range(len(operators))), 0
    while waiting:
        step += 1
        ready = [number for number in waiting if operators[number].preconditions & ~state == 0]
        if not ready:
            break
        waiting = [number for number in waiting if operators[number].preconditions & ~state]
        for number in ready:
            first[number] = step
            for atom in indices(operators[number].adds & ~state):
                reached[atom] = step
        for number in ready:
            state |= operators[number].adds
    return reached, first
