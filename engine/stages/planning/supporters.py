# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""The best supporter of each atom from one state: the cheapest operator that adds it when deletes
are ignored.

They come from one Dijkstra search over additive costs. The module is plain Python; like
`kernels.py` it can be compiled, with the types in `supporters.pxd`. A state is a row of bytes, in
which atom i is bit `i % 8` of byte `i // 8`.
"""

from array import array
from collections.abc import Sequence

from cellwright.engine.kernels.packed_rows import pack_rows

UNREACHED = 1 << 50
MOST = 1 << 38  # additive costs are cut off here, because they can double with every step


class Supporters:
    """Operators that only add, with positive charges.

    `need` and `add` have a list of atoms for each operator, `users` has the operators that need
    each atom.
    """

    def __init__(
        self,
        charges: Sequence[int],
        need: Sequence[Sequence[int]],
        add: Sequence[Sequence[int]],
        users: Sequence[Sequence[int]],
    ) -> None:
        self.atoms, self.operators = len(users), len(charges)
        self.charges, self.needed = array("q", charges), array("i", map(len, need))
        self.add_starts, self.add_items = pack_rows(add)
        self.user_starts, self.user_items = pack_rows(users)
        self.reached, self.depths = _longs(self.atoms), _longs(self.atoms)
        self.supporter = array("i", bytes(4 * self.atoms))
        self.spent, self.ends = _longs(self.operators), _longs(self.operators)
        self.missing = array("i", bytes(4 * self.operators))
        self.queue, self.size = _longs(self.atoms + len(self.add_items)), 0

    def spread(self, state: bytes, bound: int) -> list[int]:
        """The best supporter of each atom; -1 if it has none, and for the atoms of the state.

        A supporter counts only if the charges of a chain of supporters up to it are at most
        `bound`. Among equally good supporters the one whose conditions are settled first is taken;
        atoms are settled in the order of their cost, then of their number.
        """
        self._begin(state, bound)
        while self.size > 0:
            entry = self._pop()
            cost, atom = entry // self.atoms, entry % self.atoms
            if cost == self.reached[atom]:
                self._settle(atom, cost, bound)
        return [self.supporter[atom] for atom in range(self.atoms)]

    def _begin(self, state: bytes, bound: int) -> None:
        """Starts with the state's atoms and with the operators that need nothing."""
        self.size = 0
        for atom in range(self.atoms):
            self.reached[atom], self.supporter[atom], self.depths[atom] = UNREACHED, -1, 0
            if state[atom >> 3] >> (atom & 7) & 1:
                self.reached[atom] = 0
                self._push(atom)
        for operator in range(self.operators):
            self.missing[operator] = self.needed[operator]
            self.spent[operator] = self.ends[operator] = self.charges[operator]
            if self.missing[operator] == 0:
                self._offer(operator, bound)

    def _settle(self, atom: int, cost: int, bound: int) -> None:
        """Counts an atom for the operators that need it.

        An operator that misses no other atom offers what it adds.
        """
        for place in range(self.user_starts[atom], self.user_starts[atom + 1]):
            operator = self.user_items[place]
            self.missing[operator] -= 1
            self.spent[operator] += cost
            self.ends[operator] = max(
                self.ends[operator], self.depths[atom] + self.charges[operator]
            )
            if self.missing[operator] == 0:
                self._offer(operator, bound)

    def _offer(self, operator: int, bound: int) -> None:
        """Notes the operator as supporter of the atoms that it adds more cheaply than known so
        far.
        """
        if self.ends[operator] > bound:
            return
        cost = min(self.spent[operator], MOST)
        for place in range(self.add_starts[operator], self.add_starts[operator + 1]):
            atom = self.add_items[place]
            if cost < self.reached[atom]:
                self.reached[atom], self.supporter[atom], self.depths[atom] = (
                    cost,
                    operator,
                    self.ends[operator],
                )
                self._push(cost * self.atoms + atom)

    def _push(self, entry: int) -> None:
        """Puts an entry (cost * atoms + atom) into the queue, which is a binary heap."""
        place = self.size
        self.size += 1
        while place > 0 and self.queue[(place - 1) // 2] > entry:
            self.queue[place] = self.queue[(place - 1) // 2]
            place = (place - 1) // 2
        self.queue[place] = entry

    def _pop(self) -> int:
        """Takes the first entry out of the queue."""
        first = self.queue[0]
        self.size -= 1
        last = self.queue[self.size]
        place, child = 0, 1
        while child < self.size:
            if child + 1 < self.size and self.queue[child + 1] < self.queue[child]:
                child += 1
            if last <= self.queue[child]:
                break
            self.queue[place] = self.queue[child]
            place, child = child, 2 * child + 1
        self.queue[place] = last
        return first


def _longs(length: int) -> "array[int]":
    """An array of zeros, 64 bits each."""
    return array("q", bytes(8 * length))
