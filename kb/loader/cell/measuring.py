"""The section `measuring` of a `cell.yaml`: how tools take the measurements whose position a problem gives."""

from collections.abc import Collection

from kb.diagnostics import unknown_name
from kb.loader.quantities import ANGLE, Quantities, child
from kb.loader.tree import Node
from kb.model.cell import Measuring


def read_measuring(node: Node, read: Quantities, bodies: Collection[str]) -> Measuring:
    """One entry. Bodies that the cell has not are reported."""
    approach, field, patch = (child(node, key) for key in ("approach", "field", "patch"))
    touches, tilts = child(node, "touches"), child(node, "tilts")
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
    )
