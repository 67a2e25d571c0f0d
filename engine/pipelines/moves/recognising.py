"""Which facts put a body that a cell knows where it was seen."""

from collections.abc import Collection, Iterator

import numpy as np

from cellwright.engine.pipelines.moves.seen import Seen
from cellwright.engine.stages.geometry.world.following import following
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.asp import ground_term
from cellwright.kb.model.cell import Cell, Location
from cellwright.kb.terms import Atom, Function, is_ground, match, substitute

NEAR_M = 0.03  # a body so near to a place is there


def at_places(cell: Cell, seen: Seen) -> tuple[Atom, ...]:
    """The facts that put a body within `NEAR_M` of where it was seen, the nearest first; none if it lies beside all places."""
    there, found = seen.T_world[:3, 3], list[tuple[float, str, Atom]]()
    for location in cell.locations:
        for fact in _instances(cell, location, seen.name):
            world = following(World.of(cell), (fact,))
            off = float(np.linalg.norm(world.pose("world", seen.name)[:3, 3] - there))
            found += [(off, str(fact), fact)] if off <= NEAR_M else []
    return tuple(fact for *_, fact in sorted(found, key=lambda each: each[:2]))


def _instances(cell: Cell, location: Location, body: str) -> Iterator[Atom]:
    """The facts of one location that put a body at some place of the cell."""
    bindings = match(location.body, Function(body), {})
    if bindings is None or location.place is None:
        return
    for name in cell.places:
        place = ground_term(name)
        more = match(location.place, place, dict(bindings))
        fact = None if more is None else substitute(location.fact, more)
        if isinstance(fact, Function) and is_ground(fact):
            yield fact


def putting(cell: Cell, facts: Collection[Atom], bodies: Collection[str]) -> tuple[Atom, ...]:
    """Those of the facts that put some bodies where they are."""
    found = []
    for fact in sorted(facts, key=str):
        for location in cell.locations:
            bindings = match(location.fact, fact, {})
            if bindings is not None and str(substitute(location.body, bindings)) in bodies:
                found.append(fact)
                break
    return tuple(found)
