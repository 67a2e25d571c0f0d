"""A lower bound of the steps to goals about quantities: a linear program over how often each
operator is done.

A form is a sum of quantities without a constant. What it is now, and what all operators add to it,
must be within what the goals ask of it. A form that an operator uses up stays within what the
preconditions of all operators that use it up leave of it. The order of operators, and what else
they need, is not looked at: so the sum of the counts is a lower bound of the steps (the state
equation: Piacentini, Castellano, Bacchus, Beck, Fox & Long 2018).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from ortools.linear_solver import pywraplp

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_axioms import (
    OPPOSITE_SIGNS,
    Axioms,
    Comparing,
    Linear,
    QuantityLevel,
)
from cellwright.engine.model.ground_task import GroundOperator

Form = tuple[tuple[QuantityLevel, int], ...]
ALMOST = 1e-6  # a count that is this much below a whole number counts as the number


class Bounds(NamedTuple):
    """The values from `low` to `high`."""

    low: float = -math.inf
    high: float = math.inf

    def within(self, other: "Bounds") -> "Bounds":
        """What both have."""
        return Bounds(max(self.low, other.low), min(self.high, other.high))


class Counts(NamedTuple):
    """How often operators are done, by their numbers, and the sum of it."""

    total: float
    times: Mapping[int, float]


class Balances:
    """The forms about which goals ask, or that count for operators that change these, in a state
    with any values.

    `covered` are the atoms of goals and preconditions for which the program stands. `operators` are
    those that it counts.
    """

    def __init__(self, operators: Sequence[GroundOperator], goals: Bits, axioms: Axioms) -> None:
        self._tests = _Tests(axioms)
        self._given = operators
        self._changed = [_changed_levels(each) for each in operators]
        self.covered: Bits = 0
        self._wanted: dict[Form, Bounds] = {}
        self._kept: dict[Form, Bounds] = {}
        self._gains: dict[Form, dict[int, int]] = {}
        for atom in indices(goals):
            self._want(atom)
        self.operators = sorted(self._used_up())
        self._program = _Program(self.operators, [(form, self._gains[form]) for form in self._rows])

    @property
    def _rows(self) -> list[Form]:
        return list(dict.fromkeys([*self._wanted, *self._kept]))

    def _want(self, atom: int) -> None:
        """Note what a goal asks of a form, if operators change the form by fixed amounts."""
        asked = self._tests.asked(atom)
        if asked is None or self._gains_of(asked[0]) is None:
            return
        form, values = asked
        self._wanted[form] = self._wanted.get(form, Bounds()).within(values)
        self.covered |= 1 << atom

    def _gains_of(self, form: Form) -> dict[int, int] | None:
        """What each operator adds to a form; None if it is not fixed for one of them."""
        if form not in self._gains:
            levels = {level for level, _ in form}
            gains: dict[int, int] = {}
            for number, operator in enumerate(self._given):
                if levels & self._changed[number]:
                    gain = _gain(operator, form)
                    if gain is None:
                        return None
                    if gain:
                        gains[number] = gain
            self._gains[form] = gains
        return self._gains[form]

    def _used_up(self) -> set[int]:
        """The operators that change forms of the goals, or what these use up, and so on; what
        is used up stays within its range.
        """
        found: set[int] = set()
        waiting = list(self._wanted)
        seen = set(waiting)
        while waiting:
            form = waiting.pop()
            gains = self._gains[form]
            self._keep(form, gains)
            for number in gains.keys() - found:
                found.add(number)
                for _, other, _ in self._needs(number):
                    more = self._gains_of(other)
                    if other not in seen and more and number in more:
                        seen.add(other)
                        waiting.append(other)
        return found

    def _needs(self, number: int) -> Iterator[tuple[int, Form, Bounds]]:
        for atom in indices(self._given[number].preconditions):
            if (asked := self._tests.asked(atom)) is not None:
                yield atom, *asked

    def _keep(self, form: Form, gains: Mapping[int, int]) -> None:
        """Note the range that no operator leaves, if each that could is kept from it by its
        preconditions.
        """
        low, high = math.inf, -math.inf
        for number, gain in gains.items():
            before = Bounds()
            for atom, other, values in self._needs(number):
                if other == form:
                    before = before.within(values)
                    self.covered |= 1 << atom
            low = min(low, before.low + gain) if gain < 0 else low
            high = max(high, before.high + gain) if gain > 0 else high
        self._kept[form] = Bounds(low, high)

    def counts(self, values: "memoryview[int]") -> Counts | None:
        """The fewest operators that add up, where quantities have these values; None if there
        are none.
        """
        ranges = []
        for form in self._rows:
            now = sum(factor * values[level.number] for level, factor in form)
            kept, wanted = self._kept[form], self._wanted.get(form, Bounds())
            low, high = (
                max(min(kept.low, now), wanted.low) - now,
                min(max(kept.high, now), wanted.high) - now,
            )
            if low > high:
                return None
            ranges.append(Bounds(low, high))
        return self._program.least(ranges)


class _Tests:
    """What the atoms of comparisons ask of forms."""

    def __init__(self, axioms: Axioms) -> None:
        self._known: dict[int, tuple[Form, Bounds]] = {}
        for test in axioms.tests:
            self._note(test, test.atom, test.relation)
            if test.atom in axioms.complements:
                self._note(test, axioms.complements[test.atom], OPPOSITE_SIGNS[test.relation])

    def _note(self, test: Comparing, atom: int, relation: str) -> None:
        if test.sum.parts and relation != "!=":
            self._known[atom] = _asked_bounds(test.sum, relation)

    def asked(self, atom: int) -> tuple[Form, Bounds] | None:
        """The form that an atom is about, and the values that make it true; None for any other
        atom.
        """
        return self._known.get(atom)


def _asked_bounds(total: Linear, relation: str) -> tuple[Form, Bounds]:
    """The form of a sum, and its values for which the sum compares with 0 as a relation says."""
    parts = sorted(total.parts, key=lambda part: part[0].number)
    common = math.gcd(*(factor for _, factor in parts))
    common = common if parts[0][1] > 0 else -common
    form = tuple((level, factor // common) for level, factor in parts)
    if common < 0:
        relation = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}.get(relation, relation)
    below, above = -total.constant // common, -(total.constant // common)  # rounded down, and up
    match relation:
        case ">":
            return form, Bounds(low=below + 1)
        case ">=":
            return form, Bounds(low=above)
        case "<":
            return form, Bounds(high=above - 1)
        case "<=":
            return form, Bounds(high=below)
        case _:
            return form, Bounds(above, below)


def _changed_levels(operator: GroundOperator) -> frozenset[QuantityLevel]:
    return frozenset(change.level for change in operator.changes)


def _gain(operator: GroundOperator, form: Form) -> int | None:
    """What an operator adds to a form; None if that depends on the state."""
    factors, gain = dict(form), Linear((), 0)
    for change in operator.changes:
        if factor := factors.get(change.level, 0):
            gain = gain.plus(change.to.without(change.level), factor)
    return None if gain.parts else gain.constant


class _Program:
    """The least sum of counts so that each row is within its range.

    Solutions of one state are the start for the next one.
    """

    def __init__(
        self, operators: Sequence[int], rows: Sequence[tuple[Form, Mapping[int, int]]]
    ) -> None:
        self._solver = pywraplp.Solver.CreateSolver("GLOP")
        self._counts = {number: self._solver.NumVar(0, math.inf, "") for number in operators}
        self._rows = []
        for _, gains in rows:
            row = self._solver.Constraint(-math.inf, math.inf)
            for number, gain in gains.items():
                row.SetCoefficient(self._counts[number], gain)
            self._rows.append(row)
        for count in self._counts.values():
            self._solver.Objective().SetCoefficient(count, 1)
        self._solver.Objective().SetMinimization()

    def least(self, ranges: Sequence[Bounds]) -> Counts | None:
        """The counts; None if there are none."""
        for row, (low, high) in zip(self._rows, ranges, strict=True):
            row.SetBounds(low, high)
        if self._solver.Solve() != pywraplp.Solver.OPTIMAL:
            return None
        times = {
            number: value
            for number, count in self._counts.items()
            if (value := count.solution_value()) > ALMOST
        }
        return Counts(self._solver.Objective().Value(), times)
