"""Tables of ground atoms as rows of numbers, one for each term, for compiled joins.

The checker's own, like the rest of its Datalog.
"""

from collections.abc import Callable, Collection, Sequence
from operator import itemgetter

from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.kb.terms import Atom, Function, Term

Row = tuple[int, ...]
Places = Sequence[int]


def pick_places(places: Places) -> Callable[[Sequence[int]], Row]:
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
        answer = self[row] = self._holds(row)
        return answer


class AtomTable:
    """The rows of a predicate with so many arguments.

    Those of a predicate that can change are entered one by one. Else they are the facts that never
    change, all of which are read when some are looked up, and few when single ones are tested.
    """

    def __init__(self, name: str, arity: int, tables: "AtomTables") -> None:
        self.name, self.arity, self.changes = name, arity, name in tables.dynamic
        # the number of the atom of each row that has been entered
        self.numbers: dict[Row, int] = {}
        self._tables = tables
        self._asked = _Asked(lambda row: tables.atom_of(name, row) in tables.statics)
        self._indexes: dict[tuple[int, ...], dict[Row, list[Row]]] = {}

    @property
    def has(self) -> Callable[[Row], bool]:
        """The function that tells whether a row is there."""
        return self.numbers.__contains__ if self.changes else self._asked.__getitem__

    def index(self, places: tuple[int, ...]) -> dict[Row, list[Row]]:
        """The rows by their numbers in some places; those of later rows are added."""
        index = self._indexes.get(places)
        if index is None:
            index = self._indexes[places] = {}
            key = pick_places(places)
            for row in self.numbers if self.changes else self._statics():
                index.setdefault(key(row), []).append(row)
        return index

    def _statics(self) -> list[Row]:
        every = self._tables.statics.named(self.name)
        return [self._tables.row(atom) for atom in every if len(atom.arguments) == self.arity]

    def enter(self, row: Row, number: int) -> None:
        """Enter a new row."""
        self.numbers[row] = number
        for places, index in self._indexes.items():
            index.setdefault(pick_places(places)(row), []).append(row)


class AtomTables:
    """Numbers of terms, and those of the atoms that have been entered, over the facts that
    never change.
    """

    def __init__(self, statics: CheckerFacts, dynamic: Collection[str]) -> None:
        """No atom; those of the predicates in `dynamic` will be entered, all others are in
        `statics`.
        """
        self.statics, self.dynamic = statics, dynamic
        self.terms: list[Term] = []
        self.numbers: dict[Atom, int] = {}  # of atoms that have been told or asked for as atoms
        self.rows: list[tuple[AtomTable, Row]] = []
        self._atoms: list[Atom | None] = []
        self._of_terms: dict[Term, int] = {}
        self._tables: dict[tuple[str, int], AtomTable] = {}

    def table(self, name: str, arity: int) -> AtomTable:
        """The table of a predicate."""
        key = name, arity
        if key not in self._tables:
            self._tables[key] = AtomTable(name, arity, self)
        return self._tables[key]

    def term(self, term: Term) -> int:
        """The number of a term."""
        number = self._of_terms.get(term)
        if number is None:
            number = self._of_terms[term] = len(self.terms)
            self.terms.append(term)
        return number

    def row(self, atom: Atom) -> Row:
        """The numbers of an atom's arguments."""
        return tuple([self.term(argument) for argument in atom.arguments])

    def atom_of(self, name: str, row: Row) -> Atom:
        """The atom with these arguments."""
        terms = self.terms
        return Function(name, tuple([terms[number] for number in row]))

    def entered(self, table: AtomTable, row: Row) -> tuple[int, bool]:
        """The number of an atom that is entered now or was before, and whether it is new."""
        known_number = table.numbers.get(row)
        if known_number is not None:
            return known_number, False
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
        known_atom = self._atoms[number]
        if known_atom is None:
            table, row = self.rows[number]
            known_atom = self._atoms[number] = self.atom_of(table.name, row)
            self.numbers[known_atom] = number
        return known_atom
