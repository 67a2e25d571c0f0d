"""Mutex pairs: atoms that are never true together, from mutex groups and pair reachability.

Pair reachability is h^2 (Haslum & Geffner 2000). A pair is possible if an operator with pairwise
possible preconditions adds both atoms. It is also possible if such an operator adds one atom and
does not delete the other, and the other is possible together with the operator's preconditions.
"""

from collections.abc import Sequence

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask

MAX_PAIR_WORK = 40_000_000  # operators times atoms; above this only mutex groups are used


def find_mutexes(task: GroundTask) -> tuple[Bits, ...]:
    """For each atom the set of atoms that are never true together with it."""
    size = len(task.atoms)
    excluded = [0] * size
    for group in task.mutex_groups:
        for atom in indices(group):
            excluded[atom] |= group & ~(1 << atom)
    if len(task.operators) * size <= MAX_PAIR_WORK and not any(
        operator.conditional for operator in task.operators
    ):
        together = _possible_pairs(task, excluded)
        everything = (1 << size) - 1
        excluded = [everything & ~pairs & ~(1 << atom) for atom, pairs in enumerate(together)]
    return tuple(excluded)


def _possible_pairs(task: GroundTask, excluded: Sequence[Bits]) -> list[Bits]:
    """For each atom the atoms that can be true with it, itself included if it is reachable."""
    together = [0] * len(task.atoms)
    for atom in indices(task.initial):
        together[atom] = task.initial
    pending = list(task.operators)
    changed = True
    while changed:
        changed = False
        for operator in pending:
            beside = _true_together(operator, together)
            if beside is not None and _extend_pairs(operator, beside, together, excluded):
                changed = True
    return together


def _true_together(operator: GroundOperator, together: Sequence[Bits]) -> Bits | None:
    """What can be true together with all preconditions; None if these cannot be true together."""
    beside = -1
    for atom in indices(operator.preconditions):
        beside &= together[atom]
    if operator.preconditions & ~beside:
        return None
    if beside == -1:
        beside = 0
        for atom, pairs in enumerate(together):
            if pairs >> atom & 1:
                beside |= 1 << atom
    return beside


def _extend_pairs(
    operator: GroundOperator, beside: Bits, together: list[Bits], excluded: Sequence[Bits]
) -> bool:
    """Notes the pairs that an operator makes possible. Returns whether any of them is new."""
    after = (beside & ~operator.deletes) | operator.adds
    changed = False
    for atom in indices(operator.adds):
        new = after & ~together[atom] & ~excluded[atom]
        if new:
            changed = True
            together[atom] |= new
            bit = 1 << atom
            for new_atom in indices(new):
                together[new_atom] |= bit
    return changed
