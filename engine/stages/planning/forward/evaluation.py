"""Evaluation of states by compiled kernels.

In relaxed plans each conditional effect is an operator of its own, beside the ordinary operators. So is each rule of a derived
atom, which costs nothing, and each operator that is repeated until quantities compare as wanted.
"""

import copy
from collections.abc import Sequence
from dataclasses import replace

from cellwright.engine.model.axioms import Axioms, relaxed
from cellwright.engine.model.task import Bits, GroundOperator, indices
from cellwright.engine.stages.planning.forward.kernels import RelaxedPlans, Rows
from cellwright.engine.stages.planning.forward.repeating import Repeating
from cellwright.engine.stages.planning.forward.space import Space
from cellwright.kb.terms import Function

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

    With `unit` every operator costs 1, so that plans are short instead of cheap. With `joint` an operator counts once, however
    many of its conditional effects a relaxed plan uses: so a step that serves many at once costs no more than for one.
    """

    def __init__(
        self,
        operators: Sequence[GroundOperator],
        goals: Bits,
        size: int,
        *,
        unit: bool = False,
        joint: bool = False,
        axioms: Axioms | None = None,
    ) -> None:
        self._joint = joint
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
        self._charges = charges
        self.operators += free
        self._owners += [NOBODY] * len(free)
        needs = [tuple(indices(operator.preconditions)) for operator in self.operators]
        adds = [tuple(indices(operator.adds)) for operator in self.operators]
        users: list[list[int]] = [[] for _ in range(size)]
        for number, needed in enumerate(needs):
            for atom in needed:
                users[atom].append(number)
        self._costs = [*charges, *(rule.cost for rule in free)]
        self.size, self.space = size, Space(operators, size, axioms)
        self._rows = Rows(needs), Rows(adds), Rows(users)
        self._plans = self._towards(goals)

    def towards(self, goals: Bits) -> "Evaluation":
        """The same for other goals; the two share what is large."""
        fresh = copy.copy(self)
        fresh._plans = self._towards(goals)
        return fresh

    def _towards(self, goals: Bits) -> RelaxedPlans:
        return RelaxedPlans(self._costs, tuple(indices(goals)), *self._rows, self._plain)

    def __call__(self, state: bytes) -> tuple[int, list[int], list[int]]:
        """The cost of a relaxed plan from a packed state (-1 if there is none), the applicable and the preferred operators.

        An applicable operator is preferred if the relaxed plan begins with it.
        """
        if self._repeating is not None:
            self._plans.charge(
                self._first, self._repeating.of, self._repeating.costs(self.space.values(state))
            )
        estimate = self._plans.evaluate(state)
        if self._joint and estimate > 0:
            estimate = self._once()
        found, helpful = self._plans.applicable, self._plans.preferred
        if len(self.operators) > self._plain:
            helpful = self._owned(helpful)
        return estimate, found, helpful

    def _once(self) -> int:
        """The cost of the last relaxed plan where each given operator counts once, as dear as it is used at most."""
        dearest: dict[int, int] = {}
        for number in self._plans.relaxed:
            owner = self._owners[number]
            if owner != NOBODY:
                dearest[owner] = max(dearest.get(owner, 0), self._cost(number))
        return sum(dearest.values())

    def _cost(self, number: int) -> int:
        if self._repeating is None or number < self._first:
            return self._charges[number]
        return self._repeating.cost(number - self._first)

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
