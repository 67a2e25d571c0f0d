"""Which arguments of facts hold numbers of one kind, so that microlitres are not compared with
shelf numbers.

Places share a kind if some rule or operator has one variable in both, or compares the two. A place
is an argument of a predicate, of a function or of a quantity.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import NamedTuple

from cellwright.engine.pipelines.explanation.amendments import terms_within
from cellwright.engine.pipelines.explanation.parts_of_values import values
from cellwright.kb.asp.rule_compiler import read_body
from cellwright.kb.model.conditions import Comparison
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.terms import ANYTHING, Atom, Function, Number, Operation, Term, Variable


class Place(NamedTuple):
    """An argument of all terms with one name."""

    name: str
    number: int


class NumberKinds:
    """The kinds of numbers in a domain."""

    def __init__(self, domain: Domain) -> None:
        self.domain = domain
        self._parent: dict[Place, Place] = {}
        for scope in self._scopes():
            self._join(scope)

    def alike(self, place: Place) -> frozenset[Place]:
        """The places that hold numbers of the same kind, this one included."""
        return frozenset(self._kinds[self._root(place)]) | {place}

    @cached_property
    def _kinds(self) -> dict[Place, list[Place]]:
        kinds: dict[Place, list[Place]] = defaultdict(list)
        for each in list(self._parent):
            kinds[self._root(each)].append(each)
        return kinds

    def _scopes(self) -> Iterator[tuple[object, ...]]:
        """What has variables of its own: an operator, a rule, a statement."""
        domain = self.domain
        yield from ((each,) for each in (*domain.operators, *domain.rules, *domain.defaults))
        for deductive in domain.deductive_operators:
            for consequence in deductive.consequences:
                yield deductive.trigger, deductive.body, consequence
        for statement in domain.asp:
            read = [read_body(text) for text in (statement.head, ", ".join(statement.body)) if text]
            yield tuple(part for each in read for part in (*each.literals, *each.comparisons))

    def _join(self, scope: Iterable[object]) -> None:
        places: dict[Variable, list[Place]] = defaultdict(list)
        compared: list[Comparison] = []
        for part in (value for whole in scope for value in values(whole)):
            if isinstance(part, Function):
                for number, argument in enumerate(part.arguments):
                    if isinstance(argument, Variable) and argument != ANYTHING:
                        places[argument].append(Place(part.name, number))
            if isinstance(part, Comparison):
                compared.append(part)
        for group in places.values():
            self._unite(group)
        for each in compared:
            sides = [self._measured(each.left, places), self._measured(each.right, places)]
            self._unite([place for side in sides for place in side] if all(sides) else [])

    def _measured(self, term: Term, places: dict[Variable, list[Place]]) -> list[Place]:
        """The places of what a side of a comparison is, up to a number that is added."""
        match term:
            case Variable():
                return places.get(term, [])
            case Function(name, arguments) if name in self.domain.quantities:
                return [Place(name, len(arguments))]
            case Operation("+" | "-", inner, Number()) | Operation("+", Number(), inner):
                return self._measured(inner, places)
            case _:
                return []

    def _root(self, place: Place) -> Place:
        while (parent := self._parent.setdefault(place, place)) != place:
            place = parent
        return place

    def _unite(self, places: list[Place]) -> None:
        for each in places:
            self._parent[self._root(each)] = self._root(places[0])


def numbers_in(atom: Atom) -> Iterator[tuple[Place, int]]:
    """The numbers in an atom and in the terms inside it, with their places."""
    for term in terms_within(atom):
        if isinstance(term, Function):
            for number, argument in enumerate(term.arguments):
                if isinstance(argument, Number):
                    yield Place(term.name, number), argument.value
