"""The section `measuring` of a `cell.yaml`: how tools take the measurements whose position a problem gives."""

import math
from collections.abc import Mapping

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.quantities import ANGLE, FACTOR, LENGTH, Quantities, child, required
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.cell import Body, Measuring, Sight
from cellwright.kb.model.ranging import Ranging


def read_measuring(tool: str, node: Node, read: Quantities, bodies: Mapping[str, Body]) -> Measuring:
    """One entry. Bodies that the cell has not, and features that the tool has not, are reported."""
    approach, field, patch = (child(node, key) for key in ("approach", "field", "patch"))
    touches, tilts = (child(node, key) for key in ("touches", "tilts"))
    sight, ranging = (child(node, key) for key in ("sight", "ranging"))
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
        _sight(tool, sight, read, bodies) if sight else None,
        _ranging(tool, ranging, read, bodies) if ranging else None,
    )


def _sight(tool: str, node: Node, read: Quantities, bodies: Mapping[str, Body]) -> Sight:
    eyes, limits, incidence, back = (child(node, key) for key in ("eyes", "range", "incidence", "back"))
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


LIMITS = {  # of what a laser ranging tool is said to be like: the unit, what is too little, the most, and how it is told
    "view": (ANGLE, 0.0, 2.6, "above 0, up to 149 degrees"),
    "wavelength": (LENGTH, 0.0, 1e3, "above 0, up to 1 km"),
    "noise": (LENGTH, 0.0, 1.0, "above 0, up to 1 m"),
    "at": (LENGTH, 0.0, 1e3, "above 0, up to 1 km"),
    "beam": (ANGLE, 0.0, 0.1, "above 0, up to 0.1 rad"),
    "pointing": (ANGLE, -1e-12, 0.1, "from 0 to 0.1 rad"),
    "grazing": (ANGLE, 0.0, 1.5707, "above 0, below 90 degrees"),
    "dropouts": (FACTOR, -1e-12, 0.9, "from 0 to 0.9"),
}


def _ranging(tool: str, node: Node, read: Quantities, bodies: Mapping[str, Body]) -> Ranging:
    eye, features = required(node, "eye"), bodies[tool].features
    if eye.value not in features:
        read.findings.note(unknown_name(f"feature of {tool}", str(eye.value), features, eye.where))
    width, height = (int(item.value) for item in required(node, "pixels").value)
    said: dict[str, float] = {}
    for key, (kind, above, most, told) in LIMITS.items():
        given = child(node, key)
        if given is None:
            continue
        value = said[key] = read.number(given, kind)
        if not above < value <= most:
            read.findings.add(given.where, "K005", f"this is no {key} of a laser", f"give a value {told}")
    names = {"view": "view_rad", "wavelength": "wavelength_m", "noise": "noise_m", "at": "at_m"}
    names |= {
        "beam": "beam_rad",
        "pointing": "pointing_rad",
        "grazing": "grazing_rad",
        "dropouts": "dropouts",
    }
    given_values = {names[key]: value for key, value in said.items()}
    return Ranging(str(eye.value), width, height, **given_values)
