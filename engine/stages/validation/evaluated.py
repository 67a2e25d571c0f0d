"""Static facts that clingo has evaluated, as facts of the checker."""

from collections.abc import Callable, Iterable, Mapping

from cellwright.engine.stages.validation.facts import Facts
from cellwright.kb.terms import Atom, Term

SINGLY = 200  # atoms of a predicate that are asked for before all are read


class Evaluated(Facts):
    """Facts that someone else has evaluated. Each predicate is read when it is first asked for."""

    def __init__(self, read: Callable[[str], Iterable[Atom]], holds: Callable[[Atom], bool]) -> None:
        """Facts that `read` gives for a predicate, and that `holds` tells one by one."""
        super().__init__()
        self._read, self._holds = read, holds
        self._asked: dict[str, int] = {}
        self._typed: dict[tuple[str, Term], bool] = {}

    def __contains__(self, atom: Atom) -> bool:
        """Whether an atom is among the facts. The first questions do not read its predicate, which may be large."""
        known = self._by_name.get(atom.name)
        if known is not None:
            return atom in known
        asked = self._asked[atom.name] = self._asked.get(atom.name, 0) + 1
        return self._holds(atom) if asked <= SINGLY else atom in self._extent(atom.name)

    def has_type(self, term: Term, type_: str) -> bool:
        """Whether a term is a value of a type. The answer is remembered: these facts never change."""
        known = self._typed.get((type_, term))
        if known is None:
            known = self._typed[type_, term] = super().has_type(term, type_)
        return known

    def _extent(self, name: str) -> Mapping[Atom, None]:
        if name not in self._by_name:
            self._by_name[name] = dict.fromkeys(self._read(name))
        return self._by_name[name]
