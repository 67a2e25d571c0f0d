"""Denied atoms that may or may not have been true, where it matters (language reference, Meaning 4)."""

from collections.abc import Iterator, Sequence

from engine.model.task import Bits, indices
from engine.stages.grounding.instances import Doubt
from kb.diagnostics import Diagnostic
from kb.model.domain import Domain, Operator
from kb.terms import Atom


def ambiguities(
    domain: Domain, doubts: Sequence[Doubt], atoms: Sequence[Atom], groups: Sequence[Bits]
) -> Iterator[Diagnostic]:
    """One diagnostic per operator that denies an atom which its preconditions neither name nor exclude."""
    rivals = _Rivals(groups)
    schemas: dict[str, Operator] = {operator.name: operator for operator in domain.operators}
    reported: set[str] = set()
    for doubt in doubts:
        name = doubt.instance.name
        if name in reported or not (open_atoms := doubt.atoms & ~rivals.of(doubt.preconditions)):
            continue
        reported.add(name)
        atom = indices(open_atoms)[0]
        message = f"{doubt.instance} denies {atoms[atom]}, which has consequences if it was true before"
        hint = f"name it in the preconditions of {name}, or name what excludes it"
        yield Diagnostic(schemas[name].where, "K302", message, hint)


class _Rivals:
    """What is never true together with an atom, looked up once for each atom."""

    def __init__(self, groups: Sequence[Bits]) -> None:
        self.groups = groups
        self.known: dict[int, Bits] = {}

    def of(self, atoms: Bits) -> Bits:
        """What some atom of a set excludes."""
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
