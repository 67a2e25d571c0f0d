"""The section `measuring` of a `cell.yaml`: how tools take the measurements whose position a problem gives."""

import math
from collections.abc import Mapping

from kb.diagnostics import unknown_name
from kb.loader.quantities import ANGLE, Quantities, child
from kb.loader.tree import Node
from kb.model.cell import Body, Measuring, Sight


def read_measuring(tool: str, node: Node, read: Quantities, bodies: Mapping[str, Body]) -> Measuring:
    """One entry. Bodies that the cell has not, and features that the tool has not, are reported."""
    approach, field, patch = (child(node, key) for key in ("approach", "field", "patch"))
    touches, tilts, sight = (child(node, key) for key in ("touches", "tilts", "sight"))
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
