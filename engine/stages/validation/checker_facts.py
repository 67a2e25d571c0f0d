"""Facts of the checker in layers, looked up by predicate and argument; static ones by clingo."""

import itertools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Set

from cellwright.kb.model.domain_model import NUMERIC_TYPES, OBJECT_TYPE
from cellwright.kb.terms import Atom, Function, Number, Term, Text, is_ground

Key = tuple[int, Term]  # the place of an argument, and what it is
NO_ATOMS: Mapping[Atom, None] = {}
MIN_INDEXED_ATOMS = 16  # atoms of a predicate


class CheckerFacts:
    """A set of ground atoms on top of a layer of facts that never change.

    The atoms are kept by predicate. Those of a large predicate are indexed by argument when a
    pattern asks for some.
    """

    def __init__(self, atoms: Iterable[Atom] = (), below: "CheckerFacts | None" = None) -> None:
        self.below = below
        self._by_name: dict[str, dict[Atom, None]] = {}
        for atom in atoms:
            self._by_name.setdefault(atom.name, {})[atom] = None
        self._indexes: dict[str, dict[Key, list[Atom]]] = {}

    def _extent(self, name: str) -> Mapping[Atom, None]:
        """The atoms of a predicate in this layer."""
        return self._by_name.get(name, NO_ATOMS)

    def add(self, atom: Atom) -> bool:
        """Add an atom. Returns whether it is new."""
        if atom in self:
            return False
        self._enter(atom)
        return True

    def put(self, atom: Atom) -> bool:
        """Add an atom of which the facts that never change know nothing.

        Returns whether it is new.
        """
        layer = self
        while layer.below is not None:
            if atom in layer._extent(atom.name):
                return False
            layer = layer.below
        self._enter(atom)
        return True

    def _enter(self, atom: Atom) -> None:
        self._by_name.setdefault(atom.name, {})[atom] = None
        index = self._indexes.get(atom.name)
        if index is not None:
            for key in enumerate(atom.arguments):
                index.setdefault(key, []).append(atom)

    def after(self, ends: Set[Atom], adds: Set[Atom]) -> "CheckerFacts":
        """The facts after some atoms end and then others are added.

        Untouched predicates are shared.
        """
        next_facts = CheckerFacts((), self.below)
        next_facts._by_name, next_facts._indexes = self._by_name.copy(), self._indexes.copy()
        for name in {atom.name for atom in (*ends, *adds)}:
            next_facts._by_name[name] = dict(self._by_name.get(name, NO_ATOMS))
            if name in next_facts._indexes:
                next_facts._indexes[name] = next_facts._indexes[name].copy()
        for atom in ends:
            if next_facts._by_name[atom.name].pop(atom, 0) is None and next_facts._indexes:
                next_facts._reindex(atom, ())
        for atom in adds:
            own = next_facts._by_name[atom.name]
            if atom not in own:
                own[atom] = None
                if next_facts._indexes:
                    next_facts._reindex(atom, (atom,))
        return next_facts

    def _reindex(self, atom: Atom, now: tuple[Atom, ...]) -> None:
        """Have an index list an atom anew, or no more.

        Its lists may be those of other facts, so they stay as they are.
        """
        index = self._indexes.get(atom.name)
        if index is not None:
            for key in enumerate(atom.arguments):
                index[key] = [fact for fact in index.get(key, ()) if fact != atom] + [*now]

    def __contains__(self, atom: Atom) -> bool:
        return atom in self._extent(atom.name) or (self.below is not None and atom in self.below)

    def atoms(self) -> Iterator[Atom]:
        """Every atom of this layer."""
        return (atom for extent in self._by_name.values() for atom in extent)

    def extent(self, name: str) -> Iterator[Atom]:
        """Every atom of a predicate that is above the facts that never change."""
        layers, facts = list[CheckerFacts](), self
        while facts.below is not None:
            layers.append(facts)
            facts = facts.below
        return (atom for layer in layers for atom in layer._extent(name))

    def named(self, name: str) -> Iterator[Atom]:
        """Every atom of a predicate."""
        yield from self._extent(name)
        if self.below is not None:
            yield from self.below.named(name)

    def matching(self, pattern: Atom) -> Iterator[Atom]:
        """The atoms of a pattern's predicate, of a large one only those that share a ground
        argument with the pattern.
        """
        extent = self._extent(pattern.name)
        ground = (
            [key for key in enumerate(pattern.arguments) if is_ground(key[1])]
            if len(extent) > MIN_INDEXED_ATOMS
            else []
        )
        yield from self._sharing(pattern.name, extent, ground)
        if self.below is not None:
            yield from self.below.matching(pattern)

    def having(self, name: str, arguments: Sequence[Key]) -> Iterable[Atom]:
        """The same for a predicate and some arguments that are known, with their places."""
        own = self._sharing(name, self._extent(name), arguments)
        if self.below is None:
            return own
        under = self.below.having(name, arguments)
        return itertools.chain(own, under) if under else own

    def _sharing(
        self, name: str, extent: Mapping[Atom, None], arguments: Sequence[Key]
    ) -> Collection[Atom]:
        if len(extent) <= MIN_INDEXED_ATOMS or not arguments:
            return extent
        if name not in self._indexes:
            index: dict[Key, list[Atom]] = {}
            for atom in extent:
                for key in enumerate(atom.arguments):
                    index.setdefault(key, []).append(atom)
            self._indexes[name] = index
        own = self._indexes[name]
        return min((own.get(key, []) for key in arguments), key=len)

    def has_type(self, term: Term, type_: str) -> bool:
        """Whether a term is a value of a type."""
        if type_ in NUMERIC_TYPES:
            return isinstance(term, Number)
        if type_ == "text":
            return isinstance(term, Text)
        return type_ == OBJECT_TYPE or Function(type_, (term,)) in self


