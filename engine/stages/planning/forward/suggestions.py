"""Composites that are made during forward search.

They are instances of patterns whose steps are all in a state's relaxed plan. The relaxed plan shows which of
the many instances may help (Botea, Enzenberger, Müller & Schaeffer 2005). The other instances are never made.
"""

from collections.abc import Iterable, Sequence
from itertools import islice

from cellwright.engine.model.task import Bits, GroundOperator
from cellwright.engine.stages.planning.composites import Joins, Pattern, composed

MOST = 64  # the largest number of composites suggested for one state


class Suggestions:
    """The operators of a search, followed by every composite that was suggested so far."""

    def __init__(self, operators: Sequence[GroundOperator], patterns: Sequence[Pattern]) -> None:
        self.operators, self.patterns = list(operators), patterns
        self._plain = tuple(operators)
        self._joins = Joins(self._plain, patterns)
        self._numbers: dict[tuple[int, ...], int | None] = {}
        self._sources: list[tuple[int, tuple[int, ...]]] = []

    def suggested(self, state: Bits, beginning: Iterable[int], relaxed: Sequence[int]) -> list[int]:
        """The numbers of the composites that a relaxed plan from `state` suggests, the longest first.

        `relaxed` are the operators of the relaxed plan; `beginning` are its applicable operators.
        """
        found: list[int] = []
        for pattern, parts in islice(self._joins.sequences(beginning, relaxed), MOST):
            number = self._numbered(pattern, parts)
            if number is not None and not self.operators[number].preconditions & ~state:
                found.append(number)
        return sorted(dict.fromkeys(found), key=lambda number: -len(self._source(number)[1]))

    def parts(self, number: int) -> Sequence[int]:
        """The numbers of the plain operators that a number stands for."""
        return (number,) if number < len(self._plain) else self._source(number)[1]

    def unfolded(self, number: int) -> list[GroundOperator]:
        """The operators that a number stands for."""
        return [self._plain[part] for part in self.parts(number)]

    def pattern(self, number: int) -> Pattern | None:
        """The pattern that a composite is an instance of; None for an ordinary operator."""
        return None if number < len(self._plain) else self.patterns[self._source(number)[0]]

    def _source(self, number: int) -> tuple[int, tuple[int, ...]]:
        return self._sources[number - len(self._plain)]

    def _numbered(self, pattern: int, parts: tuple[int, ...]) -> int | None:
        if parts not in self._numbers:
            operator = composed([self._plain[part] for part in parts])
            self._numbers[parts] = None if operator is None else len(self.operators)
            if operator is not None:
                self.operators.append(operator)
                self._sources.append((pattern, parts))
        return self._numbers[parts]
