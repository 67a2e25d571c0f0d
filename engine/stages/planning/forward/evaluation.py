"""Evaluation of states by compiled kernels.

In relaxed plans each conditional effect is an operator of its own, beside the ordinary operators. So is each rule of a derived
atom, which costs nothing, and each operator that is repeated until quantities compare as wanted.
"""

from collections.abc import Sequence
from dataclasses import replace

from engine.model.axioms import Axioms, relaxed
from engine.model.task import Bits, GroundOperator, indices
from engine.stages.planning.forward.kernels import RelaxedPlans, Rows
from engine.stages.planning.forward.repeating import Repeating
from kb.terms import Function

DEAREST = 1 << 30  # the largest cost of an operator; higher costs are cut off
NOBODY = -1  # stands for the operator behind a rule
_RULE = Function("_rule")


def effects(operators: Sequence[GroundOperator]) -> tuple[list[GroundOperator], list[int]]:
    """The operators for relaxed plans, and for each the number of the given operator behind it.

    The given operators come first, then one for each conditional effect. Relaxed plans ignore deletes.
    """
    relaxed, owners = list(operators), list(range(len(operators)))
    for number, operator in enumerate(operators):
        for effect in operator.conditional:
            condition = operator.preconditions | effect.condition
            relaxed.append(replace(operator, preconditions=condition, adds=effect.adds, conditional=()))
            owners.append(number)
    return relaxed, owners


def rules(axioms: Axioms | None, size: int) -> list[GroundOperator]:
    """The rules of derived atoms as operators for relaxed plans. They may add atoms of their own, from `size` on."""
    if axioms is None:
        return []
    found = relaxed(axioms, size)
    return [GroundOperator(_RULE, needs, adds, 0, cost=0 if certain else 1) for needs, adds, certain in found]


class Evaluation:
    """Relaxed plans from any closed state to one conjunction of goals, over atoms below `size`.

    Of a state, only the atoms in `seen` count: not the values of quantities, but what compares them.

    With `unit` every operator costs 1, so that plans are short instead of cheap.
    """

    def __init__(
        self,
        operators: Sequence[GroundOperator],
        goals: Bits,
        size: int,
        *,
        unit: bool = False,
        axioms: Axioms | None = None,
    ) -> None:
        self.operators, self._owners = effects(operators)
        self._plain = len(operators)
        free = rules(axioms, size)
        size = max([size, *((rule.preconditions | rule.adds).bit_length() for rule in free)])
        charges = [1 if unit else min(max(operator.cost, 1), DEAREST) for operator in self.operators]
        self._first, self._repeating = len(self.operators), None
        if axioms is not None and axioms.tests:
            self._repeating = Repeating(operators, charges, axioms)
            self.operators += self._repeating.operators
            self._owners += [each.operator for each in self._repeating.found]
            charges += self._repeating.charges
        self.operators += free
        self._owners += [NOBODY] * len(free)
        self._width = (size + 7) // 8
        self.seen = (1 << (axioms.size if axioms is not None and axioms.tests else size)) - 1
        needs = [tuple(indices(operator.preconditions)) for operator in self.operators]
        adds = [tuple(indices(operator.adds)) for operator in self.operators]
        users: list[list[int]] = [[] for _ in range(size)]
        for number, needed in enumerate(needs):
            for atom in needed:
                users[atom].append(number)
        costs = [*charges, *(rule.cost for rule in free)]
        self.size = size
        self._plans = RelaxedPlans(costs, tuple(indices(goals)), Rows(needs), Rows(adds), Rows(users))

    def __call__(self, state: Bits) -> tuple[int, list[int], list[int]]:
        """The cost of a relaxed plan (-1 if there is none), the applicable and the preferred operators.

        An applicable operator is preferred if the relaxed plan begins with it.
        """
        if self._repeating is not None:
            self._plans.charge(self._first, self._repeating.costs(state))
        estimate = self._plans.evaluate((state & self.seen).to_bytes(self._width, "little"))
        found, helpful = self._plans.applicable, self._plans.preferred
        if len(self.operators) > self._plain:
            found = [number for number in found if number < self._plain]
            helpful = self._owned(helpful)
        return estimate, found, helpful

    @property
    def relaxed(self) -> list[int]:
        """The operators in the relaxed plan of the state that was evaluated last."""
        if len(self.operators) == self._plain:
            return self._plans.relaxed
        return self._owned(self._plans.relaxed)

    @property
    def jumps(self) -> list[tuple[int, int]]:
        """Operators that the last relaxed plan repeats and that are applicable, each with the number of times, from 2 on."""
        if self._repeating is None:
            return []
        ready, last = set(self._plans.preferred), self._first + len(self._repeating.found)
        repeated = [each for each in self._plans.relaxed if each in ready and self._first <= each < last]
        found = ((self._owners[each], self._repeating.times(each - self._first)) for each in repeated)
        return [each for each in dict.fromkeys(found) if each[1] > 1]

    def _owned(self, numbers: Sequence[int]) -> list[int]:
        """The given operators behind those of a relaxed plan."""
        owners = dict.fromkeys(self._owners[number] for number in numbers)
        owners.pop(NOBODY, None)
        return list(owners)
