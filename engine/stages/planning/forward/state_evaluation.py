"""Evaluation of states by relaxed plans, in which steps that change quantities are repeated.

For each comparison and each operator that leads towards it there is an operator whose cost depends
on the state: as many steps as the comparison is away from being true (the subgoaling relaxation of
Scala, Haslum, Thiebaux & Ramirez 2020).
"""

import copy
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import accumulate
from typing import NamedTuple

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.kernels.packed_rows import PackedRows
from cellwright.engine.kernels.sums import Repetitions
from cellwright.engine.model.ground_axioms import (
    COMPARISON_SIGNS,
    OPPOSITE_SIGNS,
    Axioms,
    Comparing,
    Linear,
    QuantityLevel,
    relax_axioms,
)
from cellwright.engine.model.ground_task import GroundOperator
from cellwright.engine.stages.planning.forward.kernels import Longs, RelaxedPlans
from cellwright.engine.stages.planning.forward.packed_states import PackedSpace
from cellwright.engine.stages.planning.forward.transitions import Distance
from cellwright.kb.terms import Function


class RepetitionKind(NamedTuple):
    """Something adds `gain` to the sum of a comparison until it relates as wanted; then `atom`
    is true.
    """

    test: int
    atom: int
    relation: str
    gain: int


class RepeatedOperator(NamedTuple):
    """An operator, by its number, and what repeating it does."""

    operator: int
    kind: RepetitionKind


class RepeatedSteps:
    """The operators for relaxed plans that stand for repeated steps, and what they cost in a
    state.
    """

    def __init__(
        self, operators: Sequence[GroundOperator], charges: Sequence[int], axioms: Axioms
    ) -> None:
        self.found = list(_repeated_operators(operators, axioms))
        self.operators = [
            replace(
                operators[repeated.operator],
                adds=1 << repeated.kind.atom,
                conditional=(),
                changes=(),
            )
            for repeated in self.found
        ]
        self.charges = [charges[repeated.operator] for repeated in self.found]
        own = [
            (repeated.kind, charge)
            for repeated, charge in zip(self.found, self.charges, strict=True)
        ]
        different = {key: place for place, key in enumerate(dict.fromkeys(own))}
        self.of = array("i", [different[key] for key in own])
        self._times = _make_repetitions(
            [k for k, _ in different], [charge for _, charge in different], axioms
        )

    def costs(self, values: "memoryview[int]") -> Longs:
        """What the operators cost where quantities have these values."""
        self._costs = self._times.needed(values)
        return self._costs

    def cost(self, number: int) -> int:
        """What an operator costs in the state that was looked at last."""
        return self._costs[self.of[number]]

    def times(self, number: int) -> int:
        """How often an operator is repeated in the state that was looked at last."""
        return self.cost(number) // self.charges[number]


def _make_repetitions(
    kinds: Sequence[RepetitionKind], charges: Sequence[int], axioms: Axioms
) -> Repetitions:
    return Repetitions(
        axioms.comparisons,
        [kind.test for kind in kinds],
        [COMPARISON_SIGNS.index(kind.relation) for kind in kinds],
        [kind.gain for kind in kinds],
        charges,
    )


def _repeated_operators(
    operators: Sequence[GroundOperator], axioms: Axioms
) -> Iterator[RepeatedOperator]:
    by_level: dict[QuantityLevel, list[int]] = {}
    for place, comparison in enumerate(axioms.tests):
        for level, _ in comparison.sum.parts:
            by_level.setdefault(level, []).append(place)
    for number, operator in enumerate(operators):
        for test in dict.fromkeys(
            test for change in operator.changes for test in by_level.get(change.level, ())
        ):
            gain = _comparison_gain(operator, axioms.tests[test])
            if gain is not None:
                yield from _repetitions_towards(number, test, gain, axioms)


def _comparison_gain(operator: GroundOperator, test: Comparing) -> int | None:
    """What an operator adds to the sum of a comparison: None if nothing, 0 if it depends on the
    state.
    """
    factors = dict(test.sum.parts)
    gain = Linear((), 0)
    for change in operator.changes:
        if factor := factors.get(change.level, 0):
            gain = gain.plus(change.to.without(change.level), factor)
    if gain.parts:
        return 0
    return gain.constant or None


def _repetitions_towards(
    operator: int, test: int, gain: int, axioms: Axioms
) -> Iterator[RepeatedOperator]:
    """The comparison and its opposite, as far as the gain leads towards them."""
    compared = axioms.tests[test]
    pairs = [(compared.atom, compared.relation)]
    if compared.atom in axioms.complements:
        pairs.append((axioms.complements[compared.atom], OPPOSITE_SIGNS[compared.relation]))
    for atom, relation in pairs:
        if gain == 0 or relation in ("=", "!=") or (gain > 0) == (relation in (">", ">=")):
            yield RepeatedOperator(operator, RepetitionKind(test, atom, relation, gain))


def goal_distance(
    operators: Sequence[GroundOperator], goals: Sequence[int], axioms: Axioms | None, width: int
) -> Distance:
    """How far packed states are from goals, with `width` bytes of atoms."""
    if axioms is None or not axioms.tests:
        return Distance(width, goals, None, [0] * (len(goals) + 1))
    kinds = dict.fromkeys(repeated.kind for repeated in _repeated_operators(operators, axioms))
    groups = [[kind for kind in kinds if kind.atom == goal] for goal in goals]
    ordered = [kind for group in groups for kind in group]
    starts = [0, *accumulate(map(len, groups))]
    return Distance(width, goals, _make_repetitions(ordered, [1] * len(ordered), axioms), starts)


