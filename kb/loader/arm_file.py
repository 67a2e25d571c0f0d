"""Arms from files: a Denavit-Hartenberg table and the shapes of the links; bundled ones too."""

import math
from pathlib import Path

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.files import read_file
from cellwright.kb.loader.geometry_values import ANGLE, QuantityReader
from cellwright.kb.loader.reader import LoadFindings, Reader, require_valid, validate_shape
from cellwright.kb.loader.yaml_tree import YamlNode, child_at
from cellwright.kb.model.body_shapes import Pose
from cellwright.kb.model.cell_model import Arm, Joint, Link

BUNDLED_ARMS = Path(__file__).parents[1] / "arms"


def bundled_arms() -> dict[str, Path]:
    """The arms that come with the engine, by name."""
    return {path.stem: path for path in sorted(BUNDLED_ARMS.glob("*.yaml"))}


def load_arm(path: Path) -> Arm:
    """The arm in a file. Raises `InvalidInput` with all errors."""
    findings = LoadFindings()
    arm = read_arm(path, findings)
    require_valid(findings)
    return arm


def read_arm(path: Path, findings: LoadFindings) -> Arm:
    """The arm in a file. Errors are added to `findings`.

    Raises `InvalidInput` if the file does not have the form of an arm.
    """
    reader = Reader.of(read_file(path), findings)
    if not validate_shape(reader, "arm"):
        require_valid(findings)
    read = quantities_of(reader, path.parent)
    joints, last = _read_joints(read, reader.items("dh"))
    links = tuple(
        _read_link(read, key, node, len(joints)) for key, _, node in reader.entries("links")
    )
    link_names = {link.name for link in links}
    return Arm(
        reader.text("arm"),
        joints,
        links,
        (last,),
        read_pairs(findings, reader.items("allowed_contacts"), link_names, "link"),
        tuple(item.value for item in reader.items("assumptions")),
    )


def quantities_of(reader: Reader, folder: Path) -> QuantityReader:
    """The reader of the quantities of a file, with the units under `units:`."""
    length, angle = reader.text("units", "length") or "m", reader.text("units", "angle") or "deg"
    return QuantityReader(reader.findings, folder, length, angle)


def read_pairs(
    findings: LoadFindings, items: list[YamlNode], known: set[str], kind: str
) -> frozenset[frozenset[str]]:
    """The pairs in a list. Unknown names are reported."""
    pairs_entry = set()
    for item in items:
        names = [name_node.value for name_node in item.value]
        for node in item.value:
            if node.value not in known:
                findings.note(unknown_name(kind, node.value, known, node.where))
        pairs_entry.add(frozenset(names))
    return frozenset(pairs_entry)


def _read_joints(read: QuantityReader, rows: list[YamlNode]) -> tuple[tuple[Joint, ...], Pose]:
    """The joints of a standard table, and the fixed pose after the last joint."""
    joints, fixed = [], Pose()
    for number, row in enumerate(rows, 1):
        limits = {
            key: _optional_number(read, row, key)
            for key in ("lower", "upper", "speed", "acceleration")
        }
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
        fixed = _pose_after_joint(read, row)
    return tuple(joints), fixed


def _optional_number(read: QuantityReader, row: YamlNode, key: str) -> float | None:
    node = child_at(row, key)
    return None if node is None else read.number(node, ANGLE)


def _pose_after_joint(read: QuantityReader, row: YamlNode) -> Pose:
    """Rz(theta) Tz(d) Tx(a) Rx(alpha) as a pose.

    The joint turns about the same z axis before this pose.
    """
    a, d = (read.number(node) if (node := child_at(row, key)) else 0.0 for key in ("a", "d"))
    alpha, theta = (
        read.number(node, ANGLE) if (node := child_at(row, key)) else 0.0
        for key in ("alpha", "theta")
    )
    return Pose((a * math.cos(theta), a * math.sin(theta), d), (alpha, 0.0, theta))


def _read_link(read: QuantityReader, name: str, node: YamlNode, joints: int) -> Link:
    carrier = child_at(node, "carrier")
    number = int(carrier.value) if carrier else 0
    if number > joints and carrier:
        read.findings.add(
            carrier.where, "K113", f"the arm has {joints} joints", "count from 0, the base"
        )
    return Link(
        name, min(number, joints), (read.pose(node),), read.shapes(child_at(node, "shapes"))
    )
