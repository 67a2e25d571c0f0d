"""The section `places` of a `cell.yaml`: the pose of an arm's tool point for each place of the domain."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.cell.frames import Frames, read_placement
from cellwright.kb.loader.quantities import Quantities, child
from cellwright.kb.loader.reader import Reader
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.cell import TOUCH_M, Body, Place, Placement
from cellwright.kb.terms import Function


@dataclass(frozen=True, slots=True)
class Mentioned:
    """What a place may name: frames, arms and bodies."""

    frames: Frames
    arms: Collection[str]
    bodies: Mapping[str, Body]


def read_places(reader: Reader, read: Quantities, mentioned: Mentioned) -> dict[str, Place]:
    """The places by name. What they name and the cell has not is reported."""
    places = _each(reader, read, mentioned)
    return {place.name: place for place in places}


def _each(reader: Reader, read: Quantities, mentioned: Mentioned) -> Iterator[Place]:
    for _, key, node in reader.entries("places"):
        expression = reader.parse("term", key)
        term = expression.value if expression else None
        name = str(term) if isinstance(term, Function) else str(key.value)
        yield _place(name, key, node, read, mentioned)


def _place(name: str, key: Node, node: Node, read: Quantities, mentioned: Mentioned) -> Place:
    placement = read_placement(node, read)
    mentioned.frames.is_known(placement)
    approach, turns, depth = child(node, "approach"), child(node, "turns"), child(node, "depth")
    touches = child(node, "touches")
    touched = touches.value if touches else []
    for item in touched:
        if item.value not in mentioned.bodies:
            read.findings.note(unknown_name("body", item.value, mentioned.bodies, item.where))
    return Place(
        name,
        Placement(placement.parent, placement.pose, key.where),
        _arm(key, node, read, mentioned.arms),
        _tool(node, read, mentioned.bodies),
        read.number(approach) if approach else 0.0,
        turns is not None and turns.value == "true",
        tuple(item.value for item in touched),
        read.number(depth) if depth else TOUCH_M,
    )


def _arm(key: Node, node: Node, read: Quantities, arms: Collection[str]) -> str:
    given = child(node, "arm")
    if given is not None:
        if given.value not in arms:
            read.findings.note(unknown_name("arm", given.value, arms, given.where))
        return str(given.value)
    if len(arms) != 1:
        read.findings.add(key.where, "K005", "the arm for this place is not given", "give `arm`")
        return ""
    return next(iter(arms))


def _tool(node: Node, read: Quantities, bodies: Mapping[str, Body]) -> str:
    given = child(node, "tool")
    if given is None:
        return ""
    is_tool(str(given.value), given, read, bodies)
    return str(given.value)


def is_tool(name: str, at: Node, read: Quantities, bodies: Mapping[str, Body]) -> bool:
    """Whether a body is a tool with a tip; another one is reported."""
    tools = {each for each, body in bodies.items() if "tip" in body.features}
    if name not in tools:
        read.findings.note(unknown_name("tool with a `tip`", name, tools, at.where))
    return name in tools
