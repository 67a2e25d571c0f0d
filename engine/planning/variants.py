"""Conditional effects compiled away for regression: one plain operator per set of effects that fire (Gazen & Knoblock
1997). An effect that must not fire has one of its conditions false, which needs that atom's complement."""

import itertools
from collections.abc import Iterator
from dataclasses import replace

from engine.model.task import Bits, GroundOperator, Task, indices
from kb.terms import Function

MAX_EFFECTS = 8


class TooManyVariants(Exception):
    """An operator has more conditional effects than regression can split."""


def unconditional(task: Task) -> list[GroundOperator]:
    """The operators of `task` without conditional effects. Raises `TooManyVariants`."""
    complements = _complements(task)
    return [variant for operator in task.operators for variant in _variants(operator, complements)]


def _complements(task: Task) -> dict[int, int]:
    """For each atom that has one, its complementary atom, both ways."""
    index = {atom: number for number, atom in enumerate(task.atoms)}
    found: dict[int, int] = {}
    for number, atom in enumerate(task.atoms):
        if atom.name == "not" and len(atom.arguments) == 1 and isinstance(atom.arguments[0], Function):
            positive = index[atom.arguments[0]]
            found[positive], found[number] = number, positive
    return found


def _variants(operator: GroundOperator, complements: dict[int, int]) -> Iterator[GroundOperator]:
    if not operator.conditional:
        yield operator
        return
    if len(operator.conditional) > MAX_EFFECTS:
        raise TooManyVariants(
            f"{operator.instance} has {len(operator.conditional)} conditional effects; at most {MAX_EFFECTS}"
        )
    for fires in itertools.product((True, False), repeat=len(operator.conditional)):
        yield from _variant(operator, fires, complements)


def _variant(
    operator: GroundOperator, fires: tuple[bool, ...], complements: dict[int, int]
) -> Iterator[GroundOperator]:
    needed, adds, deletes, cancels = operator.preconditions, operator.adds, operator.deletes, 0
    broken: list[list[Bits]] = []
    for effect, fired in zip(operator.conditional, fires, strict=True):
        if fired:
            needed |= effect.condition
            adds |= effect.adds
            deletes |= effect.deletes
            cancels |= effect.cancels
        else:
            broken.append(
                [1 << complements[atom] for atom in indices(effect.condition) if atom in complements]
            )
    for choice in itertools.product(*broken):
        more = needed
        for bit in choice:
            more |= bit
        contradictory = any(more >> complements[atom] & 1 for atom in indices(more) if atom in complements)
        if not contradictory:
            added = adds & ~cancels
            yield replace(operator, preconditions=more, adds=added, deletes=deletes & ~added, conditional=())
