"""When places that hold one object are taken, and which places are interchangeable.

One block makes an atom such as `free(slot)` false, and a later block of the same object makes it
true again. This is a hold of the place, and the order in which objects use the place in the plan
need not be kept. Places that can be exchanged in the whole task are one resource together.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.shop_scheduling import Hold, StageMoment
from cellwright.engine.stages.scheduling.plan_blocks import contains_term
from cellwright.kb.terms import Function, Term


@dataclass(frozen=True, slots=True)
class AtomTouch:
    """A step of a stage needs, ends or makes an atom.

    `begin` and `end` count from the start of the stage.
    """

    stage: str
    job: str
    begin: int
    end: int
    needs: bool
    ends: bool
    makes: bool

    @property
    def first(self) -> StageMoment:
        """When the step starts."""
        return StageMoment(self.stage, self.begin)

    @property
    def last(self) -> StageMoment:
        """When the step ends."""
        return StageMoment(self.stage, self.end)


def place_holds_of(
    resource: str, touches: Sequence[AtomTouch], initially: bool
) -> list[Hold] | None:
    """The holds of a place, from what touches its atom `free`; None if the atom is about no such
    place.

    Each object must give back what it has taken before it takes it again. An object that gives a
    place back without having taken it was there from the start.
    """
    jobs: dict[str, list[AtomTouch]] = {}
    for touch in touches:
        jobs.setdefault(touch.job, []).append(touch)
    holds: list[Hold] = []
    for job_touches in jobs.values():
        own = _holds_of_one(resource, job_touches)
        if own is None:
            return None
        holds += own
    from_start = sum(hold.begin is None for hold in holds)
    return holds if from_start <= (0 if initially else 1) else None


def _holds_of_one(resource: str, touches: Sequence[AtomTouch]) -> list[Hold] | None:
    """The same for one object.

    A step that only needs the place to be free takes it while the step lasts.
    """
    holds: list[Hold] = []
    taker: AtomTouch | None = None
    for touch in touches:
        if touch.ends:
            if taker is not None or not touch.needs:
                return None
            taker = touch
        elif touch.makes:
            if taker is None and holds:
                return None
            holds.append(Hold(resource, taker.first if taker else None, touch.last))
            taker = None
        elif taker is None:
            holds.append(Hold(resource, touch.first, touch.last))
        else:
            return None
    return [*holds, Hold(resource, taker.first, None)] if taker else holds


@dataclass(frozen=True)
class Exchange:
    """Finds which terms of a task can be exchanged without changing the task."""

    task: GroundTask
    goals: Bits

    @cached_property
    def _index(self) -> dict[Function, int]:
        return {atom: number for number, atom in enumerate(self.task.atoms)}

    @cached_property
    def _operators(self) -> set[object]:
        return {_operator_key(operator) for operator in self.task.operators}

    def alike(self, atom: Function) -> tuple[Function, ...]:
        """The atoms such as `free(place)` whose places can be exchanged with that of `atom`;
        `atom` is first.
        """
        number = self._index[atom]
        if len(atom.arguments) != 1 or not self.task.initial >> number & 1:
            return (atom,)
        similar_atoms = [
            similar_atom
            for similar_atom in self.task.atoms
            if similar_atom.name == atom.name and similar_atom != atom
        ]
        return (
            atom,
            *(
                similar_atom
                for similar_atom in similar_atoms
                if self._exchangeable(atom.arguments[0], similar_atom.arguments[0])
            ),
        )

    def _exchangeable(self, one: Term, other: Term) -> bool:
        if (
            not isinstance(one, Function)
            or not isinstance(other, Function)
            or one.name != other.name
        ):
            return False
        if one.arguments[:-1] != other.arguments[:-1] or len(one.arguments) != len(other.arguments):
            return False
        swap = self._swap(one, other)
        if swap is None or _swap_atoms(self.task.initial, swap) != self.task.initial:
            return False
        if _swap_atoms(self.goals, swap) != self.goals:
            return False
        return all(
            _operator_key(operator, swap, (one, other)) in self._operators
            for operator in self.task.operators
            if touches_swap(operator, swap)
            or contains_term(operator.instance, one)
            or contains_term(operator.instance, other)
        )

    def _swap(self, one: Term, other: Term) -> dict[int, int] | None:
        """What each atom with one of the terms becomes when they are exchanged; None if one is
        missing.
        """
        swaps: dict[int, int] = {}
        for number, atom in enumerate(self.task.atoms):
            if contains_term(atom, one) or contains_term(atom, other):
                image = self._index.get(exchange_in_atom(atom, one, other))
                if image is None:
                    return None
                swaps[number] = image
        return swaps


def touches_swap(operator: GroundOperator, swap: dict[int, int]) -> bool:
    """Whether an operator has any atom of a swap."""
    return bool((operator.preconditions | operator.adds | operator.deletes) & bitset(list(swap)))


def exchange_in_atom(term: Function, one: Term, other: Term) -> Function:
    """A term in which two of its parts are exchanged."""
    return Function(
        term.name, tuple(_exchange_part(argument, one, other) for argument in term.arguments)
    )


def _exchange_part(term: Term, one: Term, other: Term) -> Term:
    if term in (one, other):
        return other if term == one else one
    return (
        exchange_in_atom(term, one, other)
        if isinstance(term, Function) and term.arguments
        else term
    )


def _swap_atoms(bits: Bits, swap: dict[int, int]) -> Bits:
    swapped = bits
    for number in swap:
        swapped &= ~(1 << number)
    return swapped | bitset([swap[number] for number in indices(bits) if number in swap])


def _operator_key(
    operator: GroundOperator,
    swap: dict[int, int] | None = None,
    pair: tuple[Term, Term] | None = None,
) -> object:
    """What identifies a ground operator, after an exchange of atoms and terms."""
    sets: Iterator[Bits] = iter((operator.preconditions, operator.adds, operator.deletes))
    moved = tuple(_swap_atoms(atoms, swap) if swap else atoms for atoms in sets)
    resources = tuple(_exchange_part(r, *pair) if pair else r for r in operator.resources)
    effects = tuple(
        tuple(
            _swap_atoms(b, swap) if swap else b for b in (e.condition, e.adds, e.deletes, e.cancels)
        )
        for e in operator.conditional
    )
    instance = exchange_in_atom(operator.instance, *pair) if pair else operator.instance
    return instance, *moved, frozenset(resources), operator.duration, effects
