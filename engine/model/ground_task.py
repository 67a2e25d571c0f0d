"""The ground task: numbered atoms, ground operators, states as integer bitsets, progression."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from cellwright.engine.kernels.bits import Bits as Bits
from cellwright.engine.kernels.bits import bitset as bitset
from cellwright.engine.kernels.bits import indices as indices
from cellwright.engine.model.ground_axioms import Axioms, QuantityAssignment, apply_changes
from cellwright.kb.terms import Atom, Function, Term


@dataclass(frozen=True, slots=True)
class ConditionalEffect:
    """An effect with a condition: `adds` and `deletes` happen if `condition` held before the step.

    `cancels` are the complementary atoms of `adds`. Another effect of the step that deletes what
    this one adds does not make them true.
    """

    condition: Bits
    adds: Bits
    deletes: Bits
    cancels: Bits = 0


@dataclass(frozen=True, slots=True)
class GroundOperator:
    """A ground operator: new state = (state - deletes) + adds.

    Several may share one `instance`; they differ in supports or stages. `changes` are those of
    quantities.
    """

    instance: Function
    preconditions: Bits
    adds: Bits
    deletes: Bits
    conditional: tuple[ConditionalEffect, ...] = ()
    resources: tuple[Term, ...] = ()
    duration: int = 0
    cost: int = 1
    changes: tuple[QuantityAssignment, ...] = ()


@dataclass(frozen=True, slots=True)
class GroundTask:
    """A ground planning task.

    `weights` are criticalities per atom; each mutex group holds at most one true atom. A negative
    condition on atom p is a positive one on the complementary atom `not(p)`, kept by every effect
    on p. `goals` are alternatives: a state that contains any one of the bitsets is a goal state. A
    task that is not `whole` leaves out objects that are like others, so what bounds its plans need
    not bound those of its problem. Derived atoms that are not replaced by their definitions have
    `axioms`; only conditions of operators name them, and `initial` is closed. Values of quantities
    that are met in a search are appended to `atoms`.
    """

    atoms: Sequence[Atom]
    operators: tuple[GroundOperator, ...]
    initial: Bits
    goals: tuple[Bits, ...]
    weights: tuple[int, ...]
    mutex_groups: tuple[Bits, ...] = ()
    whole: bool = True
    axioms: Axioms | None = None

    def after(self, state: Bits, operator: "GroundOperator") -> Bits:
        """The state after an operator, with its derived atoms.

        The state before must be closed, too.
        """
        return successor_state(self.axioms, state, operator)

    def grounded(self, state: Bits, operator: "GroundOperator") -> "GroundOperator":
        """The operator with fluents in the place of derived atoms in its preconditions, from
        which they follow in a state.
        """
        if self.axioms is None or not (
            operator.changes or operator.preconditions & self.axioms.derived
        ):
            return operator
        needed = self.axioms.support(state, operator.preconditions)
        if not operator.changes:
            return replace(operator, preconditions=needed)
        after, read, touched = apply_changes(state, state, operator.changes), 0, 0
        for change in operator.changes:
            touched |= change.level.mask
            for level, _ in change.to.parts:
                read |= state & level.mask
        adds, deletes = operator.adds | after & touched, operator.deletes | state & touched & ~after
        return replace(
            operator, preconditions=needed | read, adds=adds, deletes=deletes, changes=()
        )

    def reserve(self, number: int) -> None:
        """Keep the values of quantities from taking the number of an atom that a search adds
        for itself.
        """
        if isinstance(self.atoms, list) and len(self.atoms) == number:
            self.atoms.append(Function("_reserved"))

    def names(self, bits: Bits) -> tuple[Atom, ...]:
        """The atoms in a bitset."""
        return tuple(self.atoms[index] for index in indices(bits))


def progress_state(state: Bits, operator: GroundOperator) -> Bits:
    """The state after `operator` is applied in `state`: first delete, then add."""
    adds, deletes, cancels = operator.adds, operator.deletes, 0
    for effect in operator.conditional:
        if effect.condition & ~state == 0:
            adds |= effect.adds
            deletes |= effect.deletes
            cancels |= effect.cancels
    next_state = (state & ~deletes) | (adds & ~cancels)
    return apply_changes(next_state, state, operator.changes) if operator.changes else next_state


def successor_state(axioms: Axioms | None, state: Bits, operator: GroundOperator) -> Bits:
    """The closed state after `operator` is applied in a closed state.

    Derived atoms are looked at only if they may change.
    """
    next_state = progress_state(state, operator)
    if axioms is None or not axioms.may_change(next_state ^ state):
        return next_state
    return axioms.closed(next_state)
