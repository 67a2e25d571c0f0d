"""Changes of quantities in relaxed plans: a step is repeated until a comparison holds.

For each comparison and each operator that leads towards it there is an operator whose cost depends on the state: as many steps as
the comparison is away from being true (the subgoaling relaxation of Scala, Haslum, Thiebaux & Ramirez 2020).
"""

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import accumulate
from typing import NamedTuple

from cellwright.engine.kernels.sums import Repetitions
from cellwright.engine.model.axioms import Axioms
from cellwright.engine.model.quantities import OPPOSITE, RELATIONS, Comparing, Level, Linear
from cellwright.engine.model.task import GroundOperator
from cellwright.engine.stages.planning.forward.kernels import Longs
from cellwright.engine.stages.planning.forward.transitions import Distance


class Kind(NamedTuple):
    """Something adds `gain` to the sum of a comparison until it relates as wanted; then `atom` is true."""

    test: int
    atom: int
    relation: str
    gain: int


class Repeated(NamedTuple):
    """An operator, by its number, and what repeating it does."""

    operator: int
    kind: Kind


class Repeating:
    """The operators for relaxed plans that stand for repeated steps, and what they cost in a state."""

    def __init__(self, operators: Sequence[GroundOperator], charges: Sequence[int], axioms: Axioms) -> None:
        self.found = list(_repeated(operators, axioms))
        self.operators = [
            replace(operators[each.operator], adds=1 << each.kind.atom, conditional=(), changes=())
            for each in self.found
        ]
        self.charges = [charges[each.operator] for each in self.found]
        own = [(each.kind, charge) for each, charge in zip(self.found, self.charges, strict=True)]
        different = {key: place for place, key in enumerate(dict.fromkeys(own))}
        self.of = array("i", [different[key] for key in own])
        self._times = _repetitions([k for k, _ in different], [charge for _, charge in different], axioms)

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


def _repetitions(found: Sequence[Kind], charges: Sequence[int], axioms: Axioms) -> Repetitions:
    return Repetitions(
        axioms.comparisons,
        [each.test for each in found],
        [RELATIONS.index(each.relation) for each in found],
        [each.gain for each in found],
        charges,
    )


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
            yield Repeated(operator, Kind(test, atom, relation, gain))


def distance(
    operators: Sequence[GroundOperator], goals: Sequence[int], axioms: Axioms | None, width: int
) -> Distance:
    """How far packed states are from goals, with `width` bytes of atoms."""
    if axioms is None or not axioms.tests:
        return Distance(width, goals, None, [0] * (len(goals) + 1))
    kinds = dict.fromkeys(each.kind for each in _repeated(operators, axioms))
    groups = [[each for each in kinds if each.atom == goal] for goal in goals]
    ordered = [each for group in groups for each in group]
    starts = [0, *accumulate(map(len, groups))]
    return Distance(width, goals, _repetitions(ordered, [1] * len(ordered), axioms), starts)
