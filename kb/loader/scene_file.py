"""The `Scene` in a scene file: parts, camera, hand and table of a cell. Names are checked."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from cellwright.kb.diagnostics import Source, unknown_name
from cellwright.kb.files import read_file
from cellwright.kb.loader.arm_file import quantities_of
from cellwright.kb.loader.calibration_file import load_calibration
from cellwright.kb.loader.cell import read_cell
from cellwright.kb.loader.geometry_values import ANGLE, FACTOR, LENGTH, QuantityReader
from cellwright.kb.loader.reader import LoadFindings, Reader, require_valid, validate_shape
from cellwright.kb.loader.yaml_tree import YamlNode, child_at, required_child
from cellwright.kb.model.cell_model import Cell, Placement
from cellwright.kb.model.domain_model import WORLD_FRAME
from cellwright.kb.model.part_scene import (
    DENSITY,
    INSET_M,
    CameraEntry,
    HandEntry,
    SaidRelation,
    Scene,
)

RELATION_KINDS = (
    "parallel",
    "against",
    "coplanar",
    "aligned",
    "fits",
    "concentric",
    "distance",
    "angle",
)
MEASURED_RELATIONS = {"distance": LENGTH, "angle": ANGLE}
T = TypeVar("T", CameraEntry, HandEntry)
RELATION_TEXT = re.compile(r"\s*(\w+)\.([\w.]+)\s+(\w+)\s+(\w+)\.([\w.]+?)\s*(?:=\s*(.+?)\s*)?")


def load_scene(path: Path) -> Scene:
    """The scene in a file. Raises `InvalidInput` with all errors."""
    findings = LoadFindings()
    reader = Reader.of(read_file(path), findings)
    if not validate_shape(reader, "scene"):
        require_valid(findings)
    beside = path.parent / reader.text("cell")
    cell = read_cell(beside, findings)
    scene = _SceneReader(reader, quantities_of(reader, path.parent), cell, path.parent).scene()
    require_valid(findings)
    return scene


def relation_of(cell: Cell, first: str, kind: str, second: str, value: float = 0.0) -> SaidRelation:
    """A relation as a command line says it, its value in millimetres or degrees.

    Raises `InvalidInput`.
    """
    findings, where = LoadFindings(), Source(f"{first} {kind} {second}")
    if kind not in RELATION_KINDS:
        findings.note(unknown_name("relation", kind, RELATION_KINDS, where))
    for name in (first, second):
        body, dot, feature = name.partition(".")
        if not dot or not feature:
            findings.add(
                where, "K005", f"'{name[:60]}' is no feature", "write its body first: angle.heel"
            )
        elif body not in cell.bodies:
            findings.note(unknown_name("body", body, cell.bodies, where))
    require_valid(findings)
    ends = [(body, feature) for body, _, feature in (first.partition("."), second.partition("."))]
    scaled = math.radians(value) if kind == "angle" else value / 1000
    return SaidRelation(kind, ends[0], ends[1], scaled, where=where)


@dataclass(frozen=True)
class _SceneReader:
    """Reads one scene of a cell."""

    reader: Reader
    read: QuantityReader
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
        target, kept = child_at(root, "target"), child_at(root, "calibration")
        if target is not None:
            self._body(target.value, target)
        inset, density, tolerance = (
            child_at(root, key) for key in ("inset", "density", "tolerance")
        )
        return Scene(
            self.reader.text("scene"),
            self.cell,
            self._camera(required_child(root, "camera")),
            self._hand(required_child(root, "hand")),
            tuple(relations),
            tuple(node.value for node in self.reader.items("clutter")),
            self._placement(child_at(root, "table")),
            self.read.positive(inset) if inset else INSET_M,
            self.read.number(density, FACTOR) if density else DENSITY,
            self.read.positive(tolerance) if tolerance else math.inf,
            target.value if target is not None else "",
            load_calibration(self.beside / str(kept.value)) if kept is not None else None,
        )

    def _placement(self, node: YamlNode | None) -> Placement:
        parent = child_at(node, "in")
        if parent is not None and parent.value not in self._frames():
            self.read.findings.note(
                unknown_name("frame", parent.value, self._frames(), parent.where)
            )
        return Placement(parent.value if parent else WORLD_FRAME, self.read.pose(node))

    def _frames(self) -> list[str]:
        own = [f"{name}.{part}" for name in self.cell.arms for part in ("base", "flange", "tool")]
        features = [
            f"{name}.{feature}"
            for name, body in self.cell.bodies.items()
            for feature in body.features
        ]
        return [WORLD_FRAME, *self.cell.frames, *self.cell.bodies, *own, *features]

    def _body(self, name: str, node: YamlNode) -> None:
        if name not in self.cell.bodies:
            self.read.findings.note(unknown_name("body", name, self.cell.bodies, node.where))

    def _relation(self, node: YamlNode, preferred: bool) -> SaidRelation | None:
        match = RELATION_TEXT.fullmatch(str(node.value))
        if match is None:
            hint = "write: bracket.bottom against base.top, or: lid.rim distance base.top = 5 mm"
            self.read.findings.add(
                node.where, "K005", f"'{str(node.value)[:60]}' is not a relation", hint
            )
            return None
        first, one, kind, second, other, value = match.groups()
        if kind not in RELATION_KINDS:
            self.read.findings.note(unknown_name("relation", kind, RELATION_KINDS, node.where))
            return None
        self._body(first, node)
        self._body(second, node)
        if (kind in MEASURED_RELATIONS) != (value is not None):
            message = f"{kind} needs a value" if value is None else f"{kind} takes no value"
            hint = f"write {first}.{one} {kind} {second}.{other}{' = ...' if value is None else ''}"
            self.read.findings.add(node.where, "K005", message, hint)
            return None
        number = (
            self.read.number(
                YamlNode(value, node.file, node.start, node.end), MEASURED_RELATIONS[kind]
            )
            if value
            else 0.0
        )
        return SaidRelation(kind, (first, one), (second, other), number, preferred, node.where)

    def _camera(self, node: YamlNode) -> CameraEntry:
        lengths = {
            f"{key}_m": self.read.positive(value)
            for key, value in _given_nodes(node, "view", "distance", "noise")
        }
        counts = {key: int(value.value) for key, value in _given_nodes(node, "width", "height")}
        shares = {
            key: self.read.number(value, FACTOR) for key, value in _given_nodes(node, "dropouts")
        }
        return _entry_with(CameraEntry(self._placement(node)), {**lengths, **counts, **shares})

    def _hand(self, node: YamlNode) -> HandEntry:
        arm = required_child(node, "arm")
        if arm.value not in self.cell.arms:
            self.read.findings.note(unknown_name("arm", arm.value, self.cell.arms, arm.where))
        keys = ("opening", "pad", "finger", "thick")
        lengths = {
            f"{key}_m": self.read.positive(value) for key, value in _given_nodes(node, *keys)
        }
        sizes = {
            f"{key}_m": tuple(self.read.positive(item) for item in value.value)
            for key, value in _given_nodes(node, "cross", "sensor")
        }
        friction = {
            key: self.read.number(value, FACTOR) for key, value in _given_nodes(node, "friction")
        }
        fingers = {key: int(value.value) for key, value in _given_nodes(node, "fingers")}
        exact = {
            f"{key}_m": self.read.number(value, LENGTH)
            for key, value in _given_nodes(node, "accuracy")
        }
        force = [self.read.number(value, FACTOR) for _, value in _given_nodes(node, "force")]
        return _entry_with(
            HandEntry(arm.value),
            {
                **lengths,
                **exact,
                **sizes,
                **friction,
                **fingers,
                **({"force_n": force[0]} if force else {}),
            },
        )


def _given_nodes(node: YamlNode, *keys: str) -> list[tuple[str, YamlNode]]:
    """Those of some keys that a mapping has, with their values."""
    return [(key, value) for key in keys if (value := child_at(node, key)) is not None]


def _entry_with(entry: T, given: Mapping[str, Any]) -> T:
    """An entry with what the file gives instead of what is assumed."""
    return replace(entry, **given)
