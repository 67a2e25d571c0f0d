"""Denied atoms that may or may not have been true, where it matters (language reference, Meaning 4)."""

from collections.abc import Iterator, Sequence

from engine.grounding.instances import Doubt
from engine.model.task import Bits, indices
from kb.diagnostics import Diagnostic
from kb.model.domain import Domain, Operator
from kb.terms import Atom


def ambiguities(
    domain: Domain, doubts: Sequence[Doubt], atoms: Sequence[Atom], groups: Sequence[Bits]
) -> Iterator[Diagnostic]:
    """One diagnostic per operator that denies an atom which its preconditions neither name nor exclude."""
    excluded = _excluded(doubts, groups)
    schemas: dict[str, Operator] = {operator.name: operator for operator in domain.operators}
    for doubt in {each.instance.name: each for each in reversed(doubts) if _open(each, excluded)}.values():
        name = doubt.instance.name
        atom = next(atom for atom in indices(doubt.atoms) if not excluded[atom] & doubt.preconditions)
        message = f"{doubt.instance} denies {atoms[atom]}, which has consequences if it was true before"
        hint = f"name it in the preconditions of {name}, or name what excludes it"
        yield Diagnostic(schemas[name].where, "K302", message, hint)


def _open(doubt: Doubt, excluded: dict[int, Bits]) -> bool:
    return any(not excluded[atom] & doubt.preconditions for atom in indices(doubt.atoms))


def _excluded(doubts: Sequence[Doubt], groups: Sequence[Bits]) -> dict[int, Bits]:
    """For each doubtful atom what is never true with it."""
    doubtful = 0
    for doubt in doubts:
        doubtful |= doubt.atoms
    excluded = dict.fromkeys(indices(doubtful), 0)
    for group in groups:
        for atom in indices(group & doubtful):
            excluded[atom] |= group & ~(1 << atom)
    return excluded
