"""Places that hold one object at a time, and which of them are interchangeable.

One block makes an atom such as `free(slot)` false, and a later block of the same object makes it true again.
This is a hold of the place, and the order in which objects use the place in the plan need not be kept. Places
that can be exchanged in the whole task are one resource together.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.model.shop import Hold, Moment
from cellwright.engine.model.task import Bits, GroundOperator, Task, bitset, indices
from cellwright.engine.stages.scheduling.blocks import mentions
from cellwright.kb.terms import Function, Term


@dataclass(frozen=True, slots=True)
class Touch:
    """A step of a stage needs, ends or makes an atom. `begin` and `end` count from the start of the stage."""

    stage: str
    job: str
    begin: int
    end: int
    needs: bool
    ends: bool
    makes: bool

    @property
    def first(self) -> Moment:
        """When the step starts."""
        return Moment(self.stage, self.begin)

    @property
    def last(self) -> Moment:
        """When the step ends."""
        return Moment(self.stage, self.end)


def holds_of(resource: str, touches: Sequence[Touch], initially: bool) -> list[Hold] | None:
    """The holds of a place, from what touches its atom `free`; None if the atom is about no such place.

    Each object must give back what it has taken before it takes it again. An object that gives a place back
    without having taken it was there from the start.
    """
    jobs: dict[str, list[Touch]] = {}
    for touch in touches:
        jobs.setdefault(touch.job, []).append(touch)
    found: list[Hold] = []
    for each in jobs.values():
        own = _holds_of_one(resource, each)
        if own is None:
            return None
        found += own
    from_start = sum(hold.begin is None for hold in found)
    return found if from_start <= (0 if initially else 1) else None


def _holds_of_one(resource: str, touches: Sequence[Touch]) -> list[Hold] | None:
    """The same for one object. A step that only needs the place to be free takes it while the step lasts."""
    found: list[Hold] = []
    taker: Touch | None = None
    for touch in touches:
        if touch.ends:
            if taker is not None or not touch.needs:
                return None
            taker = touch
        elif touch.makes:
            if taker is None and found:
                return None
            found.append(Hold(resource, taker.first if taker else None, touch.last))
            taker = None
        elif taker is None:
            found.append(Hold(resource, touch.first, touch.last))
        else:
            return None
    return [*found, Hold(resource, taker.first, None)] if taker else found


@dataclass(frozen=True)
class Exchange:
    """Finds which terms of a task can be exchanged without changing the task."""

    task: Task
    goals: Bits

    @cached_property
    def _index(self) -> dict[Function, int]:
        return {atom: number for number, atom in enumerate(self.task.atoms)}

    @cached_property
    def _operators(self) -> set[object]:
        return {_key(each) for each in self.task.operators}

    def alike(self, atom: Function) -> tuple[Function, ...]:
        """The atoms such as `free(place)` whose places can be exchanged with that of `atom`; `atom` is first."""
        number = self._index[atom]
        if len(atom.arguments) != 1 or not self.task.initial >> number & 1:
            return (atom,)
        others = [each for each in self.task.atoms if each.name == atom.name and each != atom]
        return (atom, *(each for each in others if self._exchangeable(atom.arguments[0], each.arguments[0])))

    def _exchangeable(self, one: Term, other: Term) -> bool:
        if not isinstance(one, Function) or not isinstance(other, Function) or one.name != other.name:
            return False
        if one.arguments[:-1] != other.arguments[:-1] or len(one.arguments) != len(other.arguments):
            return False
        swap = self._swap(one, other)
        if swap is None or _moved(self.task.initial, swap) != self.task.initial:
            return False
        if _moved(self.goals, swap) != self.goals:
            return False
        return all(
            _key(each, swap, (one, other)) in self._operators
            for each in self.task.operators
            if touches(each, swap) or mentions(each.instance, one) or mentions(each.instance, other)
        )

    def _swap(self, one: Term, other: Term) -> dict[int, int] | None:
        """What each atom with one of the terms becomes when they are exchanged; None if one is missing."""
        found: dict[int, int] = {}
        for number, atom in enumerate(self.task.atoms):
            if mentions(atom, one) or mentions(atom, other):
                image = self._index.get(exchanged(atom, one, other))
                if image is None:
                    return None
                found[number] = image
        return found


def touches(operator: GroundOperator, swap: dict[int, int]) -> bool:
    """Whether an operator has any atom of a swap."""
    return bool((operator.preconditions | operator.adds | operator.deletes) & bitset(list(swap)))


def exchanged(term: Function, one: Term, other: Term) -> Function:
    """A term in which two of its parts are exchanged."""
    return Function(term.name, tuple(_exchanged(each, one, other) for each in term.arguments))


def _exchanged(term: Term, one: Term, other: Term) -> Term:
    if term in (one, other):
        return other if term == one else one
    return exchanged(term, one, other) if isinstance(term, Function) and term.arguments else term


def _moved(bits: Bits, swap: dict[int, int]) -> Bits:
    found = bits
    for number in swap:
        found &= ~(1 << number)
    return found | bitset([swap[number] for number in indices(bits) if number in swap])


def _key(
    operator: GroundOperator, swap: dict[int, int] | None = None, pair: tuple[Term, Term] | None = None
) -> object:
    """What identifies a ground operator, after an exchange of atoms and terms."""
    sets: Iterator[Bits] = iter((operator.preconditions, operator.adds, operator.deletes))
    moved = tuple(_moved(each, swap) if swap else each for each in sets)
    resources = tuple(_exchanged(r, *pair) if pair else r for r in operator.resources)
    effects = tuple(
        tuple(_moved(b, swap) if swap else b for b in (e.condition, e.adds, e.deletes, e.cancels))
        for e in operator.conditional
    )
    instance = exchanged(operator.instance, *pair) if pair else operator.instance
    return instance, *moved, frozenset(resources), operator.duration, effects
