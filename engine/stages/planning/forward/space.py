"""The states of a task, packed for compiled kernels."""

from collections.abc import Iterable, Sequence
from itertools import accumulate

from cellwright.engine.model.axioms import Axioms
from cellwright.engine.model.quantities import Assignment, Level
from cellwright.engine.model.task import Bits, ConditionalEffect, GroundOperator, indices
from cellwright.engine.stages.planning.effort import OutOfRange
from cellwright.engine.stages.planning.forward.kernels import Rows
from cellwright.engine.stages.planning.forward.transitions import Changes, Transitions


class Space:
    """The packed states of a task over atoms below `size`, and its operators.

    Quantities that no comparison depends on, such as a sum of costs, keep the value that they have at the start. So two states
    that differ only in them are one.
    """

    def __init__(self, operators: Sequence[GroundOperator], size: int, axioms: Axioms | None) -> None:
        tests = axioms.tests if axioms is not None else ()
        self._axioms = axioms if tests else None
        self._mask = (1 << self._axioms.size) - 1 if self._axioms else -1
        self.quantities = len(self._axioms.values(0)) if self._axioms else 0
        self.width = (size + 63) // 64 * 8
        matters = _compared(operators, axioms)
        changes = [tuple(each for each in o.changes if each.level in matters) for o in operators]
        effects = [(ConditionalEffect(0, o.adds, o.deletes), *o.conditional) for o in operators]
        closes = [
            axioms is not None and bool(axioms.rules) and bool(made or _moved(own) & axioms.read)
            for own, made in zip(effects, changes, strict=True)
        ]
        flat = [effect for own in effects for effect in own]
        self._transitions = Transitions(
            self.width,
            Rows([indices(o.preconditions) for o in operators]),
            _consecutive(effects),
            Rows([indices(each.condition) for each in flat]),
            Rows([indices(each.adds) for each in flat]),
            Rows([indices(each.deletes) for each in flat]),
            Rows([indices(each.cancels) for each in flat]),
            _packed(changes, axioms),
            self._axioms.comparisons if self._axioms else None,
            axioms.upkeep() if axioms is not None and axioms.rules else None,
            closes,
        )

    def packed(self, state: Bits) -> bytes:
        """A closed state as a row of bytes."""
        atoms = (state & self._mask).to_bytes(self.width, "little")
        return atoms if self._axioms is None else atoms + self._axioms.values(state).tobytes()

    def atoms(self, state: bytes) -> Bits:
        """The atoms in a packed state."""
        return int.from_bytes(state[: self.width], "little")

    def values(self, state: bytes) -> "memoryview[int]":
        """The values of quantities in a packed state."""
        return memoryview(state)[self.width :].cast("q")

    def after(self, state: bytes, operator: int, times: int = 1) -> tuple[bytes, int]:
        """The state after an operator, done as often as `times` or until it is not applicable, and how often it was done.

        Raises `OutOfRange`.
        """
        found = self._transitions.after(state, operator, times)
        if not found:
            raise OutOfRange("the values of quantities get too large for the search")
        return found, self._transitions.done


def _moved(effects: Iterable[ConditionalEffect]) -> Bits:
    found = 0
    for each in effects:
        found |= each.adds | each.deletes
    return found


def _consecutive(lists: Sequence[Sequence[object]]) -> Rows:
    """The places of the items of each list in a row of all items."""
    ends = list(accumulate(map(len, lists)))
    return Rows([range(end - len(each), end) for each, end in zip(lists, ends, strict=True)])


def _compared(operators: Sequence[GroundOperator], axioms: Axioms | None) -> set[Level]:
    """The quantities that are compared, and those that they may get their values from."""
    found = {level for each in (axioms.tests if axioms else ()) for level, _ in each.sum.parts}
    changes = dict.fromkeys(change for operator in operators for change in operator.changes)
    before = -1
    while before != len(found):
        before = len(found)
        found |= {level for each in changes if each.level in found for level, _ in each.to.parts}
    return found


def _packed(changes: Sequence[tuple[Assignment, ...]], axioms: Axioms | None) -> Changes:
    """The changes of all operators, and which comparisons they touch."""
    flat = [change for own in changes for change in own]
    tests = axioms.tests if axioms is not None else ()
    reading: dict[Level, list[int]] = {}
    for place, each in enumerate(tests):
        for level, _ in each.sum.parts:
            reading.setdefault(level, []).append(place)
    touched = [sorted({place for each in own for place in reading.get(each.level, ())}) for own in changes]
    return Changes(
        _consecutive(changes),
        [each.level.number for each in flat],
        [each.to.constant for each in flat],
        _consecutive([each.to.parts for each in flat]),
        [level.number for each in flat for level, _ in each.to.parts],
        [factor for each in flat for _, factor in each.to.parts],
        Rows(touched),
    )
