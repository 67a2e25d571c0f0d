"""Denied atoms that may or may not have been true, where it matters (language reference, Meaning 4)."""

from collections.abc import Iterator, Sequence

from engine.model.task import Bits, GroundOperator, indices
from kb.diagnostics import Diagnostic
from kb.model.domain import Domain, Operator
from kb.terms import Atom


def ambiguities(
    domain: Domain,
    operators: Sequence[GroundOperator],
    triggers: Bits,
    atoms: Sequence[Atom],
    groups: Sequence[Bits],
) -> Iterator[Diagnostic]:
    """One diagnostic per operator that denies an atom of `triggers` which its preconditions neither name nor exclude."""
    excluded: dict[int, Bits] = {}
    for group in groups:
        for atom in indices(group & triggers):
            excluded[atom] = excluded.get(atom, 0) | (group & ~(1 << atom))
    schemas: dict[str, Operator] = {operator.name: operator for operator in domain.operators}
    reported: set[str] = set()
    for operator in operators:
        name = operator.instance.name
        if name in reported or name not in schemas:
            continue
        for atom in indices(operator.deletes & triggers & ~operator.preconditions):
            if not excluded.get(atom, 0) & operator.preconditions:
                reported.add(name)
                message = (
                    f"{operator.instance} denies {atoms[atom]}, which has consequences if it was true before"
                )
                hint = f"name it in the preconditions of {name}, or name what excludes it"
                yield Diagnostic(schemas[name].where, "K302", message, hint)
                break
