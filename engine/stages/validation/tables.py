"""Ground atoms as rows of numbers, one for each term, in which compiled joins look them up.

The checker's own, like the rest of its Datalog.
"""

from collections.abc import Callable, Collection, Sequence
from operator import itemgetter

from cellwright.engine.stages.validation.facts import Facts
from cellwright.kb.terms import Atom, Function, Term

Row = tuple[int, ...]
Places = Sequence[int]


def picked(places: Places) -> Callable[[Sequence[int]], Row]:
    """The function that gives the numbers in some places, as a row."""
    if not places:
        return lambda _numbers: ()
    if len(places) == 1:
        (place,) = places
        return lambda numbers: (numbers[place],)
    return itemgetter(*places)


class _Asked(dict[Row, bool]):
    """Whether rows are among the facts that never change; each is asked for once."""

    def __init__(self, holds: Callable[[Row], bool]) -> None:
        super().__init__()
        self._holds = holds

    def __missing__(self, row: Row) -> bool:
        found = self[row] = self._holds(row)
        return found


class Table:
    """The rows of a predicate with so many arguments.

    Those of a predicate that can change are entered one by one. Else they are the facts that never change, all of which are read
    when some are looked up, and few when single ones are tested.
    """

    def __init__(self, name: str, arity: int, tables: "Tables") -> None:
        self.name, self.arity, self.changes = name, arity, name in tables.dynamic
        self.numbers: dict[Row, int] = {}  # the number of the atom of each row that has been entered
        self._tables = tables
        self._asked = _Asked(lambda row: tables.atom_of(name, row) in tables.statics)
        self._indexes: dict[tuple[int, ...], dict[Row, list[Row]]] = {}

    @property
    def has(self) -> Callable[[Row], bool]:
        """The function that tells whether a row is there."""
        return self.numbers.__contains__ if self.changes else self._asked.__getitem__

    def index(self, places: tuple[int, ...]) -> dict[Row, list[Row]]:
        """The rows by their numbers in some places; those of later rows are added."""
        found = self._indexes.get(places)
        if found is None:
            found = self._indexes[places] = {}
            key = picked(places)
            for row in self.numbers if self.changes else self._statics():
                found.setdefault(key(row), []).append(row)
        return found

    def _statics(self) -> list[Row]:
        every = self._tables.statics.named(self.name)
        return [self._tables.row(atom) for atom in every if len(atom.arguments) == self.arity]

    def enter(self, row: Row, number: int) -> None:
        """Enter a new row."""
        self.numbers[row] = number
        for places, index in self._indexes.items():
            index.setdefault(picked(places)(row), []).append(row)


class Tables:
    """Numbers of terms, and those of the atoms that have been entered, over the facts that never change."""

    def __init__(self, statics: Facts, dynamic: Collection[str]) -> None:
        """No atom; those of the predicates in `dynamic` will be entered, all others are in `statics`."""
        self.statics, self.dynamic = statics, dynamic
        self.terms: list[Term] = []
        self.numbers: dict[Atom, int] = {}  # of atoms that have been told or asked for as atoms
        self.rows: list[tuple[Table, Row]] = []
        self._atoms: list[Atom | None] = []
        self._of_terms: dict[Term, int] = {}
        self._tables: dict[tuple[str, int], Table] = {}

    def table(self, name: str, arity: int) -> Table:
        """The table of a predicate."""
        key = name, arity
        if key not in self._tables:
            self._tables[key] = Table(name, arity, self)
        return self._tables[key]

    def term(self, term: Term) -> int:
        """The number of a term."""
        found = self._of_terms.get(term)
        if found is None:
            found = self._of_terms[term] = len(self.terms)
            self.terms.append(term)
        return found

    def row(self, atom: Atom) -> Row:
        """The numbers of an atom's arguments."""
        return tuple([self.term(each) for each in atom.arguments])

    def atom_of(self, name: str, row: Row) -> Atom:
        """The atom with these arguments."""
        terms = self.terms
        return Function(name, tuple([terms[each] for each in row]))

    def entered(self, table: Table, row: Row) -> tuple[int, bool]:
        """The number of an atom that is entered now or was before, and whether it is new."""
        found = table.numbers.get(row)
        if found is not None:
            return found, False
        number = len(self.rows)
        table.enter(row, number)
        self.rows.append((table, row))
        self._atoms.append(None)
        return number, True

    def told(self, atom: Atom) -> int | None:
        """The number of an atom that is entered now; None if it was before."""
        if atom in self.numbers:
            return None
        number, new = self.entered(self.table(atom.name, len(atom.arguments)), self.row(atom))
        self.numbers[atom], self._atoms[number] = number, atom
        return number if new else None

    def atom(self, number: int) -> Atom:
        """The atom with a number."""
        found = self._atoms[number]
        if found is None:
            table, row = self.rows[number]
            found = self._atoms[number] = self.atom_of(table.name, row)
            self.numbers[found] = number
        return found
