"""Conditional effects compiled away for regression, with one plain operator for each set of effects that fire
(Gazen & Knoblock 1997).

If an effect must not fire, one of its conditions must be false. This is expressed by the complementary atom
of that condition.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

from cellwright.engine.model.task import Bits, GroundOperator, Task, indices
from cellwright.kb.terms import Function

MAX_EFFECTS = 8  # conditional effects of one operator
MAX_VARIANTS = 100_000  # plain operators of a task
FORWARD_ONLY = "a derived predicate can hold in very many ways: use the strategy auto, landmarks or forward"


class TooManyVariants(Exception):
    """An operator has more conditional effects than regression can split into plain operators."""


def unconditional(task: Task) -> list[GroundOperator]:
    """The operators of `task`, split into operators without conditional effects.

    Raises `TooManyVariants`, also where derived atoms are not replaced by their definitions.
    """
    if task.axioms is not None:
        raise TooManyVariants(FORWARD_ONLY)
    complements = _complements(task)
    found: list[GroundOperator] = []
    for operator in task.operators:
        found.extend(_variants(operator, complements))
        if operator.conditional and len(found) > MAX_VARIANTS:
            raise TooManyVariants(f"conditional effects make more than {MAX_VARIANTS} plain operators")
    return found


def _complements(task: Task) -> dict[int, int]:
    """For each atom that has a complementary atom, the number of the latter; and the reverse."""
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


def plainly(task: Task, steps: Sequence[GroundOperator]) -> list[GroundOperator]:
    """The steps of a sequence from the initial state, each as an operator without conditional effects and derived atoms.

    Such an operator has the effects that fire in the state of its step. For an effect that does not fire
    there, it needs the complementary atom of one of the effect's conditions.
    """
    complements = _complements(task)
    state, made = task.initial, []
    for operator in steps:
        plain = _plain(operator, state, complements) if operator.conditional else operator
        made.append(task.grounded(state, plain))
        state = task.after(state, operator)
    return made


def _plain(operator: GroundOperator, state: Bits, complements: dict[int, int]) -> GroundOperator:
    needed, adds, deletes, cancels = operator.preconditions, operator.adds, operator.deletes, 0
    for effect in operator.conditional:
        false = effect.condition & ~state
        if not false:
            needed, adds = needed | effect.condition, adds | effect.adds
            deletes, cancels = deletes | effect.deletes, cancels | effect.cancels
        elif blocking := [complements[atom] for atom in indices(false) if atom in complements]:
            needed |= 1 << blocking[0]
    added = adds & ~cancels
    return replace(operator, preconditions=needed, adds=added, deletes=deletes & ~added, conditional=())
