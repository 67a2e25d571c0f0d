"""The sections `measuring` and `sensors` of a cell: how tools measure and sensors read."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.geometry_values import ANGLE, FACTOR, LENGTH, QuantityReader
from cellwright.kb.loader.yaml_tree import YamlNode, child_at, mapping_members, required_child
from cellwright.kb.model.cell_model import (
    Body,
    JointKind,
    Measuring,
    Ranging,
    Sensing,
    Sensor,
    Sight,
)


def read_measuring(
    tool: str, node: YamlNode, read: QuantityReader, bodies: Mapping[str, Body]
) -> Measuring:
    """One entry. Bodies that the cell has not, and features that the tool has not, are reported."""
    approach, field, patch = (child_at(node, key) for key in ("approach", "field", "patch"))
    touches, tilts = (child_at(node, key) for key in ("touches", "tilts"))
    sight, ranging = (child_at(node, key) for key in ("sight", "ranging"))
    for item in touches.value if touches else []:
        if item.value not in bodies:
            read.findings.note(unknown_name("body", item.value, bodies, item.where))
    sides = [read.positive(item) for item in patch.value] if patch else [0.0, 0.0]
    return Measuring(
        read.number(approach) if approach else 0.0,
        tuple(item.value for item in touches.value) if touches else (),
        tuple(read.number(item, ANGLE) for item in tilts.value) if tilts else (0.0,),
        read.number(field) if field else 0.0,
        (sides[0], sides[1]),
        _read_sight(tool, sight, read, bodies) if sight else None,
        _read_ranging(tool, ranging, read, bodies) if ranging else None,
    )


def _read_sight(
    tool: str, node: YamlNode, read: QuantityReader, bodies: Mapping[str, Body]
) -> Sight:
    eyes, limits, incidence, back = (
        child_at(node, key) for key in ("eyes", "range", "incidence", "back")
    )
    features = bodies[tool].features
    for item in eyes.value if eyes else []:
        if item.value not in features:
            read.findings.note(unknown_name(f"feature of {tool}", item.value, features, item.where))
    least, most = (read.number(item) for item in limits.value) if limits else (0.0, 0.0)
    if limits and not 0.0 <= least < most:
        hint = "write the least and the greatest distance, such as [0.35, 0.6]"
        read.findings.add(limits.where, "K005", f"{tool} sees nothing in this range", hint)
    angle = read.number(incidence, ANGLE) if incidence else math.pi / 2
    if incidence and not 0.0 < angle <= math.pi / 2:
        hint = "give an angle above 0, up to 90 degrees"
        read.findings.add(incidence.where, "K005", f"{tool} sees nothing at this incidence", hint)
    names = tuple(item.value for item in eyes.value) if eyes else ()
    return Sight(names, (least, most), angle, read.number(back) if back else 0.0)


# of what a laser ranging tool is said to be like: the unit, what is too little, the most, and how
# it is told
RANGING_LIMITS = {
    "view": (ANGLE, 0.0, 2.6, "above 0, up to 149 degrees"),
    "wavelength": (LENGTH, 0.0, 1e3, "above 0, up to 1 km"),
    "noise": (LENGTH, 0.0, 1.0, "above 0, up to 1 m"),
    "at": (LENGTH, 0.0, 1e3, "above 0, up to 1 km"),
    "beam": (ANGLE, 0.0, 0.1, "above 0, up to 0.1 rad"),
    "pointing": (ANGLE, -1e-12, 0.1, "from 0 to 0.1 rad"),
    "grazing": (ANGLE, 0.0, 1.5707, "above 0, below 90 degrees"),
    "dropouts": (FACTOR, -1e-12, 0.9, "from 0 to 0.9"),
}


def _read_ranging(
    tool: str, node: YamlNode, read: QuantityReader, bodies: Mapping[str, Body]
) -> Ranging:
    eye, features = required_child(node, "eye"), bodies[tool].features
    if eye.value not in features:
        read.findings.note(unknown_name(f"feature of {tool}", str(eye.value), features, eye.where))
    width, height = (int(item.value) for item in required_child(node, "pixels").value)
    values: dict[str, float] = {}
    for key, (kind, above, most, allowed) in RANGING_LIMITS.items():
        value_node = child_at(node, key)
        if value_node is None:
            continue
        value = values[key] = read.number(value_node, kind)
        if not above < value <= most:
            read.findings.add(
                value_node.where, "K005", f"this is no {key} of a laser", f"give a value {allowed}"
            )
    names = {"view": "view_rad", "wavelength": "wavelength_m", "noise": "noise_m", "at": "at_m"}
    names |= {
        "beam": "beam_rad",
        "pointing": "pointing_rad",
        "grazing": "grazing_rad",
        "dropouts": "dropouts",
    }
    given_values = {names[key]: value for key, value in values.items()}
    return Ranging(str(eye.value), width, height, **given_values)


@dataclass(frozen=True)
class SensedNames:
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


def read_sensor(node: YamlNode, read: QuantityReader, known: SensedNames) -> Sensor | None:
    """One entry; None if it is reported."""
    sensings = [
        (sort, sensed_node)
        for sort in Sensing
        if (sensed_node := child_at(node, sort.value)) is not None
    ]
    if len(sensings) != 1:
        kinds = ", ".join(sort.value for sort in Sensing)
        read.findings.add(node.where, "K005", "a sensor reads one thing", f"give one of {kinds}")
        return None
    sensing, of = sensings[0]
    if of.value not in known.names(sensing):
        kind = {Sensing.JOINT: "body with a joint", Sensing.LOAD: "arm", Sensing.DISTANCE: "frame"}
        read.findings.note(
            unknown_name(kind.get(sensing, "body"), str(of.value), known.names(sensing), of.where)
        )
        return None
    unit = _reading_unit(sensing, known.bodies.get(str(of.value)))
    readings = {
        name: _reading_range(item, read, unit)
        for name, _, item in mapping_members(required_child(node, "readings"))
    }
    tells = {name: str(item.value) for name, key, item in mapping_members(child_at(node, "tells"))}
    for name, key, _ in mapping_members(child_at(node, "tells")):
        if name not in readings:
            read.findings.note(unknown_name("reading", name, readings, key.where))
    return Sensor(sensing, str(of.value), readings, tells)


def _reading_unit(sensing: Sensing, body: Body | None) -> str:
    if sensing in (Sensing.FORCE, Sensing.LOAD):
        return FACTOR
    swings = body is not None and body.guide is not None and body.guide.kind is JointKind.REVOLUTE
    return ANGLE if sensing is Sensing.JOINT and swings else LENGTH


def _reading_range(node: YamlNode, read: QuantityReader, unit: str) -> tuple[float, float]:
    lower, upper = (read.number(item, unit) for item in node.value)
    if lower > upper:
        read.findings.add(
            node.where, "K707", "the range of the reading is empty", "write the lesser value first"
        )
    return lower, upper
