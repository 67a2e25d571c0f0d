"""The geometric world for a symbolic state: `locations` of the cell put bodies into places and hands."""

from collections.abc import Iterable

import numpy as np

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import Location
from cellwright.kb.terms import Atom, Substitution, Variable, match, substitute


def following(world: World, facts: Iterable[Atom]) -> World:
    """The world with every body where the facts put it.

    Other bodies, and those at places without a pose, stay where they are. If several locations put one body somewhere for a
    fact, the first one in the file counts.
    """
    for fact in sorted(facts, key=str):
        world = _after(world, fact)
    return world


def _after(world: World, fact: Atom) -> World:
    done: set[str] = set()
    for location in world.cell.locations:
        bindings = match(location.fact, fact, {})
        if bindings is None:
            continue
        body = str(substitute(location.body, bindings))
        if body in world.cell.bodies and body not in done:
            world = _put(world, body, location, bindings)
        done.add(body)
    return world


def _put(world: World, body: str, location: Location, bindings: Substitution) -> World:
    if location.value is not None:
        return world.guided(body, location.value) if world.cell.bodies[body].guide else world
    at = _grip_at(world, location, bindings)
    if at is None:
        return world
    frame, T_frame_grip = at
    by = f"{body}.{location.by}"
    T_body_grip = world.pose(body, by) if location.by and by in world.placed else world.grip(body)
    return world.put(body, frame, matmul(T_frame_grip, transforms.inverse(T_body_grip)))


def _grip_at(world: World, location: Location, bindings: Substitution) -> tuple[str, Floats] | None:
    """The frame that the body stands on, and the pose of its grip in it; None for an unknown place."""
    if location.place is None:
        return _frame(location.frame, bindings), np.eye(4)
    place = world.cell.places.get(str(substitute(location.place, bindings)))
    if place is None:
        return None
    return place.placement.parent, transforms.of_pose(place.placement.pose)


def _frame(name: str, bindings: Substitution) -> str:
    """The name of a frame with a variable in its first part replaced."""
    first, dot, rest = name.partition(".")
    return f"{substitute(Variable(first), bindings)}{dot}{rest}"
