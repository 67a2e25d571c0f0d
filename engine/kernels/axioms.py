# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False, initializedcheck=False
"""The derived atoms of a state, layer by layer: the least fixpoint of the rules of a layer, then what is not in it.

Plain Python, compiled with the types in `axioms.pxd`. A state is a row of bytes, in which atom i is bit `i % 8` of byte
`i // 8`. Each rule counts the conditions that are still missing, so that each is looked at once (Dowling & Gallier 1984).
"""

from array import array
from collections.abc import Sequence

from engine.kernels.rows import rows


class Closure:
    """The derived atoms that follow from the fluents of a state.

    Rule r makes `heads[r]` true where all atoms in `bodies[r]` are; `layers[r]` counts from 0 and never falls. `negated` has
    (atom, complementary atom) for each layer. `derived` are all derived atoms and their complementary atoms; `size` is the
    number of atoms. After `close`, `by[atom]` is the rule that made a derived atom true.
    """

    def __init__(
        self,
        size: int,
        heads: Sequence[int],
        bodies: Sequence[Sequence[int]],
        layers: Sequence[int],
        negated: Sequence[Sequence[tuple[int, int]]],
        derived: Sequence[int],
    ) -> None:
        self.rules, self.depth = len(heads), len(negated)
        self.heads, self.layers = array("i", heads), array("i", layers)
        self.needed, self.derived = array("i", map(len, bodies)), array("i", derived)
        users: list[list[int]] = [[] for _ in range(size)]
        for rule, body in enumerate(bodies):
            for atom in body:
                users[atom].append(rule)
        self.user_starts, self.user_items = rows(users)
        self.atom_starts, self.atom_items = rows([[atom for atom, _ in pairs] for pairs in negated])
        _, self.other_items = rows([[other for _, other in pairs] for pairs in negated])
        own = set(derived)
        self.watched = array("i", [atom for atom in range(size) if users[atom] and atom not in own])
        self.missing, self.by = array("i", bytes(4 * self.rules)), array("i", bytes(4 * size))
        self.queue, self.first, self.last = array("i", bytes(4 * (size + 1))), 0, 0

    def close(self, state: bytes) -> bytes:
        """The state with exactly those derived atoms that follow from its fluents."""
        after = bytearray(state)
        self.complete(after)
        return bytes(after)

    def complete(self, after: bytearray) -> None:
        """Gives a state exactly those derived atoms that follow from its fluents."""
        self._begin(after)
        rule = 0
        for layer in range(self.depth):
            while rule < self.rules and self.layers[rule] == layer:
                if self.missing[rule] == 0:
                    self._fire(rule, after)
                rule += 1
            self._spread(layer, after)
            self._negate(layer, after)

    def _begin(self, after: bytearray) -> None:
        """Takes all derived atoms out, and puts the fluents that rules read in the queue."""
        for place in range(len(self.derived)):
            atom = self.derived[place]
            after[atom >> 3] &= 255 ^ (1 << (atom & 7))
        self.first = self.last = 0
        for rule in range(self.rules):
            self.missing[rule] = self.needed[rule]
        for place in range(len(self.watched)):
            atom = self.watched[place]
            if after[atom >> 3] >> (atom & 7) & 1:
                self._note(atom)

    def _negate(self, layer: int, after: bytearray) -> None:
        """Makes the complementary atoms true of what a finished layer has left out."""
        for place in range(self.atom_starts[layer], self.atom_starts[layer + 1]):
            atom = self.atom_items[place]
            if not after[atom >> 3] >> (atom & 7) & 1:
                other = self.other_items[place]
                after[other >> 3] |= 1 << (other & 7)
                self._note(other)

    def _note(self, atom: int) -> None:
        """Puts an atom that became true in the queue."""
        self.queue[self.last] = atom
        self.last += 1

    def _fire(self, rule: int, after: bytearray) -> None:
        """Makes the head of a rule true."""
        head = self.heads[rule]
        if not after[head >> 3] >> (head & 7) & 1:
            after[head >> 3] |= 1 << (head & 7)
            self.by[head] = rule
            self._note(head)

    def _spread(self, layer: int, after: bytearray) -> None:
        """Counts what became true, and fires the rules of a layer that miss nothing more."""
        while self.first < self.last:
            atom = self.queue[self.first]
            self.first += 1
            for place in range(self.user_starts[atom], self.user_starts[atom + 1]):
                rule = self.user_items[place]
                self.missing[rule] -= 1
                if self.missing[rule] == 0 and self.layers[rule] == layer:
                    self._fire(rule, after)
