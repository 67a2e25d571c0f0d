"""Where one is: a state of a world, from which plans are looked up, learned, revised and executed."""

from collections.abc import Iterable
from dataclasses import dataclass

from engine.stages.macros.lifted.facts import Facts
from engine.stages.macros.lifted.world import CellDomain
from kb.terms import Atom, ordered


@dataclass(frozen=True, slots=True)
class Situation:
    """A state of a world. Successors share what a step does not touch, so that moving on is cheap."""

    world: CellDomain
    facts: Facts

    @classmethod
    def of(cls, world: CellDomain, state: Iterable[Atom]) -> "Situation":
        """The situation of a state, in an order that repeats."""
        return cls(world, Facts(ordered(state)))

    @property
    def state(self) -> frozenset[Atom]:
        """The true atoms."""
        return self.facts.atoms()
