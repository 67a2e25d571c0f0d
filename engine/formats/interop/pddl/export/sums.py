"""Quantities of a ground task as numeric fluents of PDDL 2.1 (Fox & Long 2003): one function without arguments for each."""

from collections.abc import Iterator, Sequence

from cellwright.engine.formats.interop.pddl.export.names import PddlNames
from cellwright.engine.model.quantities import OPPOSITE, Assignment, Comparing, Level, Linear
from cellwright.engine.model.task import Bits, Task, bitset


class Sums:
    """The quantities of a task that are compared or changed, and how they are written."""

    def __init__(self, task: Task, names: PddlNames) -> None:
        self._task, self._names = task, names
        self._tests = task.axioms.tests if task.axioms else ()
        self._compared: dict[int, tuple[Comparing, str]] = {}
        for each in self._tests:
            self._compared[each.atom] = (each, each.relation)
            if task.axioms and (other := task.axioms.complements.get(each.atom)) is not None:
                self._compared[other] = (each, OPPOSITE[each.relation])
        self.levels = tuple(dict.fromkeys(self._met()))

    def _met(self) -> Iterator[Level]:
        for test in self._tests:
            yield from (level for level, _ in test.sum.parts)
        for operator in self._task.operators:
            for change in operator.changes:
                yield change.level
                yield from (level for level, _ in change.to.parts)

    @property
    def hidden(self) -> Bits:
        """The atoms that are no predicates of the export: comparisons, and values."""
        values = self.levels[0].met if self.levels else ()
        return bitset([*self._compared, *values])

    @property
    def functions(self) -> list[str]:
        """The functions, as they are declared."""
        return [self._function(level) for level in self.levels]

    @property
    def values(self) -> list[str]:
        """What the functions are at the start."""
        return [f"(= {self._function(level)} {level.of(self._task.initial)})" for level in self.levels]

    def comparison(self, atom: int) -> str | None:
        """The condition for an atom that compares quantities; None for any other atom."""
        if atom not in self._compared:
            return None
        test, relation = self._compared[atom]
        left, right = self._written(Linear(test.sum.parts, 0)), -test.sum.constant
        return f"(not (= {left} {right}))" if relation == "!=" else f"({relation} {left} {right})"

    def effects(self, changes: Sequence[Assignment]) -> list[str]:
        """What a step does to quantities."""
        return [written for each in changes if (written := self._effect(each))]

    def _effect(self, change: Assignment) -> str:
        name, rest = self._function(change.level), change.to.without(change.level)
        if change.level in dict(rest.parts):
            return f"(assign {name} {self._written(change.to)})"
        if not rest.parts:
            verb = "increase" if rest.constant > 0 else "decrease"
            return f"({verb} {name} {abs(rest.constant)})" if rest.constant else ""
        return f"(increase {name} {self._written(rest)})"

    def _written(self, sum_: Linear) -> str:
        terms = [self._product(level, factor) for level, factor in sum_.parts]
        terms += [str(sum_.constant)] if sum_.constant or not terms else []
        found = terms[0]
        for each in terms[1:]:
            found = f"(+ {found} {each})"
        return found

    def _product(self, level: Level, factor: int) -> str:
        return self._function(level) if factor == 1 else f"(* {factor} {self._function(level)})"

    def _function(self, level: Level) -> str:
        return f"({self._names.of('function', str(level.quantity))})"
