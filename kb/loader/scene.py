"""Scene files: the cell is read, then what is said of parts, camera, hand and table. All names are checked."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from cellwright.kb.diagnostics import Source, unknown_name
from cellwright.kb.loader.arm import quantities_of
from cellwright.kb.loader.calibration import load_calibration
from cellwright.kb.loader.cell import read_cell
from cellwright.kb.loader.quantities import ANGLE, FACTOR, LENGTH, Quantities, child, required
from cellwright.kb.loader.reader import Findings, Reader, require, validate_shape
from cellwright.kb.loader.tree import Node, read_file
from cellwright.kb.model.cell import WORLD, Cell, Placement
from cellwright.kb.model.scene import DENSITY, INSET_M, CameraEntry, HandEntry, SaidRelation, Scene

KINDS = ("parallel", "against", "coplanar", "aligned", "fits", "concentric", "distance", "angle")
MEASURED = {"distance": LENGTH, "angle": ANGLE}
T = TypeVar("T", CameraEntry, HandEntry)
RELATION = re.compile(r"\s*(\w+)\.([\w.]+)\s+(\w+)\s+(\w+)\.([\w.]+?)\s*(?:=\s*(.+?)\s*)?")


def load_scene(path: Path) -> Scene:
    """The scene in a file. Raises `InvalidInput` with all errors."""
    findings = Findings()
    reader = Reader.of(read_file(path), findings)
    if not validate_shape(reader, "scene"):
        require(findings)
    beside = path.parent / reader.text("cell")
    cell = read_cell(beside, findings)
    scene = _SceneReader(reader, quantities_of(reader, path.parent), cell, path.parent).scene()
    require(findings)
    return scene


def relation_of(cell: Cell, first: str, kind: str, second: str, value: float = 0.0) -> SaidRelation:
    """A relation as a command line says it, its value in millimetres or degrees. Raises `InvalidInput`."""
    findings, where = Findings(), Source(f"{first} {kind} {second}")
    if kind not in KINDS:
        findings.note(unknown_name("relation", kind, KINDS, where))
    for name in (first, second):
        body, dot, feature = name.partition(".")
        if not dot or not feature:
            findings.add(where, "K005", f"'{name[:60]}' is no feature", "write its body first: angle.heel")
        elif body not in cell.bodies:
            findings.note(unknown_name("body", body, cell.bodies, where))
    require(findings)
    ends = [(body, feature) for body, _, feature in (first.partition("."), second.partition("."))]
    scaled = math.radians(value) if kind == "angle" else value / 1000
    return SaidRelation(kind, ends[0], ends[1], scaled, where=where)


@dataclass(frozen=True)
class _SceneReader:
    """Reads one scene of a cell."""

    reader: Reader
    read: Quantities
    cell: Cell
    beside: Path

    def scene(self) -> Scene:
        root = self.reader.root
        relations = [
            relation
            for key, preferred in (("relations", False), ("preferred", True))
            for node in self.reader.items(key)
            if (relation := self._relation(node, preferred)) is not None
        ]
        for node in self.reader.items("clutter"):
            self._body(node.value, node)
        target, kept = child(root, "target"), child(root, "calibration")
        if target is not None:
            self._body(target.value, target)
        inset, density, tolerance = (child(root, key) for key in ("inset", "density", "tolerance"))
        return Scene(
            self.reader.text("scene"),
            self.cell,
            self._camera(required(root, "camera")),
            self._hand(required(root, "hand")),
            tuple(relations),
            tuple(node.value for node in self.reader.items("clutter")),
            self._placement(child(root, "table")),
            self.read.positive(inset) if inset else INSET_M,
            self.read.number(density, FACTOR) if density else DENSITY,
            self.read.positive(tolerance) if tolerance else math.inf,
            target.value if target is not None else "",
            load_calibration(self.beside / str(kept.value)) if kept is not None else None,
        )

    def _placement(self, node: Node | None) -> Placement:
        parent = child(node, "in")
        if parent is not None and parent.value not in self._frames():
            self.read.findings.note(unknown_name("frame", parent.value, self._frames(), parent.where))
        return Placement(parent.value if parent else WORLD, self.read.pose(node))

    def _frames(self) -> list[str]:
        own = [f"{name}.{part}" for name in self.cell.arms for part in ("base", "flange", "tool")]
        features = [f"{name}.{each}" for name, body in self.cell.bodies.items() for each in body.features]
        return [WORLD, *self.cell.frames, *self.cell.bodies, *own, *features]

    def _body(self, name: str, node: Node) -> None:
        if name not in self.cell.bodies:
            self.read.findings.note(unknown_name("body", name, self.cell.bodies, node.where))

    def _relation(self, node: Node, preferred: bool) -> SaidRelation | None:
        found = RELATION.fullmatch(str(node.value))
        if found is None:
            hint = "write: bracket.bottom against base.top, or: lid.rim distance base.top = 5 mm"
            self.read.findings.add(node.where, "K005", f"'{str(node.value)[:60]}' is not a relation", hint)
            return None
        first, one, kind, second, other, value = found.groups()
        if kind not in KINDS:
            self.read.findings.note(unknown_name("relation", kind, KINDS, node.where))
            return None
        self._body(first, node)
        self._body(second, node)
        if (kind in MEASURED) != (value is not None):
            message = f"{kind} needs a value" if value is None else f"{kind} takes no value"
            hint = f"write {first}.{one} {kind} {second}.{other}{' = ...' if value is None else ''}"
            self.read.findings.add(node.where, "K005", message, hint)
            return None
        number = (
            self.read.number(Node(value, node.file, node.start, node.end), MEASURED[kind]) if value else 0.0
        )
        return SaidRelation(kind, (first, one), (second, other), number, preferred, node.where)

    def _camera(self, node: Node) -> CameraEntry:
        lengths = {
            f"{key}_m": self.read.positive(value) for key, value in _given(node, "view", "distance", "noise")
        }
        counts = {key: int(value.value) for key, value in _given(node, "width", "height")}
        shares = {key: self.read.number(value, FACTOR) for key, value in _given(node, "dropouts")}
        return _with(CameraEntry(self._placement(node)), {**lengths, **counts, **shares})

    def _hand(self, node: Node) -> HandEntry:
        arm = required(node, "arm")
        if arm.value not in self.cell.arms:
            self.read.findings.note(unknown_name("arm", arm.value, self.cell.arms, arm.where))
        keys = ("opening", "pad", "finger", "thick")
        lengths = {f"{key}_m": self.read.positive(value) for key, value in _given(node, *keys)}
        sizes = {
            f"{key}_m": tuple(self.read.positive(each) for each in value.value)
            for key, value in _given(node, "cross", "sensor")
        }
        friction = {key: self.read.number(value, FACTOR) for key, value in _given(node, "friction")}
        fingers = {key: int(value.value) for key, value in _given(node, "fingers")}
        exact = {f"{key}_m": self.read.number(value, LENGTH) for key, value in _given(node, "accuracy")}
        force = [self.read.number(value, FACTOR) for _, value in _given(node, "force")]
        return _with(
            HandEntry(arm.value),
            {**lengths, **exact, **sizes, **friction, **fingers, **({"force_n": force[0]} if force else {})},
        )


def _given(node: Node, *keys: str) -> list[tuple[str, Node]]:
    """Those of some keys that a mapping has, with their values."""
    return [(key, value) for key in keys if (value := child(node, key)) is not None]


def _with(entry: T, given: Mapping[str, Any]) -> T:
    """An entry with what the file gives instead of what is assumed."""
    return replace(entry, **given)
