"""Changes of quantities in relaxed plans: a step is repeated until a comparison holds.

For each comparison and each operator that leads towards it there is an operator whose cost depends on the state: as many steps as
the comparison is away from being true (the subgoaling relaxation of Scala, Haslum, Thiebaux & Ramirez 2020).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from engine.kernels.sums import Repetitions
from engine.model.axioms import Axioms
from engine.model.quantities import OPPOSITE, RELATIONS, Comparing, Level, Linear
from engine.model.task import GroundOperator
from engine.stages.planning.forward.kernels import Longs


class Repeated(NamedTuple):
    """An operator, by its number, that adds `gain` to the sum of a comparison, until it `relates`; then `atom` is true."""

    operator: int
    test: int
    atom: int
    relation: str
    gain: int


class Repeating:
    """The operators for relaxed plans that stand for repeated steps, and what they cost in a state."""

    def __init__(self, operators: Sequence[GroundOperator], charges: Sequence[int], axioms: Axioms) -> None:
        self._axioms = axioms
        self.found = list(_repeated(operators, axioms))
        self.operators = [
            replace(operators[each.operator], adds=1 << each.atom, conditional=(), changes=())
            for each in self.found
        ]
        self.charges = [charges[each.operator] for each in self.found]
        self._times = Repetitions(
            axioms.comparisons,
            [each.test for each in self.found],
            [RELATIONS.index(each.relation) for each in self.found],
            [each.gain for each in self.found],
            self.charges,
        )

    def costs(self, state: int) -> Longs:
        """What the operators cost in a state."""
        self._costs = self._times.needed(self._axioms.values(state))
        return self._costs

    def times(self, number: int) -> int:
        """How often an operator is repeated in the state that was looked at last."""
        return self._costs[number] // self.charges[number]


def _repeated(operators: Sequence[GroundOperator], axioms: Axioms) -> Iterator[Repeated]:
    by_level: dict[Level, list[int]] = {}
    for place, each in enumerate(axioms.tests):
        for level, _ in each.sum.parts:
            by_level.setdefault(level, []).append(place)
    for number, operator in enumerate(operators):
        for test in dict.fromkeys(
            test for change in operator.changes for test in by_level.get(change.level, ())
        ):
            gain = _gain(operator, axioms.tests[test])
            if gain is not None:
                yield from _towards(number, test, gain, axioms)


def _gain(operator: GroundOperator, test: Comparing) -> int | None:
    """What an operator adds to the sum of a comparison: None if nothing, 0 if it depends on the state."""
    factors = dict(test.sum.parts)
    gain = Linear((), 0)
    for change in operator.changes:
        if factor := factors.get(change.level, 0):
            gain = gain.plus(change.to.without(change.level), factor)
    if gain.parts:
        return 0
    return gain.constant or None


def _towards(operator: int, test: int, gain: int, axioms: Axioms) -> Iterator[Repeated]:
    """The comparison and its opposite, as far as the gain leads towards them."""
    compared = axioms.tests[test]
    pairs = [(compared.atom, compared.relation)]
    if compared.atom in axioms.complements:
        pairs.append((axioms.complements[compared.atom], OPPOSITE[compared.relation]))
    for atom, relation in pairs:
        if gain == 0 or relation in ("=", "!=") or (gain > 0) == (relation in (">", ">=")):
            yield Repeated(operator, test, atom, relation, gain)
