"""States that are no better than others: the same, but with less of something of which more is always better."""

from array import array
from collections.abc import Iterator, Sequence

from cellwright.engine.model.axioms import Axioms
from cellwright.engine.model.quantities import Comparing, Level
from cellwright.engine.model.task import Bits, GroundOperator
from cellwright.engine.stages.planning.forward.space import Space
from cellwright.engine.stages.planning.forward.transitions import Dominance

RISING, FALLING = (">", ">="), ("<", "<=")


def resources(operators: Sequence[GroundOperator], goals: Bits, axioms: Axioms) -> dict[Level, int]:
    """The quantities of which more is always better (1), or less (-1).

    They are only compared by preconditions and goals, all in the same direction, and change by constants.
    """
    wanted, forbidden = _compared(operators, goals, axioms)
    found: dict[Level, int] = {}
    wrong = {level for test in forbidden for level, _ in test.sum.parts} | set(_entangled(operators))
    for test, rises in wanted:
        for level, factor in test.sum.parts:
            sign = 1 if (factor > 0) == rises else -1
            if found.setdefault(level, sign) != sign:
                wrong.add(level)
    return {level: sign for level, sign in found.items() if level not in wrong}


def _compared(
    operators: Sequence[GroundOperator], goals: Bits, axioms: Axioms
) -> tuple[list[tuple[Comparing, bool]], list[Comparing]]:
    """The comparisons that shall hold, each with whether it asks for a great sum, and those about which nothing can be said."""
    needed, read = goals, axioms.read_by_rules
    for operator in operators:
        needed |= operator.preconditions
        for effect in operator.conditional:
            read |= effect.condition
    wanted: list[tuple[Comparing, bool]] = []
    forbidden: list[Comparing] = []
    for test in axioms.tests:
        other = axioms.complements.get(test.atom)
        own = 1 << test.atom | (0 if other is None else 1 << other)
        if own & read or (own & needed and test.relation in ("=", "!=")):
            forbidden.append(test)
        if needed >> test.atom & 1:
            wanted.append((test, test.relation in RISING))
        if other is not None and needed >> other & 1:
            wanted.append((test, test.relation in FALLING))
    return wanted, forbidden


def _entangled(operators: Sequence[GroundOperator]) -> Iterator[Level]:
    """The quantities whose value another one depends on, or their own in another way than by a constant more or less."""
    for operator in operators:
        for change in operator.changes:
            own = change.to.without(change.level).parts
            if own:
                yield change.level
            yield from (level for level, _ in change.to.parts if level is not change.level)


class Fronts:
    """The best states met, in groups that differ only in resources. Without resources, every state that was met."""

    def __init__(self, dominance: Dominance) -> None:
        self._dominance = dominance
        self._seen: set[bytes] = set()
        self._fronts: dict[bytes, array[int]] = {}

    def met(self, state: bytes) -> bool:
        """Whether a state that is at least as good was met; if not, this one counts as met from now on."""
        if state in self._seen:
            return True
        self._seen.add(state)
        if not self._dominance.resources:
            return False
        front = self._fronts.setdefault(self._dominance.rest(state), array("q"))
        return self._dominance.dominated(state, front)


def fronts(operators: Sequence[GroundOperator], goals: Bits, axioms: Axioms | None, space: Space) -> Fronts:
    """Nothing is met yet."""
    if axioms is None or not axioms.tests:
        return Fronts(Dominance(bytes([255]) * space.width, []))
    known = {level.number: sign for level, sign in resources(operators, goals, axioms).items()}
    fluents = (1 << 8 * space.width) - 1 & ~axioms.derived
    signs = [known.get(number, 0) for number in range(space.quantities)]
    return Fronts(Dominance(fluents.to_bytes(space.width, "little"), signs))
