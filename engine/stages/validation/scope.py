"""Places in one list of terms for the parameters, variables and constants of an operator's conditions."""

import operator as plain
from collections.abc import Callable, Iterable, Sequence

from cellwright.engine.stages.validation.sums import Slots, written
from cellwright.kb.terms import Atom, Function, Term, Variable, is_ground, variables

Made = Callable[[Slots], Atom]
Question = tuple[str, int, tuple[tuple[int, int], ...], tuple[tuple[int, int], ...]]
"""A predicate, the number of its arguments, those of them that are in places of the list, and pairs of equal ones."""


class Scope:
    """Places for parameters, constants and variables. Scopes inside one another share the list, not the names."""

    def __init__(self, parameters: Sequence[Variable]) -> None:
        self.parameters = tuple(parameters)
        self.places: dict[Term, int] = {each: place for place, each in enumerate(parameters)}
        self._more: list[Term | None] = []
        self._kept: dict[Question, int] = {}

    def inner(self) -> "Scope":
        """A scope that knows the parameters alone."""
        found = Scope(self.parameters)
        found._more, found._kept = self._more, self._kept
        return found

    def slots(self, values: Iterable[Term]) -> Slots:
        """The list for parameters with these values."""
        return [*values, *self._more]

    def bindings(self, slots: Slots) -> dict[Variable, Term]:
        """The values of the parameters by name."""
        return dict(zip(self.parameters, slots, strict=False))

    def place(self, term: Term) -> int:
        """The place of a term, which is new if it had none."""
        if term not in self.places:
            self.places[term] = len(self.parameters) + len(self._more)
            self._more.append(term)
        return self.places[term]

    def empty(self) -> int:
        """A place for something else than a term."""
        self._more.append(None)
        return len(self.parameters) + len(self._more) - 1

    def kept(self, question: Question) -> int | None:
        """The place of the facts that answer a question; None if that depends on more than parameters."""
        if any(place >= len(self.parameters) for _, place in question[2]):
            return None
        if question not in self._kept:
            self._kept[question] = self.empty()
        return self._kept[question]

    def knows(self, term: Term) -> bool:
        """Whether all variables of a term have places."""
        return all(each in self.places for each in variables(term))

    def atom(self, atom: Atom) -> Made:
        """The function that writes an atom."""
        if atom in self.places:
            return plain.itemgetter(self.places[atom])
        name, arguments = atom.name, atom.arguments
        if is_ground(atom):
            return lambda _: atom
        if all(is_ground(each) or (isinstance(each, Variable) and each in self.places) for each in arguments):
            picked = [self.place(each) for each in arguments]
            return lambda slots: Function(name, tuple([slots[each] for each in picked]))
        return written(atom, dict(self.places))  # type: ignore[return-value]
