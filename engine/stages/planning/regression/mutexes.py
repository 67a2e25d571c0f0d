"""Pairs of atoms that are never true together: from mutex groups and, where affordable, from pair reachability.

Pair reachability is h^2 (Haslum & Geffner 2000): a pair is possible if some operator, all of whose preconditions are
pairwise possible, adds both, or adds one and leaves the other, possible beside its preconditions, alone.
"""

from collections.abc import Sequence

from engine.model.task import Bits, GroundOperator, Task, indices

MAX_WORK = 40_000_000  # operators x atoms, beyond which only groups are used


def mutexes(task: Task) -> tuple[Bits, ...]:
    """For each atom the set of atoms that are never true with it."""
    size = len(task.atoms)
    found = [0] * size
    for group in task.mutex_groups:
        for atom in indices(group):
            found[atom] |= group & ~(1 << atom)
    if len(task.operators) * size <= MAX_WORK and not any(
        operator.conditional for operator in task.operators
    ):
        together = _possible_pairs(task, found)
        everything = (1 << size) - 1
        found = [everything & ~pairs & ~(1 << atom) for atom, pairs in enumerate(together)]
    return tuple(found)


def _possible_pairs(task: Task, excluded: Sequence[Bits]) -> list[Bits]:
    """For each atom the atoms it can be true with, itself included if it is reachable."""
    together = [0] * len(task.atoms)
    for atom in indices(task.initial):
        together[atom] = task.initial
    pending = list(task.operators)
    changed = True
    while changed:
        changed = False
        for operator in pending:
            beside = _beside(operator, together)
            if beside is not None and _extend(operator, beside, together, excluded):
                changed = True
    return together


def _beside(operator: GroundOperator, together: Sequence[Bits]) -> Bits | None:
    """What can be true together with all preconditions; None if they cannot be true together."""
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


def _extend(operator: GroundOperator, beside: Bits, together: list[Bits], excluded: Sequence[Bits]) -> bool:
    """Note the pairs an operator makes possible; whether any is new."""
    after = (beside & ~operator.deletes) | operator.adds
    changed = False
    for atom in indices(operator.adds):
        new = after & ~together[atom] & ~excluded[atom]
        if new:
            changed = True
            together[atom] |= new
            bit = 1 << atom
            for other in indices(new):
                together[other] |= bit
    return changed