MAX_OPERATOR_COST = 1 << 30  # the largest cost of an operator; higher costs are cut off
NO_OPERATOR = -1  # stands for the operator behind a rule
_RULE_INSTANCE = Function("_rule")


def split_effects(operators: Sequence[GroundOperator]) -> tuple[list[GroundOperator], list[int]]:
    """The operators for relaxed plans, and for each the number of the given operator behind it.

    The given operators come first, then one for each conditional effect. Relaxed plans ignore
    deletes.
    """
    relaxed, owners = list(operators), list(range(len(operators)))
    for number, operator in enumerate(operators):
        for effect in operator.conditional:
            condition = operator.preconditions | effect.condition
            relaxed.append(
                replace(operator, preconditions=condition, adds=effect.adds, conditional=())
            )
            owners.append(number)
    return relaxed, owners


def rule_operators(axioms: Axioms | None, size: int) -> list[GroundOperator]:
    """The rules of derived atoms as operators for relaxed plans.

    They may add atoms of their own, from `size` on.
    """
    if axioms is None:
        return []
    relaxed_rules = relax_axioms(axioms, size)
    return [
        GroundOperator(_RULE_INSTANCE, needs, adds, 0, cost=0 if certain else 1)
        for needs, adds, certain in relaxed_rules
    ]


class StateEvaluation:
    """Relaxed plans from any closed state to one conjunction of goals, over atoms below `size`.

    With `unit` every operator costs 1, so that plans are short instead of cheap. With `joint` an
    operator counts once, however many of its conditional effects a relaxed plan uses: so a step
    that serves many at once costs no more than for one.
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
        self.operators, self._owners = split_effects(operators)
        self._plain = len(operators)
        free = rule_operators(axioms, size)
        size = max([size, *((rule.preconditions | rule.adds).bit_length() for rule in free)])
        charges = [
            1 if unit else min(max(operator.cost, 1), MAX_OPERATOR_COST)
            for operator in self.operators
        ]
        self._first, self._repeating = len(self.operators), None
        if axioms is not None and axioms.tests:
            self._repeating = RepeatedSteps(operators, charges, axioms)
            self.operators += self._repeating.operators
            self._owners += [repeated.operator for repeated in self._repeating.found]
            charges += self._repeating.charges
        self._charges = charges
        self.operators += free
        self._owners += [NO_OPERATOR] * len(free)
        needs = [tuple(indices(operator.preconditions)) for operator in self.operators]
        adds = [tuple(indices(operator.adds)) for operator in self.operators]
        users: list[list[int]] = [[] for _ in range(size)]
        for number, needed in enumerate(needs):
            for atom in needed:
                users[atom].append(number)
        self._costs = [*charges, *(rule.cost for rule in free)]
        self.size, self.space = size, PackedSpace(operators, size, axioms)
        self._rows = PackedRows(needs), PackedRows(adds), PackedRows(users)
        self._plans = self._towards(goals)

    def towards(self, goals: Bits) -> "StateEvaluation":
        """The same for other goals; the two share what is large."""
        fresh = copy.copy(self)
        fresh._plans = self._towards(goals)
        return fresh

    def _towards(self, goals: Bits) -> RelaxedPlans:
        return RelaxedPlans(self._costs, tuple(indices(goals)), *self._rows, self._plain)

    def __call__(self, state: bytes) -> tuple[int, list[int], list[int]]:
        """The cost of a relaxed plan from a packed state (-1 if there is none), the applicable and
        the preferred operators.

        An applicable operator is preferred if the relaxed plan begins with it.
        """
        if self._repeating is not None:
            self._plans.charge(
                self._first, self._repeating.of, self._repeating.costs(self.space.values(state))
            )
        estimate = self._plans.evaluate(state)
        if self._joint and estimate > 0:
            estimate = self._once()
        applicable, helpful = self._plans.applicable, self._plans.preferred
        if len(self.operators) > self._plain:
            helpful = self._owned(helpful)
        return estimate, applicable, helpful

    def _once(self) -> int:
        """The cost of the last relaxed plan where each given operator counts once, as dear as
        it is used at most.
        """
        dearest: dict[int, int] = {}
        for number in self._plans.relaxed:
            owner = self._owners[number]
            if owner != NO_OPERATOR:
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
        """Operators that the last relaxed plan repeats and that are applicable, each with the
        number of times, from 2 on.
        """
        if self._repeating is None:
            return []
        ready, last = set(self._plans.preferred), self._first + len(self._repeating.found)
        repeated = [
            number
            for number in self._plans.relaxed
            if number in ready and self._first <= number < last
        ]
        repetitions = (
            (self._owners[number], self._repeating.times(number - self._first))
            for number in repeated
        )
        return [jump for jump in dict.fromkeys(repetitions) if jump[1] > 1]

    def _owned(self, numbers: Sequence[int]) -> list[int]:
        """The given operators behind those of a relaxed plan."""
        owners = dict.fromkeys(self._owners[number] for number in numbers)
        owners.pop(NO_OPERATOR, None)
        return list(owners)
