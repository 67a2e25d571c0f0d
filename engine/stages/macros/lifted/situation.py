"""A situation: a state of a world. Plans are looked up, learned, revised and executed from situations."""

from collections.abc import Iterable
from dataclasses import dataclass

from cellwright.engine.stages.macros.lifted.facts import Facts
from cellwright.engine.stages.macros.lifted.world import CellDomain
from cellwright.kb.terms import Atom, ordered


@dataclass(frozen=True, slots=True)
class Situation:
    """A state of a world.

    The situation after a step shares everything that the step does not touch, so it is cheap.
    """

    world: CellDomain
    facts: Facts

    @classmethod
    def of(cls, world: CellDomain, state: Iterable[Atom]) -> "Situation":
        """The situation of a state. The atoms are sorted, so that results repeat."""
        return cls(world, Facts(ordered(state)))

    @property
    def state(self) -> frozenset[Atom]:
        """The atoms that are true."""
        return self.facts.atoms()
