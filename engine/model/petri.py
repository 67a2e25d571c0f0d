"""Petri nets as they are exchanged (ISO/IEC 15909): place/transition nets, and symmetric nets with one class of tokens."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class PetriPlace:
    """A place. `marking` lists the tokens at the start; in a place/transition net `count` is their number.

    `notes` are what only this engine reads: template, capacities.
    """

    id: str
    name: str
    count: int = 0
    marking: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PetriTransition:
    """A transition. `variables` gives the type of each variable of its arcs; its guard demands them."""

    id: str
    name: str
    variables: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PetriArc:
    """An arc. It moves `count` tokens or, in a symmetric net, those that its `variables` are bound to."""

    id: str
    source: str
    target: str
    count: int = 1
    variables: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PetriNet:
    """A net; `types` parts the class of tokens of a symmetric net, and is empty for a place/transition net."""

    id: str
    places: tuple[PetriPlace, ...]
    transitions: tuple[PetriTransition, ...]
    arcs: tuple[PetriArc, ...]
    types: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def coloured(self) -> bool:
        """Whether it is a symmetric net."""
        return bool(self.types)
