"""Conditional effects that never happen are left out: what they need never holds together with what their operator needs.

A step that needs the rotor to be without a tube does nothing to that tube. Estimates that ignore what becomes false do not
see this, and searches would take the goal for reachable.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from cellwright.engine.model.task import Bits, GroundOperator, indices


def firing(operators: Iterable[GroundOperator], groups: Iterable[Bits]) -> Iterator[GroundOperator]:
    """The operators with those conditional effects that may happen, by mutex groups. The groups may overlap."""
    excluded: dict[int, Bits] = {}
    for group in groups:
        for atom in indices(group):
            excluded[atom] = excluded.get(atom, 0) | group & ~(1 << atom)
    for operator in operators:
        yield _firing(operator, excluded) if operator.conditional else operator


def _firing(operator: GroundOperator, excluded: dict[int, Bits]) -> GroundOperator:
    against = _against(operator.preconditions, excluded)
    kept = [
        effect
        for effect in operator.conditional
        if not effect.condition & (against | _against(effect.condition, excluded))
    ]
    return operator if len(kept) == len(operator.conditional) else replace(operator, conditional=tuple(kept))


def _against(atoms: Bits, excluded: dict[int, Bits]) -> Bits:
    """What is never true together with all of these atoms."""
    found = 0
    for atom in indices(atoms):
        found |= excluded.get(atom, 0)
    return found
