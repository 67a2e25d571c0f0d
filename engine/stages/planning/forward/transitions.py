# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Successors of packed states, and how new a state is.

Plain Python, compiled with the types in `transitions.pxd`. A packed state has `width` bytes of
atoms (atom i is bit i % 8 of byte i // 8), then the values of quantities with 8 bytes each. Derived
atoms are among the atoms.
"""

from array import array
from collections.abc import Sequence

from cellwright.engine.kernels.axioms import Upkeep
from cellwright.engine.kernels.packed_rows import PackedRows, zero_ints, zero_longs
from cellwright.engine.kernels.sums import Comparisons, Repetitions

LARGEST = 1 << 50  # a state with a greater value has no successor
TABLE = 1 << 16  # a power of 2


class Changes:
    """What operators do to quantities: operator o makes the changes
    `of.items[of.starts[o]:of.starts[o + 1]]`.

    Change c sets the quantity `targets[c]` to a constant plus the sum of `factors[p]` times the
    quantity `sources[p]` over the parts p in `parts`. `touched` has for each operator the
    comparisons that may become true or false.
    """

    def __init__(
        self,
        of: PackedRows,
        targets: Sequence[int],
        constants: Sequence[int],
        parts: PackedRows,
        sources: Sequence[int],
        factors: Sequence[int],
        touched: PackedRows,
    ) -> None:
        self.of, self.parts, self.touched = of, parts, touched
        self.targets, self.sources = array("i", targets), array("i", sources)
        self.constants, self.factors = array("q", constants), array("q", factors)


class Transitions:
    """The states to which operators lead.

    Effect e of operator o is in `of.items[of.starts[o]:of.starts[o + 1]]`: where all atoms of
    `conditions` are in the state before, it deletes `deletes` and adds `adds`, but not what a
    `cancels` of the step names. Derived atoms are looked at again after an operator that `closes`.
    """

    def __init__(
        self,
        width: int,
        needs: PackedRows,
        of: PackedRows,
        conditions: PackedRows,
        adds: PackedRows,
        deletes: PackedRows,
        cancels: PackedRows,
        changes: Changes,
        comparisons: Comparisons | None,
        upkeep: Upkeep | None,
        closes: Sequence[bool],
    ) -> None:
        self.width, self.closes = width, array("i", closes)
        self.needs, self.of, self.conditions = needs, of, conditions
        self.adds, self.deletes, self.cancels, self.changes = adds, deletes, cancels, changes
        self.comparisons, self.upkeep = comparisons, upkeep
        self.stamps, self.turn = zero_ints(8 * width), 0
        self.done = 0

    def after(self, state: bytes, operator: int, times: int) -> bytes:
        """The state after an operator that is applicable, repeated as often as `times`, or until it
        is not applicable: see `done`.

        It is empty if a value becomes too large.
        """
        found = bytearray(state)
        row = found
        self.done = 0
        while self.done < times and self._applicable(operator, row):
            before = bytes(found)
            self._apply(operator, before, row)
            if not self._change(operator, before, found):
                return b""
            if self.upkeep is not None and self.closes[operator]:
                self.upkeep.complete(row)
            self.done += 1
        return bytes(found)

    def _applicable(self, operator: int, state: bytearray) -> bool:
        for place in range(self.needs.starts[operator], self.needs.starts[operator + 1]):
            atom = self.needs.items[place]
            if not state[atom >> 3] >> (atom & 7) & 1:
                return False
        return True

    def _fires(self, effect: int, before: bytes) -> bool:
        for place in range(self.conditions.starts[effect], self.conditions.starts[effect + 1]):
            atom = self.conditions.items[place]
            if not before[atom >> 3] >> (atom & 7) & 1:
                return False
        return True

    def _apply(self, operator: int, before: bytes, found: bytearray) -> None:
        """Deletes what the effects delete that fire, then adds what they add."""
        self.turn += 1
        for index in range(self.of.starts[operator], self.of.starts[operator + 1]):
            if self._fires(self.of.items[index], before):
                self._delete(self.of.items[index], found)
        for index in range(self.of.starts[operator], self.of.starts[operator + 1]):
            if self._fires(self.of.items[index], before):
                self._add(self.of.items[index], found)

    def _delete(self, effect: int, found: bytearray) -> None:
        for place in range(self.deletes.starts[effect], self.deletes.starts[effect + 1]):
            atom = self.deletes.items[place]
            found[atom >> 3] &= 255 ^ (1 << (atom & 7))
        for place in range(self.cancels.starts[effect], self.cancels.starts[effect + 1]):
            self.stamps[self.cancels.items[place]] = self.turn

    def _add(self, effect: int, found: bytearray) -> None:
        for place in range(self.adds.starts[effect], self.adds.starts[effect + 1]):
            atom = self.adds.items[place]
            if self.stamps[atom] != self.turn:
                found[atom >> 3] |= 1 << (atom & 7)

    def _change(self, operator: int, before: bytes, found: bytearray) -> bool:
        """Changes quantities, and looks at the comparisons again that this touches.

        Returns whether all values are small enough.
        """
        first, last = self.changes.of.starts[operator], self.changes.of.starts[operator + 1]
        if first == last:
            return True
        row = found
        old, new = (
            memoryview(before)[self.width :].cast("q"),
            memoryview(found)[self.width :].cast("q"),
        )
        for index in range(first, last):
            change = self.changes.of.items[index]
            total = self.changes.constants[change]
            for place in range(
                self.changes.parts.starts[change], self.changes.parts.starts[change + 1]
            ):
                part = self.changes.parts.items[place]
                total += self.changes.factors[part] * old[self.changes.sources[part]]
            if total > LARGEST or total < -LARGEST:
                return False
            new[self.changes.targets[change]] = total
        if self.comparisons is not None:
            for index in range(
                self.changes.touched.starts[operator], self.changes.touched.starts[operator + 1]
            ):
                self.comparisons.look(self.changes.touched.items[index], new, row)
        return True


class Dominance:
    """Which of two states is at least as good: they have the same fluents, and of `resources` the
    better one has no less.

    `signs` are 1 where more of a quantity is better, -1 where less is, and 0 where the states must
    have the same. `fluents` is a row of bytes: the atoms that are not derived.
    """

    def __init__(self, fluents: bytes, signs: Sequence[int]) -> None:
        self.width, self.count = len(fluents), len(signs)
        self.fluents, self.signs = array("B", fluents), array("i", signs)
        self.resources = sum(map(abs, signs))

    def rest(self, state: bytes) -> bytes:
        """What two states must have in common."""
        found = bytearray(state)
        row = found
        for place in range(self.width):
            row[place] &= self.fluents[place]
        for number in range(self.count):
            if self.signs[number]:
                for place in range(self.width + 8 * number, self.width + 8 * number + 8):
                    row[place] = 0
        return bytes(found)

    def dominated(self, state: bytes, front: "array[int]") -> bool:
        """Whether one of the states in `front` is at least as good as a state with the same rest.

        If not, it is appended.
        """
        values = memoryview(state)[self.width :].cast("q")
        own = zero_longs(self.resources)
        view, place = own, 0
        size = len(front)
        for number in range(self.count):
            if self.signs[number]:
                view[place] = self.signs[number] * values[number]
                place += 1
        row = front if size else own
        start = 0
        while start < size:
            place = 0
            while place < self.resources and row[start + place] >= view[place]:
                place += 1
            if place == self.resources:
                return True
            start += self.resources
        del row
        front.extend(own)
        return False


class Novelty:
    """How new states are, among those with no greater estimate: by the atoms and values that they
    have.

    The first value is how many of them no state with so small an estimate had, negated. If there is
    none, it is how many were met with a smaller estimate (Chen & Thiebaux 2024, after Katz,
    Lipovetzky, Moshkovich & Tuisov 2017). Values share a table, so that two of them may be taken
    for one.
    """

    def __init__(self, width: int, quantities: int) -> None:
        self.width, self.quantities = width, quantities
        self.atoms, self.values = zero_longs(8 * width), zero_longs(TABLE)
        for index in range(8 * width):
            self.atoms[index] = LARGEST
        for index in range(TABLE):
            self.values[index] = LARGEST

    def rank(self, state: bytes, estimate: int) -> int:
        """The rank of a state, which then counts as met: the newer the smaller."""
        new = worse = 0
        row = state
        for atom in range(8 * self.width):
            if row[atom >> 3] >> (atom & 7) & 1:
                best = self.atoms[atom]
                if estimate < best:
                    self.atoms[atom] = estimate
                    new += 1
                elif estimate > best:
                    worse += 1
        numbers = memoryview(state)[self.width :].cast("q")
        for number in range(self.quantities):
            place = ((numbers[number] * 2654435761 + number * 40503) & 0xFFFFFFFF) >> 7 & (
                TABLE - 1
            )
            best = self.values[place]
            if estimate < best:
                self.values[place] = estimate
                new += 1
            elif estimate > best:
                worse += 1
        return -new if new else worse


class Distance:
    """How many steps goals take, each by itself: a comparison as many as its best operator has to
    be repeated, any other goal one.

    `repetitions` from `starts[g]` to `starts[g + 1]` lead to goal g, at a cost of 1 for each step;
    without any there is nothing to repeat.
    """

    def __init__(
        self,
        width: int,
        goals: Sequence[int],
        repetitions: Repetitions | None,
        starts: Sequence[int],
    ) -> None:
        self.width, self.count, self.repetitions = width, len(goals), repetitions
        self.goals, self.starts = array("i", goals), array("i", starts)

    def of(self, state: bytes) -> int:
        """The steps that are left in a packed state."""
        total, row = 0, state
        if self.repetitions is not None:
            found = self.repetitions.needed(memoryview(state)[self.width :].cast("q"))
        for goal in range(self.count):
            atom = self.goals[goal]
            if row[atom >> 3] >> (atom & 7) & 1:
                continue
            least = LARGEST if self.starts[goal] < self.starts[goal + 1] else 1
            for place in range(self.starts[goal], self.starts[goal + 1]):
                least = min(least, found[place])
            total += least
        return total
