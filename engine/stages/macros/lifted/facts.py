"""Sets of ground atoms with indexes. They are values: a change makes a new set.

The new set shares all predicates that the change does not touch, so a step costs only what it touches.
"""

from collections.abc import Callable, Collection, Iterable, Iterator

from cellwright.kb.model.domain import NUMERIC_TYPES, OBJECT
from cellwright.kb.terms import Atom, Function, Number, Term, Text, is_ground, match

SINGLY = 200  # atoms of a predicate that are asked for before all are read
SMALL = 4  # atoms; up to this number they are tried one by one


class Extent:
    """The atoms of one predicate.

    An index by argument is made at its first use; `after` passes it on to the new value.
    """

    __slots__ = ("_indexes", "atoms")

    def __init__(
        self, atoms: dict[Atom, None], indexes: dict[int, dict[Term, tuple[Atom, ...]]] | None = None
    ) -> None:
        self.atoms = atoms
        self._indexes: dict[int, dict[Term, tuple[Atom, ...]]] = indexes if indexes is not None else {}

    def after(self, ends: Iterable[Atom], adds: Iterable[Atom]) -> "Extent":
        """The atoms without `ends` and with `adds`."""
        atoms = self.atoms.copy()
        indexes = {position: index.copy() for position, index in self._indexes.items()}
        for atom in ends:
            if atom in atoms:
                del atoms[atom]
                for position, index in indexes.items():
                    key = atom.arguments[position]
                    index[key] = tuple(other for other in index[key] if other != atom)
        for atom in adds:
            if atom not in atoms:
                atoms[atom] = None
                for position, index in indexes.items():
                    key = atom.arguments[position]
                    index[key] = (*index.get(key, ()), atom)
        return Extent(atoms, indexes)

    def where(self, position: int, value: Term) -> tuple[Atom, ...]:
        """The atoms whose argument at `position` is `value`."""
        index = self._indexes.get(position)
        if index is None:
            gathered: dict[Term, list[Atom]] = {}
            for atom in self.atoms:
                gathered.setdefault(atom.arguments[position], []).append(atom)
            index = self._indexes[position] = {key: tuple(found) for key, found in gathered.items()}
        return index.get(value, ())


NOTHING = Extent({})


class Facts:
    """Ground atoms, grouped by predicate, otherwise in the given order. Iteration yields all of them."""

    __slots__ = ("_extents",)

    def __init__(self, atoms: Iterable[Atom] = ()) -> None:
        gathered: dict[str, dict[Atom, None]] = {}
        for atom in atoms:
            gathered.setdefault(atom.name, {})[atom] = None
        self._extents = {name: Extent(found) for name, found in gathered.items()}

    def __contains__(self, atom: Atom) -> bool:
        return atom in self._extent(atom.name).atoms

    def __iter__(self) -> Iterator[Atom]:
        for extent in self._extents.values():
            yield from extent.atoms

    def _extent(self, name: str) -> Extent:
        return self._extents.get(name, NOTHING)

    def atoms(self) -> frozenset[Atom]:
        """All atoms."""
        return frozenset().union(*(extent.atoms for extent in self._extents.values()))

    def after(self, ends: Collection[Atom], adds: Collection[Atom]) -> "Facts":
        """The facts without `ends` and with `adds`. An atom in both is kept."""
        changed = Facts()
        changed._extents = self._extents.copy()
        touched: dict[str, tuple[list[Atom], list[Atom]]] = {}
        for atom in ends:
            if atom not in adds:
                touched.setdefault(atom.name, ([], []))[0].append(atom)
        for atom in adds:
            touched.setdefault(atom.name, ([], []))[1].append(atom)
        for name, (lost, gained) in touched.items():
            changed._extents[name] = self._extent(name).after(lost, gained)
        return changed

    def named(self, name: str) -> Collection[Atom]:
        """All atoms of a predicate."""
        return self._extent(name).atoms

    def matching(self, pattern: Atom) -> Collection[Atom]:
        """A superset of the atoms that match a pattern: those that share one of its ground arguments."""
        extent = self._extent(pattern.name)
        if len(extent.atoms) <= SMALL:
            return extent.atoms
        best: Collection[Atom] = extent.atoms
        for position, argument in enumerate(pattern.arguments):
            if is_ground(argument):
                found = extent.where(position, argument)
                if len(found) <= SMALL:
                    return found
                best = found if len(found) < len(best) else best
        return best

    def any_match(self, pattern: Atom) -> bool:
        """Whether some atom matches the pattern, in which `_` and variables stand for anything."""
        if is_ground(pattern):
            return pattern in self
        return any(match(pattern, other, {}) is not None for other in self.matching(pattern))

    def has_type(self, term: Term, type_: str) -> bool:
        """Whether a ground term is a member of a type."""
        if type_ in NUMERIC_TYPES:
            return isinstance(term, Number)
        if type_ == "text":
            return isinstance(term, Text)
        return type_ == OBJECT or Function(type_, (term,)) in self


class Layered(Facts):
    """The facts of a state, and below them those of predicates of which the state has none."""

    __slots__ = ("_above", "_below")

    def __init__(self, above: Facts, below: Facts) -> None:
        super().__init__()
        self._above, self._below = above, below

    def __contains__(self, atom: Atom) -> bool:
        return atom in self._above or atom in self._below

    def _extent(self, name: str) -> Extent:
        found = self._above._extent(name)
        return found if found.atoms else self._below._extent(name)


class GivenFacts(Facts):
    """Facts that someone else has evaluated. Each predicate is read when it is first asked for; nothing is changed."""

    __slots__ = ("_asked", "_holds", "_read", "_told")

    def __init__(self, read: Callable[[str], Iterable[Atom]], holds: Callable[[Atom], bool]) -> None:
        """Facts that `read` gives for a predicate, and that `holds` tells one by one."""
        super().__init__()
        self._read, self._holds = read, holds
        self._asked: dict[str, int] = {}
        self._told: dict[Atom, bool] = {}

    def __contains__(self, atom: Atom) -> bool:
        """Whether an atom is among the facts. The first questions do not read its predicate, which may be large."""
        known = self._extents.get(atom.name)
        if known is not None:
            return atom in known.atoms
        told = self._told.get(atom)
        return told if told is not None else self._tell(atom)

    def _tell(self, atom: Atom) -> bool:
        asked = self._asked[atom.name] = self._asked.get(atom.name, 0) + 1
        if asked > SINGLY:
            return atom in self._extent(atom.name).atoms
        told = self._told[atom] = self._holds(atom)
        return told

    def _extent(self, name: str) -> Extent:
        if name not in self._extents:
            self._extents[name] = Extent(dict.fromkeys(self._read(name)))
        return self._extents[name]
