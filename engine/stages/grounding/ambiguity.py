"""Denied atoms that may have been true before or not, where this makes a difference (language, Meaning 4)."""

from collections.abc import Iterator, Sequence

from cellwright.engine.model.task import Bits, indices
from cellwright.engine.stages.grounding.instances import Doubt
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.domain import Domain, Operator
from cellwright.kb.terms import Atom


def ambiguities(
    domain: Domain, doubts: Sequence[Doubt], atoms: Sequence[Atom], groups: Sequence[Bits]
) -> Iterator[Diagnostic]:
    """One diagnostic for each operator that denies an atom which may or may not have been true before.

    This is open if the preconditions neither contain the atom nor exclude it.
    """
    rivals = _Rivals(groups)
    schemas: dict[str, Operator] = {operator.name: operator for operator in domain.operators}
    reported: set[str] = set()
    for doubt in doubts:
        name = doubt.instance.name
        if name in reported or not (open_atoms := doubt.atoms & ~rivals.of(doubt.preconditions)):
            continue
        reported.add(name)
        atom = indices(open_atoms)[0]
        message = f"{doubt.instance} denies {atoms[atom]}; what follows depends on whether it was true before"
        hint = f"add this atom, or one that excludes it, to the preconditions of {name}"
        yield Diagnostic(schemas[name].where, "K302", message, hint)


class _Rivals:
    """The atoms that are never true together with a given atom; they are looked up once for each atom."""

    def __init__(self, groups: Sequence[Bits]) -> None:
        self.groups = groups
        self.known: dict[int, Bits] = {}

    def of(self, atoms: Bits) -> Bits:
        """All atoms that are excluded by at least one atom of a set."""
        found = 0
        for atom in indices(atoms):
            if atom not in self.known:
                self.known[atom] = self._excluded(1 << atom)
            found |= self.known[atom]
        return found

    def _excluded(self, bit: Bits) -> Bits:
        found = 0
        for group in self.groups:
            if group & bit:
                found |= group & ~bit
        return found