class CompletedFacts(CheckerFacts):
    """Facts that are completed with what follows from them, of each predicate when it is first
    asked for.
    """

    def __init__(
        self,
        atoms: Iterable[Atom] | CheckerFacts,
        below: CheckerFacts,
        follow: Collection[str],
        complete: Callable[["CompletedFacts", str], None],
    ) -> None:
        """Facts to which `complete` adds all atoms of a predicate in `follow`; they are its first
        argument, so that they need not refer to themselves.

        Those of a layer are shared with it.
        """
        super().__init__((), below)
        layer = atoms if isinstance(atoms, CheckerFacts) else CheckerFacts(atoms)
        self._by_name, self._indexes = layer._by_name.copy(), layer._indexes.copy()
        self._follow, self._complete = set(follow), complete

    def _extent(self, name: str) -> Mapping[Atom, None]:
        if name in self._follow:
            self._complete(self, name)
        return super()._extent(name)

    def settle(self, names: Set[str]) -> Set[str]:
        """Take the atoms of some predicates as they are: what follows has been added, or is
        being added. Returns which had not been.
        """
        pending = self._follow & names
        self._follow -= pending
        return pending


MAX_SINGLE_LOOKUPS = 200  # atoms of a predicate that are asked for before all may be read
WORTH_READING = 4  # times as many atoms are read as have been asked for, at most


class EvaluatedFacts(CheckerFacts):
    """Facts that someone else has evaluated. Each predicate is read when it is first asked for."""

    def __init__(
        self,
        read: Callable[[str], Iterable[Atom]],
        holds: Callable[[Atom], bool],
        has_more: Callable[[str, int], bool] = lambda _name, _count: False,
    ) -> None:
        """Facts that `read` gives for a predicate, and that `holds` tells one by one; `has_more`
        says whether a predicate has more than so many.
        """
        super().__init__()
        self._read, self._holds, self._has_more = read, holds, has_more
        self._asked: dict[str, int] = {}
        self._single: dict[str, int] = {}  # how many questions may read nothing
        self._typed: dict[tuple[str, Term], bool] = {}

    def __contains__(self, atom: Atom) -> bool:
        """Whether an atom is among the facts.

        Few questions do not read its predicate, which may be large.
        """
        own_atoms = self._by_name.get(atom.name)
        if own_atoms is not None:
            return atom in own_atoms
        asked = self._asked[atom.name] = self._asked.get(atom.name, 0) + 1
        limit = self._single.get(atom.name, MAX_SINGLE_LOOKUPS)
        if asked > limit:
            if not self._has_more(atom.name, WORTH_READING * asked):
                return atom in self._extent(atom.name)
            self._single[atom.name] = 2 * limit
        return self._holds(atom)

    def has_type(self, term: Term, type_: str) -> bool:
        """Whether a term is a value of a type.

        The answer is remembered: these facts never change.
        """
        answer = self._typed.get((type_, term))
        if answer is None:
            answer = self._typed[type_, term] = super().has_type(term, type_)
        return answer

    def _extent(self, name: str) -> Mapping[Atom, None]:
        if name not in self._by_name:
            self._by_name[name] = dict.fromkeys(self._read(name))
        return self._by_name[name]
