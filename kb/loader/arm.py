"""Arms from files with a Denavit-Hartenberg table and the shapes of the links. Bundled arms are in `kb/arms`."""

import math
from pathlib import Path

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.quantities import ANGLE, Quantities, child
from cellwright.kb.loader.reader import Findings, Reader, require, validate_shape
from cellwright.kb.loader.tree import Node, read_file
from cellwright.kb.model.cell import Arm, Joint, Link
from cellwright.kb.model.shapes import Pose

BUNDLED = Path(__file__).parents[1] / "arms"


def bundled_arms() -> dict[str, Path]:
    """The arms that come with the engine, by name."""
    return {path.stem: path for path in sorted(BUNDLED.glob("*.yaml"))}


def load_arm(path: Path) -> Arm:
    """The arm in a file. Raises `InvalidInput` with all errors."""
    findings = Findings()
    arm = read_arm(path, findings)
    require(findings)
    return arm


def read_arm(path: Path, findings: Findings) -> Arm:
    """The arm in a file. Errors are added to `findings`. Raises `InvalidInput` if the file does not have the form of an arm."""
    reader = Reader.of(read_file(path), findings)
    if not validate_shape(reader, "arm"):
        require(findings)
    read = quantities_of(reader, path.parent)
    joints, last = _joints(read, reader.items("dh"))
    links = tuple(_link(read, key, node, len(joints)) for key, _, node in reader.entries("links"))
    known = {link.name for link in links}
    return Arm(
        reader.text("arm"),
        joints,
        links,
        (last,),
        pairs(findings, reader.items("allowed_contacts"), known, "link"),
        tuple(item.value for item in reader.items("assumptions")),
    )


def quantities_of(reader: Reader, folder: Path) -> Quantities:
    """The reader of the quantities of a file, with the units under `units:`."""
    length, angle = reader.text("units", "length") or "m", reader.text("units", "angle") or "deg"
    return Quantities(reader.findings, folder, length, angle)


def pairs(findings: Findings, items: list[Node], known: set[str], kind: str) -> frozenset[frozenset[str]]:
    """The pairs in a list. Unknown names are reported."""
    found = set()
    for item in items:
        names = [each.value for each in item.value]
        for each in item.value:
            if each.value not in known:
                findings.note(unknown_name(kind, each.value, known, each.where))
        found.add(frozenset(names))
    return frozenset(found)


def _joints(read: Quantities, rows: list[Node]) -> tuple[tuple[Joint, ...], Pose]:
    """The joints of a standard table, and the fixed pose after the last joint."""
    joints, fixed = [], Pose()
    for number, row in enumerate(rows, 1):
        limits = {key: _optional(read, row, key) for key in ("lower", "upper", "speed", "acceleration")}
        lower, upper = limits["lower"], limits["upper"]
        if lower is not None and upper is not None and lower >= upper:
            read.findings.add(
                row.where, "K113", "the lower limit is not below the upper one", "exchange them"
            )
        joints.append(
            Joint(
                f"joint_{number}",
                (fixed,),
                lower=-math.inf if lower is None else lower,
                upper=math.inf if upper is None else upper,
                speed=limits["speed"],
                acceleration=limits["acceleration"],
            )
        )
        fixed = _after(read, row)
    return tuple(joints), fixed


def _optional(read: Quantities, row: Node, key: str) -> float | None:
    node = child(row, key)
    return None if node is None else read.number(node, ANGLE)


def _after(read: Quantities, row: Node) -> Pose:
    """Rz(theta) Tz(d) Tx(a) Rx(alpha) as a pose. The joint turns about the same z axis before this pose."""
    a, d = (read.number(node) if (node := child(row, key)) else 0.0 for key in ("a", "d"))
    alpha, theta = (
        read.number(node, ANGLE) if (node := child(row, key)) else 0.0 for key in ("alpha", "theta")
    )
    return Pose((a * math.cos(theta), a * math.sin(theta), d), (alpha, 0.0, theta))


def _link(read: Quantities, name: str, node: Node, joints: int) -> Link:
    carrier = child(node, "carrier")
    number = int(carrier.value) if carrier else 0
    if number > joints and carrier:
        read.findings.add(carrier.where, "K113", f"the arm has {joints} joints", "count from 0, the base")
    return Link(name, min(number, joints), (read.pose(node),), read.shapes(child(node, "shapes")))
