"""Landmarks that are one of several atoms: each way to a landmark begins with one of them.

If every operator that can reach a landmark first needs an atom of the same predicate ("some rover has analysed the rock"), one of these
atoms comes before it. So it is with what comes before them in turn (Porteous & Cresswell 2002; Richter & Westphal 2010). Where an
atom of the set is true from the start, or is a landmark by itself, the set says nothing.
"""

from collections import deque
from collections.abc import Iterator, Sequence

from cellwright.engine.model.task import Bits, indices
from cellwright.engine.stages.planning.forward.achievers import Achievers
from cellwright.kb.terms import Atom, Function

WIDEST = 100  # atoms in a set
MOST = 2_000  # sets


def kinds_of(atoms: Sequence[Atom]) -> list[int]:
    """A number for the predicate of each atom; complements have another one."""
    numbers: dict[tuple[str, ...], int] = {}
    return [numbers.setdefault(_kind(atom), len(numbers)) for atom in atoms]


def _kind(atom: Atom) -> tuple[str, ...]:
    inner = atom.arguments[0] if atom.name == "not" and len(atom.arguments) == 1 else None
    return ("not", inner.name) if isinstance(inner, Function) else (atom.name,)


class Disjunctions:
    """The sets of atoms that come before some landmarks. Set n has the number `first` + n, behind those of all atoms.

    `orders` are pairs of a set and what it comes just before: a landmark, or another set. Only atoms with one of the `kinds` are in
    sets.
    """

    def __init__(
        self, achievers: Achievers, landmarks: Bits, said_nothing: Bits, kinds: Sequence[int]
    ) -> None:
        self._achievers, self._kinds = achievers, kinds
        self._trivial = landmarks | said_nothing
        self.first = len(achievers.landmarks)
        self.sets: list[Bits] = []
        self.orders: list[tuple[int, int]] = []
        waiting = deque((1 << atom, atom) for atom in indices(landmarks & ~said_nothing))
        numbers: dict[Bits, int] = {}
        while waiting:
            atoms, later = waiting.popleft()
            for earlier in self._just_before(atoms):
                if earlier not in numbers and len(numbers) < MOST:
                    numbers[earlier] = self.first + len(self.sets)
                    self.sets.append(earlier)
                    waiting.append((earlier, numbers[earlier]))
                if numbers.get(earlier, later) != later:
                    self.orders.append((numbers[earlier], later))

    def _just_before(self, atoms: Bits) -> Iterator[Bits]:
        """The sets of atoms of one predicate, one of which every operator needs that can reach some atoms first."""
        shared: dict[int, Bits] | None = None
        for operator in self._achievers.first(atoms):
            own = self._by_kind(operator.preconditions)
            known = own if shared is None else shared
            shared = {kind: found | own[kind] for kind, found in known.items() if kind in own}
            if not shared:
                return
        for found in (shared or {}).values():
            if 2 <= found.bit_count() <= WIDEST and not found & self._trivial:
                yield found

    def _by_kind(self, atoms: Bits) -> dict[int, Bits]:
        found: dict[int, Bits] = {}
        for atom in indices(atoms):
            if atom < len(self._kinds):
                found[self._kinds[atom]] = found.get(self._kinds[atom], 0) | 1 << atom
        return found
