# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
"""The inner loops of invariant synthesis (`mutex_invariants`): which operators keep at most one
atom of a group true.

Plain Python, compiled with the types in `invariant_loops.pxd`.
"""

from collections.abc import Sequence

from cellwright.engine.kernels.bits import Bits, indices


class Conserving:
    """Operators by number, and the initial state. Operators that differ only in what they need are
    of one kind.

    Each is given by what it needs, always adds, always deletes, and what each of its conditional
    effects adds; two whose conditional effects differ have different `marks`.
    """

    def __init__(
        self,
        needs: list[Bits],
        adds: list[Bits],
        deletes: list[Bits],
        conditional: list[tuple[Bits, ...]],
        marks: Sequence[object],
        initial: Bits,
    ) -> None:
        self._initial, self._needs, self._deletes = initial, needs, deletes
        self._conditional = conditional
        self._adds: list[Bits] = []  # what it can add at all
        self._members: list[list[int]] = []  # per kind its operators
        self._added: list[Bits] = []  # per kind what it always adds and deletes
        self._deleted: list[Bits] = []
        self._adders: dict[int, list[int]] = {}  # per atom the kinds that can add it
        kinds: dict[object, int] = {}
        for number, always in enumerate(adds):
            every = always
            for more in conditional[number]:
                every |= more
            self._adds.append(every)
            kind = kinds.setdefault((always, deletes[number], marks[number]), len(kinds))
            if kind == len(self._members):
                self._members.append([])
                self._added.append(0 if conditional[number] else always)
                self._deleted.append(0 if conditional[number] else deletes[number])
                for atom in indices(every):
                    self._adders.setdefault(atom, []).append(kind)
            self._members[kind].append(number)

    def broken_by(self, group: Bits) -> int | None:
        """An operator that breaks the group, -1 for the initial state; None if the group is an
        invariant.

        A kind is safe if it adds exactly one atom of the group and deletes all others.
        """
        if group & (group - 1) == 0:
            return None
        if (group & self._initial).bit_count() > 1:
            return -1
        best = -1
        kinds = self._adding(group)
        for kind in kinds:
            added = self._added[kind] & group
            if added & (added - 1) or group & ~(added | self._deleted[kind]):
                members = self._members[kind]
                if best >= 0 and members[0] > best:
                    break
                for number in members:
                    if not self._keeps(group, number):
                        best = number if best < 0 else min(best, number)
                        break
        return None if best < 0 else best

    def adding_without_taking(self, group: Bits) -> int:
        """The first operator that adds an atom of the group and needs none of it; -1 if there is
        none.

        What such an operator consumes may belong to the group, too, so it is used to refine the
        candidate.
        """
        best = -1
        for kind in self._adding(group):
            members = self._members[kind]
            if best >= 0 and members[0] > best:
                break
            for number in members:
                if not self._needs[number] & group:
                    best = number if best < 0 else min(best, number)
                    break
        return best

    def _adding(self, group: Bits) -> list[int]:
        """The kinds of operators that add an atom of the group, in the order of their first
        operators.
        """
        found: set[int] = set()
        for atom in indices(group):
            found.update(self._adders.get(atom, ()))
        return sorted(found)

    def _keeps(self, group: Bits, number: int) -> bool:
        """Whether at most one atom of `group` is true after the operator if at most one was
        true before.
        """
        added = self._adds[number] & group
        if not added:
            return True
        required = self._needs[number] & group
        if added & (added - 1):  # fine if it is never applicable
            return not self._conditional[number] and required & (required - 1) != 0
        if required & (self._deletes[number] | added) or required & (required - 1):
            return True
        return group & ~added & ~self._deletes[number] == 0
