"""Several arms in a run: a step is begun only if it meets no other arm, on its way or at rest.

The orders of a plan keep its arms apart as long as they move as planned. An arm may take another way while a run goes on, because
it has met something or stands elsewhere. So each step is looked at once more, before it is sent, beside what all other arms do then.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from cellwright.engine.model.moves import LegKind, MovedStep
from cellwright.engine.pipelines.moves.arms import arms_of
from cellwright.engine.pipelines.moves.hands import Where
from cellwright.engine.pipelines.moves.meetings import Encounters
from cellwright.engine.pipelines.moves.tracks import Moment, Passage, Rider, passages_of
from cellwright.engine.pipelines.moves.walking import Walk, operation_of
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import Cell
from cellwright.kb.terms import Atom, Function


@dataclass(frozen=True, slots=True, eq=False)
class _UnderWay:
    """What the arms of a command do."""

    passages: dict[str, tuple[Passage, ...]]
    rides: bool


@dataclass(eq=False)
class Apart:
    """What is under way in a cell of several arms, by the numbers of commands."""

    encounters: Encounters
    _under_way: dict[int, _UnderWay] = field(default_factory=dict)

    @classmethod
    def of(cls, cell: Cell) -> "Apart | None":
        """Nothing is under way yet; None for a cell with one arm, which meets no other."""
        return cls(Encounters(geometry_backend())) if len(cell.arms) > 1 else None

    def met(self, number: int, moment: Moment, where: Where) -> str:
        """What the arms of a step meet, as the command of that number; empty if nothing, and the step is under way then.

        `where` is where all arms were before it.
        """
        own = _UnderWay(
            {arm: tuple(passages_of(moment, arm, where[arm][0])) for arm in moment.arms},
            moment.moved is not None and any(leg.kind is LegKind.DRIVE for leg in moment.moved.legs),
        )
        for arm in where:
            if arm not in own.passages and (how := self._meets(own, arm, moment, where)):
                return f"{' and '.join(own.passages)} would meet {arm} {how}"
        self._under_way[number] = own
        return ""

    def _meets(self, own: _UnderWay, arm: str, moment: Moment, where: Where) -> str:
        """How a step meets another arm; empty if it does not. An arm that rides is taken to meet one that moves."""
        mine = [each for passages in own.passages.values() for each in passages]
        for other in self._under_way.values():
            if arm in other.passages:
                met = own.rides or other.rides or self._any(mine, other.passages[arm])
                return "on its way" if met else ""
        rest = Passage(Rider(moment.before, arm), where[arm][0][None])
        return "where it stands" if self._any(mine, [rest]) else ""

    def _any(self, mine: Sequence[Passage], theirs: Sequence[Passage]) -> bool:
        return any(self.encounters.meet(one, other) for one in mine for other in theirs)

    def ended(self, number: int) -> None:
        """A command has ended, or was stopped."""
        self._under_way.pop(number, None)


def moment_of(walk: Walk, moved: MovedStep, before: frozenset[Atom], after: frozenset[Atom]) -> Moment:
    """A step with the cell before and after it."""
    arms = arms_of(walk.cell, moved.operator, operation_of(walk.cell, moved.operator))
    return Moment(moved.step, walk.room(before).world, walk.room(after).world, moved, arms)


def going_home(cell: Cell, steps: Iterable[MovedStep]) -> frozenset[Function]:
    """The steps after which an arm goes to where it rests."""
    home = World.of(cell).configurations
    return frozenset(
        each.operator
        for each in steps
        for leg in each.legs[-1:]
        if leg.kind is LegKind.WAY and np.array_equal(leg.path[-1], home[leg.arm])
    )
