"""Conditional effects compiled away: one plain operator for each set of effects that fire.

If an effect must not fire, one of its conditions must be false. This is expressed by the
complementary atom of that condition.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.kb.terms import Function

MAX_EFFECTS = 8  # conditional effects of one operator
MAX_VARIANTS = 100_000  # plain operators of a task
FORWARD_ONLY = (
    "a derived predicate can hold in very many ways: use the strategy auto, landmarks or forward"
)


class TooManyVariants(Exception):
    """An operator has more conditional effects than regression can split into plain operators."""


def unconditional_variants(task: GroundTask) -> list[GroundOperator]:
    """The operators of `task`, split into operators without conditional effects.

    Raises `TooManyVariants`, also where derived atoms are not replaced by their definitions.
    """
    if task.axioms is not None:
        raise TooManyVariants(FORWARD_ONLY)
    complements = _complement_numbers(task)
    variants: list[GroundOperator] = []
    for operator in task.operators:
        variants.extend(_operator_variants(operator, complements))
        if operator.conditional and len(variants) > MAX_VARIANTS:
            raise TooManyVariants(
                f"conditional effects make more than {MAX_VARIANTS} plain operators"
            )
    return variants


def _complement_numbers(task: GroundTask) -> dict[int, int]:
    """For each atom that has a complementary atom, the number of the latter; and the reverse."""
    index = {atom: number for number, atom in enumerate(task.atoms)}
    complements: dict[int, int] = {}
    for number, atom in enumerate(task.atoms):
        if (
            atom.name == "not"
            and len(atom.arguments) == 1
            and isinstance(atom.arguments[0], Function)
        ):
            positive = index[atom.arguments[0]]
            complements[positive], complements[number] = number, positive
    return complements


def _operator_variants(
    operator: GroundOperator, complements: dict[int, int]
) -> Iterator[GroundOperator]:
    if not operator.conditional:
        yield operator
        return
    if len(operator.conditional) > MAX_EFFECTS:
        raise TooManyVariants(
            f"{operator.instance} has {len(operator.conditional)} conditional effects; at most "
            f"{MAX_EFFECTS}"
        )
    for fires in itertools.product((True, False), repeat=len(operator.conditional)):
        yield from _make_variant(operator, fires, complements)


def _make_variant(
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
                [
                    1 << complements[atom]
                    for atom in indices(effect.condition)
                    if atom in complements
                ]
            )
    for choice in itertools.product(*broken):
        more = needed
        for bit in choice:
            more |= bit
        contradictory = any(
            more >> complements[atom] & 1 for atom in indices(more) if atom in complements
        )
        if not contradictory:
            added = adds & ~cancels
            yield replace(
                operator, preconditions=more, adds=added, deletes=deletes & ~added, conditional=()
            )


def plain_steps(task: GroundTask, steps: Sequence[GroundOperator]) -> list[GroundOperator]:
    """The steps of a sequence from the initial state, each as an operator without conditional
    effects and derived atoms.

    Such an operator has the effects that fire in the state of its step. For an effect that does not
    fire there, it needs the complementary atom of one of the effect's conditions.
    """
    complements = _complement_numbers(task)
    state, plain_operators = task.initial, []
    for operator in steps:
        plain = _plain_operator(operator, state, complements) if operator.conditional else operator
        plain_operators.append(task.grounded(state, plain))
        state = task.after(state, operator)
    return plain_operators


def _plain_operator(
    operator: GroundOperator, state: Bits, complements: dict[int, int]
) -> GroundOperator:
    needed, adds, deletes, cancels = operator.preconditions, operator.adds, operator.deletes, 0
    for effect in operator.conditional:
        false = effect.condition & ~state
        if not false:
            needed, adds = needed | effect.condition, adds | effect.adds
            deletes, cancels = deletes | effect.deletes, cancels | effect.cancels
        elif blocking := [complements[atom] for atom in indices(false) if atom in complements]:
            needed |= 1 << blocking[0]
    added = adds & ~cancels
    return replace(
        operator, preconditions=needed, adds=added, deletes=deletes & ~added, conditional=()
    )
