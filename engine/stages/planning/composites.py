"""Composite operators: instances of learned sequences of steps, used beside ordinary operators.

A sequence is given as operators with variables (macro-operators: Fikes, Hart & Nilsson 1972; Korf
1985). The preconditions and effects of an instance are computed from its parts, so they are right
no matter how the sequence was learned. All ordinary operators stay. So a search that is complete
without composites is complete with them.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

from cellwright.engine.model.ground_task import GroundOperator
from cellwright.kb.terms import Function, Term, Variable, match_term, term_variables

Pattern = tuple[Function, ...]
"""Steps in order of execution. Each is an operator with arguments; steps may share variables."""
COMPOSITE_INSTANCE = Function("_composite")


@dataclass(frozen=True, slots=True)
class Macros:
    """The patterns that each kind of search uses."""

    backward: tuple[Pattern, ...] = ()
    forward: tuple[Pattern, ...] = ()


NO_MACROS = Macros()


@dataclass(frozen=True, slots=True)
class Composite:
    """A sequence of ground operators as one operator, and the pattern that it is an instance of."""

    operator: GroundOperator
    parts: tuple[GroundOperator, ...]
    pattern: Pattern


def compose_operators(parts: Sequence[GroundOperator]) -> GroundOperator | None:
    """One operator that does what the unconditional operators `parts` do one after another.

    None if a part deletes what a later part needs, or if the sequence adds nothing new. Atoms that
    the sequence needs and keeps are not among its adds.
    """
    needed = added = deleted = cost = 0
    for part in parts:
        if part.preconditions & deleted:
            return None
        needed |= part.preconditions & ~added
        ended = part.deletes & ~part.adds
        added, deleted = added & ~ended | part.adds, deleted & ~part.adds | ended
        cost += part.cost
    added &= ~needed
    return GroundOperator(COMPOSITE_INSTANCE, needed, added, deleted, cost=cost) if added else None


Bound = dict[str, int]
"""For the name of each variable the number of the term that it stands for."""


class PatternJoins:
    """Finds sequences of ground operators that are instances of patterns. Operators are given by
    number.

    A sequence is built step by step: the next operator must agree with the earlier ones on shared
    variables. An operator is matched with a step only once, and the bindings are kept. Terms are
    numbered, so that only small numbers are compared. Operators with conditional effects are never
    part of a sequence.
    """

    def __init__(self, operators: Sequence[GroundOperator], patterns: Sequence[Pattern]) -> None:
        self.operators, self.patterns = operators, patterns
        self._names = [operator.instance.name for operator in operators]
        self._shared = [list(_shared_variables(pattern)) for pattern in patterns]
        self._terms: dict[Term, int] = {}
        self._bindings: list[list[dict[int, Bound | None]]] = [
            [{} for _ in pattern] for pattern in patterns
        ]
        self._keys: list[list[dict[int, tuple[int, ...]]]] = [
            [{} for _ in pattern] for pattern in patterns
        ]
        self._beginning: dict[str, list[int]] = {}
        for number, pattern in enumerate(patterns):
            self._beginning.setdefault(pattern[0].name, []).append(number)

    def sequences(
        self, first: Iterable[int], later_operators: Sequence[int]
    ) -> Iterator[tuple[int, tuple[int, ...]]]:
        """The instances of all patterns, each as the number of its pattern and the numbers of its
        operators.

        The first operator is one of `first`, the following ones are from `others`.
        """
        tables: dict[tuple[int, int], dict[tuple[int, ...], list[int]]] = {}
        for number in first:
            for pattern in self._beginning.get(self._names[number], ()):
                bound = self._bound(pattern, 0, number)
                if bound is not None:
                    for sequence in self._rest(pattern, (number,), bound, later_operators, tables):
                        yield pattern, sequence

    def _rest(
        self,
        pattern: int,
        begun: tuple[int, ...],
        bindings: Bound,
        later_operators: Sequence[int],
        tables: dict[tuple[int, int], dict[tuple[int, ...], list[int]]],
    ) -> Iterator[tuple[int, ...]]:
        place = len(begun)
        if place == len(self.patterns[pattern]):
            yield begun
            return
        if (pattern, place) not in tables:
            tables[pattern, place] = self._table(pattern, place, later_operators)
        key = tuple([bindings[name] for name in self._shared[pattern][place]])
        for number in tables[pattern, place].get(key, ()):
            more = self._bound(pattern, place, number)
            if number not in begun and more is not None:
                yield from self._rest(
                    pattern, (*begun, number), {**bindings, **more}, later_operators, tables
                )

    def _table(
        self, pattern: int, place: int, later_operators: Sequence[int]
    ) -> dict[tuple[int, ...], list[int]]:
        """The operators that can be this step of a pattern, by the values that earlier steps
        bind.
        """
        table: dict[tuple[int, ...], list[int]] = {}
        names, name = self._names, self.patterns[pattern][place].name
        keys, shared = self._keys[pattern][place], self._shared[pattern][place]
        for number in later_operators:
            if names[number] != name:
                continue
            key = keys.get(number)
            if key is None:
                bound = self._bound(pattern, place, number)
                if bound is None:
                    continue
                key = keys[number] = tuple([bound[name] for name in shared])
            table.setdefault(key, []).append(number)
        return table

    def _bound(self, pattern: int, place: int, number: int) -> Bound | None:
        known_bindings = self._bindings[pattern][place]
        if number not in known_bindings:
            operator, terms = self.operators[number], self._terms
            match_bindings = (
                None
                if operator.conditional
                else _match_step(self.patterns[pattern][place], operator.instance)
            )
            known_bindings[number] = (
                None
                if match_bindings is None
                else {
                    variable.name: terms.setdefault(term, len(terms))
                    for variable, term in match_bindings.items()
                }
            )
        return known_bindings[number]


def _match_step(step: Function, instance: Function) -> dict[Variable, Term] | None:
    """The result of `match` without earlier bindings.

    If all arguments are different variables, there is no need to call `match`.
    """
    plain = [argument for argument in step.arguments if isinstance(argument, Variable)]
    if len(set(plain)) == len(step.arguments) == len(instance.arguments):
        return dict(zip(plain, instance.arguments, strict=True))
    return match_term(step, instance, {})


def _shared_variables(pattern: Pattern) -> Iterator[tuple[str, ...]]:
    """For each step the names of its variables that earlier steps bind."""
    bound: set[Variable] = set()
    for step in pattern:
        own = dict.fromkeys(term_variables(step))
        yield tuple(variable.name for variable in own if variable in bound)
        bound.update(own)


def find_composites(
    operators: Sequence[GroundOperator], patterns: Sequence[Pattern], most: int
) -> list[Composite]:
    """The instances of patterns among operators.

    There are at most `most` of them, and at most as many as there are operators: with more, a
    search would lose more time than it saves. A pattern whose instances would exceed this limit is
    left out as a whole, and so are all patterns after it.
    """
    composites_found: list[Composite] = []
    most = min(most, len(operators))
    everything = range(len(operators))
    for pattern in patterns:
        instances = PatternJoins(operators, [pattern]).sequences(everything, everything)
        own = [numbers for _, numbers in islice(instances, most + 1)]
        most -= len(own)
        if most < 0:
            break
        composites_found += _compose_sequences(
            [tuple(operators[number] for number in numbers) for numbers in own], pattern
        )
    return composites_found


def _compose_sequences(
    sequences: Iterable[tuple[GroundOperator, ...]], pattern: Pattern
) -> Iterator[Composite]:
    for parts in sequences:
        operator = compose_operators(parts)
        if operator is not None:
            yield Composite(operator, parts, pattern)
