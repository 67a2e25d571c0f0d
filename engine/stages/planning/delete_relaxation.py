"""Delete relaxation: for each atom the operators that reach it if nothing is ever deleted.

They are computed forward once for each state. Each atom gets the best supporter by additive cost,
as in the set-additive heuristic (Keyder & Geffner 2008). The estimate for a set of goals is the
size of the union of their relaxed plans. It takes one OR per goal and one bit count.
"""

from collections.abc import Sequence

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_task import GroundOperator
from cellwright.engine.stages.planning.relaxed_plans import RelaxedPlans
from cellwright.engine.stages.planning.supporters import Supporters

UNREACHABLE_COST = 1 << 60
MAX_CHARGE = 8  # bits of the costliest operator in a relaxed plan


class Relaxation:
    """Operators indexed for relaxed plans.

    Everything that does not depend on the state is computed once.
    """

    def __init__(self, operators: Sequence[GroundOperator], size: int) -> None:
        self.operators = operators
        self._most = max((operator.cost for operator in operators), default=1)
        self.charges = [self.charge(operator) for operator in operators]
        self.needs = [tuple(indices(operator.preconditions)) for operator in operators]
        adds = [tuple(indices(operator.adds)) for operator in operators]
        users: list[list[int]] = [[] for _ in range(size)]
        for number, needs in enumerate(self.needs):
            for atom in needs:
                users[atom].append(number)
        self._width = (size + 7) // 8
        self._search = Supporters(self.charges, self.needs, adds, users)

    def charge(self, operator: GroundOperator) -> int:
        """An operator's cost as a small whole number, at least 1."""
        if self._most <= MAX_CHARGE:
            return max(operator.cost, 1)
        return max(round(operator.cost * MAX_CHARGE / self._most), 1)

    def plans(self, initial: Bits, bound: int = UNREACHABLE_COST) -> RelaxedPlans:
        """Relaxed plans from `initial`.

        They exist for atoms that a chain of supporters with a cost of at most `bound` reaches.
        """
        supporters = self._search.spread(
            (initial & (1 << 8 * self._width) - 1).to_bytes(self._width, "little"), bound
        )
        return RelaxedPlans(initial, self.needs, self.charges, supporters)


def reachability_levels(
    initial: Bits, operators: Sequence[GroundOperator], size: int
) -> tuple[list[int], list[int]]:
    """The first step after which each atom can be true, and the first step at which each operator
    can occur.

    Deletes are ignored. The number -1 means never.
    """
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
