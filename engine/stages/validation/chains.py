"""Conditions of rules as a chain of functions: each looks rows of numbers up in tables and calls the next one for all that match.

Variables and constants have places in one list of numbers. The checker's own, like the rest of its Datalog.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import count
from typing import NamedTuple

from cellwright.engine.stages.validation.datalog import solve
from cellwright.engine.stages.validation.ordering import binds
from cellwright.engine.stages.validation.tables import Row, Table, Tables, picked
from cellwright.kb.model.conditions import BodyPart, Literal
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Term,
    Variable,
    is_ground,
    match,
    substitute,
    variables,
)

Slots = list[int]
Next = Callable[[Slots], None]
Link = Callable[[Next], Next]
Values = Callable[[dict[Variable, Term]], Iterator[Sequence[Term]]]
Pairs = list[tuple[int, int]]


class Layout(NamedTuple):
    """Pairs of a place in a row and a place in the list: what is known before, what becomes known, and what that has to equal."""

    known: Pairs
    new: Pairs
    same: Pairs


class Chain:
    """Conditions in the order in which they are added."""

    def __init__(self, tables: Tables) -> None:
        self.tables = tables
        self.start: Slots = []  # what is in the places at first
        self._places: dict[
            Term, int
        ] = {}  # of constants, and of variables that have values when all links are met
        self._links: list[Link] = []
        self._names = (Variable(f"_{number}") for number in count())

    def to(self, last: Next) -> Next:
        """A function that meets all conditions, and does the last thing for each way to do so."""
        for link in reversed(self._links):
            last = link(last)
        return last

    def first(self, atom: Atom) -> Callable[[Row, Slots], bool]:
        """A function that writes a row to the places, and tells whether it may match an atom. The chain goes on from there."""
        simple, inside = self._simplified(atom)
        known, new, same = self._layout(simple)
        self._take_apart(inside)

        def write(row: Row, slots: Slots) -> bool:
            for at, place in new:
                slots[place] = row[at]
            return all(row[at] == slots[place] for at, place in (*known, *same))

        return write

    def meet(self, part: BodyPart) -> None:
        """Meet a literal or a comparison. What is no positive literal is decided by facts that never change."""
        if isinstance(part, Literal) and part.positive:
            simple, inside = self._simplified(part.atom)
            table = self.tables.table(part.atom.name, len(simple))
            self._links.append(_looked_up(table, self._layout(simple)))
            self._take_apart(inside)
        else:
            new = [each for each in dict.fromkeys(binds(part)) if each not in self._places]

            def values(bindings: dict[Variable, Term]) -> Iterator[Sequence[Term]]:
                for found in solve((part,), self.tables.statics, bindings):
                    yield [found[each] for each in new]

            self._compute([each for each in _within(part) if each in self._places], new, values)

    def row(self, atom: Atom) -> Callable[[Slots], Row]:
        """The function that gives the arguments of an atom whose variables have values."""
        simple, _ = self._simplified(atom)
        return picked([place for _, place in self._layout(simple).known])

    def values(self, atom: Atom) -> Callable[[Slots], dict[Variable, Term]]:
        """The function that gives the values of those variables of an atom that have any."""
        places = {each: self._places[each] for each in variables(atom) if each in self._places}
        terms = self.tables.terms
        return lambda slots: {variable: terms[slots[place]] for variable, place in places.items()}

    def _simplified(self, atom: Atom) -> tuple[list[Term], list[tuple[Variable, Term]]]:
        """An atom's arguments with variables in place of compound terms, and those of which parts are unknown yet."""
        simple: list[Term] = []
        inside: list[tuple[Variable, Term]] = []
        for each in atom.arguments:
            if each != ANYTHING and (isinstance(each, Variable) or is_ground(each)):
                simple.append(each)
                continue
            simple.append(name := next(self._names))
            if all(part in self._places for part in variables(each)):
                self._put_together(name, each)
            elif isinstance(each, Function):
                inside.append((name, each))
        return simple, inside

    def _put_together(self, name: Variable, pattern: Term) -> None:
        self._compute(list(variables(pattern)), [name], lambda known: iter([[substitute(pattern, known)]]))

    def _take_apart(self, inside: Sequence[tuple[Variable, Term]]) -> None:
        """Match the values of some variables with patterns."""
        for name, pattern in inside:
            named = [each for each in dict.fromkeys(variables(pattern)) if each != ANYTHING]
            new = [each for each in named if each not in self._places]

            def values(
                known: dict[Variable, Term],
                name: Variable = name,
                pattern: Term = pattern,
                new: Sequence[Variable] = new,
            ) -> Iterator[Sequence[Term]]:
                found = match(pattern, known[name], known)
                if found is not None:
                    yield [found[each] for each in new]

            self._compute([name, *(each for each in named if each in self._places)], new, values)

    def _layout(self, simple: Sequence[Term]) -> Layout:
        """The places of simple arguments; from now on all have values."""
        found, before = Layout([], [], []), set(self._places)
        for at, each in enumerate(simple):
            if each in self._places:
                (found.known if each in before else found.same).append((at, self._places[each]))
            else:
                constant = not isinstance(each, Variable)
                self._places[each] = len(self.start)
                self.start.append(self.tables.term(each) if constant else -1)
                (found.known if constant else found.new).append((at, self._places[each]))
                if constant:
                    before.add(each)
        return found

    def _compute(self, given: Sequence[Variable], new: Sequence[Variable], values: Values) -> None:
        """Go on with all values that some variables can have. Given ones alone decide that, so it is remembered."""
        terms, number = self.tables.terms, self.tables.term
        given = list(dict.fromkeys(given))
        key = picked([self._places[each] for each in given])
        places = [place for _, place in self._layout(new).new]

        def found(row: Row) -> list[Pairs]:
            bindings = {variable: terms[each] for variable, each in zip(given, row, strict=True)}
            return [list(zip(places, map(number, each), strict=True)) for each in values(bindings)]

        self._links.append(_remembered(key, found))


def _within(part: BodyPart) -> Iterator[Variable]:
    """The variables of a literal or a comparison."""
    terms = (part.atom,) if isinstance(part, Literal) else (part.left, part.right)  # type: ignore[union-attr]
    return (each for term in terms for each in variables(term))


def _looked_up(table: Table, layout: Layout) -> Link:
    known, new, same = layout
    if not new:
        return _tested(table, picked([place for _, place in known]))
    key = picked([place for _, place in known])
    index = table.index(tuple([at for at, _ in known]))

    def link(then: Next) -> Next:
        def step(slots: Slots) -> None:
            for row in index.get(key(slots), ()):
                for at, place in new:
                    slots[place] = row[at]
                if not same or all(row[at] == slots[place] for at, place in same):
                    then(slots)

        return step

    return link


def _tested(table: Table, key: Callable[[Slots], Row]) -> Link:
    has = table.has

    def link(then: Next) -> Next:
        def step(slots: Slots) -> None:
            if has(key(slots)):
                then(slots)

        return step

    return link


def _remembered(key: Callable[[Slots], Row], values: Callable[[Row], list[Pairs]]) -> Link:
    known: dict[Row, list[Pairs]] = {}

    def link(then: Next) -> Next:
        def step(slots: Slots) -> None:
            row = key(slots)
            found = known.get(row)
            if found is None:
                found = known[row] = values(row)
            for each in found:
                for place, value in each:
                    slots[place] = value
                then(slots)

        return step

    return link
