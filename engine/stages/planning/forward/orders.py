"""Reasonable orders of landmarks: which of two is better reached first, since the other would have to be given up for it.

If a goal is false whenever another landmark is reached, or just before, the goal is of no use earlier: it would be given up, and reached
once more (Hoffmann, Porteous & Sebastia 2004; Richter & Westphal 2010). Unlike there, any landmark may come before a goal, not only
another goal: so a block stays free for as long as another block beneath it is wanted. Orders can contradict one another; one
that would close a circle is left out.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from cellwright.engine.model.task import Bits, indices
from cellwright.engine.stages.planning.forward.achievers import Achievers


class Reached(NamedTuple):
    """What is known of the moment in which a landmark is reached first, or again if it is true from the start.

    `needed` are atoms that are true just before, `together` those that are true then.
    """

    needed: Bits
    together: Bits


def reached(achievers: Achievers, initial: Bits, landmarks: Bits) -> dict[int, Reached]:
    """What all operators share that can reach a landmark first, or again if it is true from the start."""
    found = {}
    for atom in indices(landmarks):
        needed = together = -1
        for operator in achievers.of(1 << atom) if initial >> atom & 1 else achievers.first(1 << atom):
            needed &= operator.preconditions
            together &= operator.adds | operator.preconditions & ~operator.deletes
        found[atom] = Reached(needed, together) if needed >= 0 else Reached(0, 1 << atom)
    return found


def ordered(
    goals: Bits, before: Mapping[int, Bits], moments: Mapping[int, Reached], groups: Sequence[Bits]
) -> dict[int, Bits]:
    """For each landmark those that shall be reached before it. `before` has those that must."""
    found = dict(before)
    for later, earlier in interfering(goals, moments, groups):
        add(found, earlier, later)
    return found


def interfering(
    goals: Bits, moments: Mapping[int, Reached], groups: Sequence[Bits]
) -> Iterator[tuple[int, int]]:
    """Pairs of a goal and a landmark for which the goal has to be given up; first those of two goals."""
    excluded = _excluded(groups)
    conflicts = {}
    for atom, moment in moments.items():
        conflicts[atom] = 0
        for other in indices(moment.needed | moment.together):
            conflicts[atom] |= excluded.get(other, 0)
    for earlier in sorted(moments, key=lambda each: not goals >> each & 1):
        for later in indices(conflicts[earlier] & goals & ~(1 << earlier)):
            yield later, earlier


def _excluded(groups: Sequence[Bits]) -> dict[int, Bits]:
    """For each atom those that are never true with it."""
    found: dict[int, Bits] = {}
    for group in groups:
        for atom in indices(group):
            found[atom] = found.get(atom, 0) | group & ~(1 << atom)
    return found


def add(found: dict[int, Bits], earlier: int, later: int) -> None:
    """One more order, and those that follow from it; nothing if it is known, or would close a circle."""
    if (found[earlier] >> later | found[later] >> earlier) & 1:
        return
    more = found[earlier] | 1 << earlier
    for each, known in found.items():
        if each == later or known >> later & 1:
            found[each] = known | more
