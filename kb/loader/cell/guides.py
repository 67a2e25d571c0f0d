"""How the bodies of a `cell.yaml` move on what they stand on, and what they weigh."""

from cellwright.kb.loader.quantities import ANGLE, FACTOR, LENGTH, Quantities, child, required
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.cell import Guide, JointKind
from cellwright.kb.model.shapes import Vector

KILOGRAMS = {"": 1.0, "kg": 1.0, "g": 0.001}


def read_guide(node: Node | None, read: Quantities) -> Guide | None:
    """The guide of a body; None if none is given, or one that is reported."""
    if node is None:
        return None
    slides, swings = child(node, "slides"), child(node, "swings")
    axis = slides if slides is not None else swings
    if axis is None or (slides is None) == (swings is None):
        read.findings.add(node.where, "K005", "a joint slides or swings", "give one of `slides` and `swings`")
        return None
    kind = JointKind.PRISMATIC if slides is not None else JointKind.REVOLUTE
    unit = LENGTH if slides is not None else ANGLE
    lower, upper = (read.number(item, unit) for item in required(node, "range").value)
    if lower > upper:
        read.findings.add(
            node.where, "K707", "the range of the joint is empty", "write the lesser value first"
        )
    follows = child(node, "follows")
    return Guide(kind, _unit_vector(axis, read), lower, upper, follows.value if follows else "")


def _unit_vector(node: Node, read: Quantities) -> Vector:
    x, y, z = (read.number(item, FACTOR) for item in node.value)
    length = (x * x + y * y + z * z) ** 0.5
    if length < 1e-9:
        read.findings.add(node.where, "K707", "this direction has no length", "write [0, 0, 1] for z")
        return (0.0, 0.0, 1.0)
    return (x / length, y / length, z / length)


def read_plain(node: Node | None) -> float | None:
    """A mass in kg, or a number without a unit; None if none is given."""
    if node is None:
        return None
    number = str(node.value).rstrip("kg ")
    return float(number) * KILOGRAMS[str(node.value)[len(number) :].strip()]
