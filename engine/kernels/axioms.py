# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False
"""Derived atoms of a state: the least fixpoint of the axioms of each layer, one layer after
another.

Plain Python, compiled with the types in `axioms.pxd`. A state is a row of bytes, in which atom i is
bit `i % 8` of byte `i // 8`. Each rule counts the conditions that are still missing, so that each
is looked at once (Dowling & Gallier 1984).
"""

from array import array
from collections.abc import Sequence

from cellwright.engine.kernels.packed_rows import pack_rows


class Closure:
    """The derived atoms that follow from the fluents of a state.

    Rule r makes `heads[r]` true where all atoms in `bodies[r]` are; `layers[r]` counts from 0 and
    never falls. `negated` has (atom, complementary atom) for each layer. `derived` are all derived
    atoms and their complementary atoms; `size` is the number of atoms. After `close`, `by[atom]` is
    the rule that made a derived atom true.
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
        self.user_starts, self.user_items = pack_rows(users)
        self.atom_starts, self.atom_items = pack_rows(
            [[atom for atom, _ in pairs] for pairs in negated]
        )
        _, self.other_items = pack_rows([[other for _, other in pairs] for pairs in negated])
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


class Upkeep:
    """The derived atoms of one state after another: only what follows from changed fluents is
    looked at again.

    Takes what `Closure` takes. The last state is kept; the next one may be any. In a layer without
    recursion an atom is true while some rule misses nothing; a layer with recursion is computed
    anew where one of its rules begins or ceases to hold.
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
        closure = Closure(size, heads, bodies, layers, negated, derived)
        self.depth, self.width = len(negated), (size + 7) // 8
        self.heads, self.layers = array("i", heads), array("i", layers)
        users: list[list[int]] = [[] for _ in range(size)]
        own: list[dict[int, None]] = [{} for _ in negated]
        for rule, body in enumerate(bodies):
            own[layers[rule]][heads[rule]] = None
            for atom in body:
                users[atom].append(rule)
        self.user_starts, self.user_items = pack_rows(users)
        self.head_starts, self.head_items = pack_rows([list(each) for each in own])
        self.atom_starts, self.atom_items = pack_rows(
            [[atom for atom, _ in pairs] for pairs in negated]
        )
        _, self.other_items = pack_rows([[other for _, other in pairs] for pairs in negated])
        recursive = {
            layer
            for layer, body in zip(layers, bodies, strict=True)
            if any(a in own[layer] for a in body)
        }
        self.recursive = array("i", [layer in recursive for layer in range(self.depth)])
        self.dirty = array("i", bytes(4 * self.depth))
        hidden = set(derived)
        self.watched = array(
            "i", [atom for atom in range(size) if users[atom] and atom not in hidden]
        )
        self.mask = bytearray(self.width)
        for atom in derived:
            self.mask[atom >> 3] |= 1 << (atom & 7)
        self.known = bytearray(closure.close(bytes(self.width)))
        true = [self.known[atom >> 3] >> (atom & 7) & 1 for atom in range(size)]
        self.missing = array("i", [sum(not true[atom] for atom in body) for body in bodies])
        self.reasons = array("i", bytes(4 * size))
        for rule, head in enumerate(heads):
            self.reasons[head] += self.missing[rule] == 0
        self.queue, self.last, self.current = array("i", bytes(4 * (size + len(heads) + 1))), 0, -1

    def complete(self, after: bytearray) -> None:
        """Gives a state exactly those derived atoms that follow from its fluents."""
        for place in range(len(self.watched)):
            atom = self.watched[place]
            if (after[atom >> 3] ^ self.known[atom >> 3]) >> (atom & 7) & 1:
                self._flip(atom)
        for layer in range(self.depth):
            if self.dirty[layer]:
                self._settle(layer)
        for place in range(self.width):
            after[place] = (
                after[place] & (255 ^ self.mask[place]) | self.known[place] & self.mask[place]
            )

    def _holds(self, atom: int) -> bool:
        return (self.known[atom >> 3] >> (atom & 7) & 1) != 0

    def _flip(self, atom: int) -> None:
        """Makes an atom true that was false, or the reverse, and counts what its rules miss."""
        self.known[atom >> 3] ^= 1 << (atom & 7)
        true = self._holds(atom)
        for place in range(self.user_starts[atom], self.user_starts[atom + 1]):
            rule = self.user_items[place]
            met = self.missing[rule] == 0
            self.missing[rule] += -1 if true else 1
            if met != (self.missing[rule] == 0):
                self.reasons[self.heads[rule]] += -1 if met else 1
                self.dirty[self.layers[rule]] = 1
                if not met and self.layers[rule] == self.current:
                    self._note(self.heads[rule])

    def _note(self, atom: int) -> None:
        """Puts an atom that has become true in the queue."""
        self.queue[self.last] = atom
        self.last += 1

    def _settle(self, layer: int) -> None:
        """Makes the atoms of a layer true or false, then the complementary ones."""
        for place in range(self.head_starts[layer], self.head_starts[layer + 1]):
            atom = self.head_items[place]
            if (
                self._holds(atom)
                if self.recursive[layer]
                else self._holds(atom) != (self.reasons[atom] > 0)
            ):
                self._flip(atom)
        if self.recursive[layer]:
            self._spread(layer)
        self.dirty[layer] = 0
        for place in range(self.atom_starts[layer], self.atom_starts[layer + 1]):
            if self._holds(self.atom_items[place]) == self._holds(self.other_items[place]):
                self._flip(self.other_items[place])

    def _spread(self, layer: int) -> None:
        """The least fixpoint of a layer whose atoms are all false."""
        self.last, self.current = 0, layer
        for place in range(self.head_starts[layer], self.head_starts[layer + 1]):
            if self.reasons[self.head_items[place]] > 0:
                self._note(self.head_items[place])
        first = 0
        while first < self.last:
            atom = self.queue[first]
            first += 1
            if not self._holds(atom):
                self._flip(atom)
        self.current = -1
