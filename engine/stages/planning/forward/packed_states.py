"""States of a task, packed for compiled kernels, and which of them are no better than others."""

from array import array
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.kernels.packed_rows import PackedRows
from cellwright.engine.model.ground_axioms import (
    Axioms,
    Comparing,
    QuantityAssignment,
    QuantityLevel,
)
from cellwright.engine.model.ground_task import ConditionalEffect, GroundOperator
from cellwright.engine.stages.planning.forward.transitions import Changes, Dominance, Transitions
from cellwright.engine.stages.planning.search_control import NO_PLAN, OutOfRange, SearchResult


class PackedSpace:
    """The packed states of a task over atoms below `size`, and its operators.

    Quantities that no comparison depends on, such as a sum of costs, keep the value that they have
    at the start. So two states that differ only in them are one.
    """

    def __init__(
        self, operators: Sequence[GroundOperator], size: int, axioms: Axioms | None
    ) -> None:
        tests = axioms.tests if axioms is not None else ()
        self._axioms = axioms if tests else None
        self._mask = (1 << self._axioms.size) - 1 if self._axioms else -1
        self.quantities = len(self._axioms.values(0)) if self._axioms else 0
        self.width, self._left_out = (size + 63) // 64 * 8, False
        matters = _relevant_levels(operators, axioms)
        changes = [
            tuple(change for change in o.changes if change.level in matters) for o in operators
        ]
        effects = [(ConditionalEffect(0, o.adds, o.deletes), *o.conditional) for o in operators]
        closes = [
            axioms is not None
            and bool(axioms.rules)
            and bool(changed or _moved_atoms(own) & axioms.read)
            for own, changed in zip(effects, changes, strict=True)
        ]
        flat = [effect for own in effects for effect in own]
        self._transitions = Transitions(
            self.width,
            PackedRows([indices(o.preconditions) for o in operators]),
            _consecutive_rows(effects),
            PackedRows([indices(effect.condition) for effect in flat]),
            PackedRows([indices(effect.adds) for effect in flat]),
            PackedRows([indices(effect.deletes) for effect in flat]),
            PackedRows([indices(effect.cancels) for effect in flat]),
            _pack_changes(changes, axioms),
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
        """The state after an operator, done as often as `times` or until it is not applicable, and
        how often it was done.

        It is empty if a value gets too large for the search: such a state is left out.
        """
        next_state = self._transitions.after(state, operator, times)
        self._left_out = self._left_out or not next_state
        return next_state, self._transitions.done

    def exhausted(self) -> SearchResult:
        """The answer of a search that has followed every state: there is no plan.

        Raises `OutOfRange` if states were left out.
        """
        if self._left_out:
            raise OutOfRange("there is no plan with values that are small enough for the search")
        return NO_PLAN


def _moved_atoms(effects: Iterable[ConditionalEffect]) -> Bits:
    moved = 0
    for effect in effects:
        moved |= effect.adds | effect.deletes
    return moved


def _consecutive_rows(lists: Sequence[Sequence[object]]) -> PackedRows:
    """The places of the items of each list in a row of all items."""
    ends = list(accumulate(map(len, lists)))
    return PackedRows(
        [range(end - len(items), end) for items, end in zip(lists, ends, strict=True)]
    )


def _relevant_levels(
    operators: Sequence[GroundOperator], axioms: Axioms | None
) -> set[QuantityLevel]:
    """The quantities that are compared, and those that they may get their values from."""
    levels = {level for test in (axioms.tests if axioms else ()) for level, _ in test.sum.parts}
    changes = dict.fromkeys(change for operator in operators for change in operator.changes)
    before = -1
    while before != len(levels):
        before = len(levels)
        levels |= {
            level for change in changes if change.level in levels for level, _ in change.to.parts
        }
    return levels


def _pack_changes(
    changes: Sequence[tuple[QuantityAssignment, ...]], axioms: Axioms | None
) -> Changes:
    """The changes of all operators, and which comparisons they touch."""
    flat = [change for own in changes for change in own]
    tests = axioms.tests if axioms is not None else ()
    reading: dict[QuantityLevel, list[int]] = {}
    for place, test in enumerate(tests):
        for level, _ in test.sum.parts:
            reading.setdefault(level, []).append(place)
    touched = [
        sorted({place for change in own for place in reading.get(change.level, ())})
        for own in changes
    ]
    return Changes(
        _consecutive_rows(changes),
        [change.level.number for change in flat],
        [change.to.constant for change in flat],
        _consecutive_rows([change.to.parts for change in flat]),
        [level.number for change in flat for level, _ in change.to.parts],
        [factor for change in flat for _, factor in change.to.parts],
        PackedRows(touched),
    )


RISING, FALLING = (">", ">="), ("<", "<=")


def monotone_quantities(
    operators: Sequence[GroundOperator], goals: Bits, axioms: Axioms
) -> dict[QuantityLevel, int]:
    """The quantities of which more is always better (1), or less (-1).

    They are only compared by preconditions and goals, all in the same direction, and change by
    constants.
    """
    desired, forbidden = _classify_comparisons(operators, goals, axioms)
    directions: dict[QuantityLevel, int] = {}
    wrong = {level for test in forbidden for level, _ in test.sum.parts} | set(
        _entangled_levels(operators)
    )
    for test, rises in desired:
        for level, factor in test.sum.parts:
            sign = 1 if (factor > 0) == rises else -1
            if directions.setdefault(level, sign) != sign:
                wrong.add(level)
    return {level: sign for level, sign in directions.items() if level not in wrong}


def _classify_comparisons(
    operators: Sequence[GroundOperator], goals: Bits, axioms: Axioms
) -> tuple[list[tuple[Comparing, bool]], list[Comparing]]:
    """The comparisons that shall hold, each with whether it asks for a great sum, and those
    about which nothing can be said.
    """
    needed, read = goals, axioms.read_by_rules
    for operator in operators:
        needed |= operator.preconditions
        for effect in operator.conditional:
            read |= effect.condition
    desired: list[tuple[Comparing, bool]] = []
    forbidden: list[Comparing] = []
    for test in axioms.tests:
        complement = axioms.complements.get(test.atom)
        own = 1 << test.atom | (0 if complement is None else 1 << complement)
        if own & read or (own & needed and test.relation in ("=", "!=")):
            forbidden.append(test)
        if needed >> test.atom & 1:
            desired.append((test, test.relation in RISING))
        if complement is not None and needed >> complement & 1:
            desired.append((test, test.relation in FALLING))
    return desired, forbidden


def _entangled_levels(operators: Sequence[GroundOperator]) -> Iterator[QuantityLevel]:
    """The quantities whose value another one depends on, or their own in another way than by a
    constant more or less.
    """
    for operator in operators:
        for change in operator.changes:
            own = change.to.without(change.level).parts
            if own:
                yield change.level
            yield from (level for level, _ in change.to.parts if level is not change.level)


class ParetoFronts:
    """The best states met, in groups that differ only in resources.

    Without resources, every state that was met.
    """

    def __init__(self, dominance: Dominance) -> None:
        self._dominance = dominance
        self._seen: set[bytes] = set()
        self._fronts: dict[bytes, array[int]] = {}

    def met(self, state: bytes) -> bool:
        """Whether a state that is at least as good was met; if not, this one counts as met from
        now on.
        """
        if state in self._seen:
            return True
        self._seen.add(state)
        if not self._dominance.resources:
            return False
        front = self._fronts.setdefault(self._dominance.rest(state), array("q"))
        return self._dominance.dominated(state, front)


def make_fronts(
    operators: Sequence[GroundOperator], goals: Bits, axioms: Axioms | None, space: PackedSpace
) -> ParetoFronts:
    """Nothing is met yet."""
    if axioms is None or not axioms.tests:
        return ParetoFronts(Dominance(bytes([255]) * space.width, []))
    directions = {
        level.number: sign for level, sign in monotone_quantities(operators, goals, axioms).items()
    }
    fluents = (1 << 8 * space.width) - 1 & ~axioms.derived
    signs = [directions.get(number, 0) for number in range(space.quantities)]
    return ParetoFronts(Dominance(fluents.to_bytes(space.width, "little"), signs))
