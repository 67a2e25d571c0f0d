"""The section `sensors` of a `cell.yaml`: what the sensors of the domain read in the physical cell."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.quantities import ANGLE, FACTOR, LENGTH, Quantities, child, members, required
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.cell import Body, JointKind
from cellwright.kb.model.sensors import Sensing, Sensor


@dataclass(frozen=True)
class Sensed:
    """What a sensor can read something of."""

    bodies: Mapping[str, Body]
    arms: Collection[str]
    frames: Collection[str]

    def names(self, sensing: Sensing) -> Collection[str]:
        """The bodies, arms or frames that a kind of sensor reads something of."""
        match sensing:
            case Sensing.JOINT:
                return [name for name, body in self.bodies.items() if body.guide is not None]
            case Sensing.LOAD:
                return self.arms
            case Sensing.DISTANCE:
                return self.frames
            case _:
                return self.bodies


def read_sensor(node: Node, read: Quantities, known: Sensed) -> Sensor | None:
    """One entry; None if it is reported."""
    given = [(each, found) for each in Sensing if (found := child(node, each.value)) is not None]
    if len(given) != 1:
        kinds = ", ".join(each.value for each in Sensing)
        read.findings.add(node.where, "K005", "a sensor reads one thing", f"give one of {kinds}")
        return None
    sensing, of = given[0]
    if of.value not in known.names(sensing):
        kind = {Sensing.JOINT: "body with a joint", Sensing.LOAD: "arm", Sensing.DISTANCE: "frame"}
        read.findings.note(
            unknown_name(kind.get(sensing, "body"), str(of.value), known.names(sensing), of.where)
        )
        return None
    unit = _unit(sensing, known.bodies.get(str(of.value)))
    readings = {name: _range(item, read, unit) for name, _, item in members(required(node, "readings"))}
    tells = {name: str(item.value) for name, key, item in members(child(node, "tells"))}
    for name, key, _ in members(child(node, "tells")):
        if name not in readings:
            read.findings.note(unknown_name("reading", name, readings, key.where))
    return Sensor(sensing, str(of.value), readings, tells)


def _unit(sensing: Sensing, body: Body | None) -> str:
    if sensing in (Sensing.FORCE, Sensing.LOAD):
        return FACTOR
    swings = body is not None and body.guide is not None and body.guide.kind is JointKind.REVOLUTE
    return ANGLE if sensing is Sensing.JOINT and swings else LENGTH


def _range(node: Node, read: Quantities, unit: str) -> tuple[float, float]:
    lower, upper = (read.number(item, unit) for item in node.value)
    if lower > upper:
        read.findings.add(
            node.where, "K707", "the range of the reading is empty", "write the lesser value first"
        )
    return lower, upper
