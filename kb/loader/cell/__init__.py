"""The cell in a `cell.yaml`: arms, frames, bodies, regions and places.

All references between them are checked.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.files import is_file, read_file
from cellwright.kb.loader.arm_file import bundled_arms, quantities_of, read_arm, read_pairs
from cellwright.kb.loader.cell.domain_bindings import CellNames, read_locations, read_operations
from cellwright.kb.loader.cell.placements import (
    Frames,
    PlaceNames,
    is_tool,
    read_guide,
    read_placement,
    read_places,
    read_plain,
)
from cellwright.kb.loader.cell.sensing import SensedNames, read_measuring, read_sensor
from cellwright.kb.loader.device_uses import composed_beside
from cellwright.kb.loader.domain_lookup import domain_of
from cellwright.kb.loader.geometry_values import ANGLE, LENGTH, QuantityReader
from cellwright.kb.loader.reader import LoadFindings, Reader, require_valid, validate_shape
from cellwright.kb.loader.yaml_tree import YamlNode, child_at, mapping_members
from cellwright.kb.model.body_shapes import Sphere
from cellwright.kb.model.cell_model import (
    ZONE_SPEED_M_S,
    Arm,
    Body,
    BodyKind,
    Cell,
    JointKind,
    Measuring,
    MountedArm,
    Region,
    Sensor,
    Zone,
)
from cellwright.kb.model.domain_model import WORLD_FRAME
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import CELL_FILE, DOMAIN_FILE


def load_cell(path: Path) -> Cell:
    """The cell in a file. Raises `InvalidInput` with all errors."""
    findings = LoadFindings()
    cell = read_cell(path, findings)
    require_valid(findings)
    return cell


def cell_of(target: str) -> Cell:
    """The cell beside the domain of a target. Raises `InvalidInput`."""
    return _load_cell_beside(domain_of(target))


def cell_of_problem(problem: Problem) -> Cell:
    """The cell beside the domain of a problem from a file. Raises `InvalidInput`."""
    return _load_cell_beside(Path(problem.domain.path))


def _load_cell_beside(domain: Path) -> Cell:
    path = domain.with_name(CELL_FILE)
    if not path.is_file():
        hint = f"describe the cell in a {CELL_FILE} beside the domain"
        raise InvalidInput(
            [Diagnostic(Source(str(path)), "K405", f"there is no {CELL_FILE}", hint)]
        )
    return load_cell(path)


def read_cell(path: Path, findings: LoadFindings) -> Cell:
    """The cell in a file. Errors are added to `findings`.

    Raises `InvalidInput` if the file does not have the form of a cell.
    """
    reader = Reader.of(read_file(path), findings)
    composed_beside(reader, path.with_name(DOMAIN_FILE), "cell")
    if not validate_shape(reader, "cell"):
        require_valid(findings)
    return _CellReader(reader, quantities_of(reader, path.parent), Frames(findings)).cell(str(path))


@dataclass
class _CellReader:
    """Reads one cell. Names are collected first, so that entries may refer to later entries."""

    reader: Reader
    read: QuantityReader
    frames: Frames
    nodes: dict[str, YamlNode] = field(default_factory=dict)

    def cell(self, path: str) -> Cell:
        read, findings = self.read, self.read.findings
        arms = {name: self._arm(node) for name, node in self._section("arms")}
        frames = {name: read_placement(node, read) for name, node in self._section("frames")}
        bodies = self._bodies()
        self.frames.add(arms, frames, bodies)
        regions = {name: self._region(name, node) for name, node in self._section("regions")}
        self._check_parents(regions)
        allowed = read_pairs(
            findings,
            self.reader.items("allowed_contacts"),
            {*bodies, *regions, *_arm_links(arms)},
            "body or link",
        )
        places = read_places(self.reader, read, PlaceNames(self.frames, arms, bodies))
        cell_names = CellNames(bodies, places, self.frames.names())
        locations = read_locations(self.reader, read, cell_names)
        zones = {name: self._zone(name, node) for name, node in self._section("zones")}
        operations = read_operations(self.reader, findings, cell_names)
        name, measuring = self.reader.text("cell"), self._measuring(bodies)
        sections = (
            arms,
            frames,
            bodies,
            regions,
            allowed,
            places,
            locations,
            zones,
            operations,
            measuring,
        )
        return Cell(
            name, *sections, self._sensors(SensedNames(bodies, arms, self.frames.names())), path
        )

    def _bodies(self) -> dict[str, Body]:
        bodies = {
            name: self._body(name, kind, node)
            for section, kind in _BODIES.items()
            for name, node in self._section(section)
        }
        self._check_followers(bodies)
        return bodies

    def _measuring(self, bodies: Mapping[str, Body]) -> dict[str, Measuring]:
        return {
            key: read_measuring(key, node, self.read, bodies)
            for key, key_node, node in self.reader.entries("measuring")
            if is_tool(key, key_node, self.read, bodies)
        }

    def _sensors(self, known: SensedNames) -> dict[str, Sensor]:
        read = (
            (key, read_sensor(node, self.read, known))
            for key, _, node in self.reader.entries("sensors")
        )
        return {key: sensor for key, sensor in read if sensor is not None}

    def _section(self, section: str) -> list[tuple[str, YamlNode]]:
        """The named entries of a section. A name that another section uses already is reported."""
        entries = []
        for name, key, node in self.reader.entries(section):
            if not self.reader.is_name(name, key):
                continue
            if name in self.nodes or name == WORLD_FRAME:
                hint = "arms, frames, bodies and regions share their names"
                self.read.findings.add(key.where, "K104", f"'{name}' is declared already", hint)
                continue
            self.nodes[name] = key
            entries.append((name, node))
        return entries

    def _arm(self, node: YamlNode) -> MountedArm:
        arm = self._model(node)
        home = child_at(node, "home")
        values = self._home(arm, home) if home else ()
        return MountedArm(
            arm,
            read_placement(node, self.read),
            self.read.pose(child_at(node, "tool")),
            values,
            node.where,
        )

    def _home(self, arm: Arm, home: YamlNode) -> tuple[float, ...]:
        """The joint values in which an arm rests: metres where a joint slides, radians where it
        turns.
        """
        if len(home.value) != len(arm.joints):
            hint = f"the arm has {len(arm.joints)} joints"
            self.read.findings.add(
                home.where, "K707", f"there are {len(home.value)} joint values", hint
            )
            return ()
        units = [LENGTH if joint.kind is JointKind.PRISMATIC else ANGLE for joint in arm.joints]
        return tuple(
            self.read.number(item, unit) for item, unit in zip(home.value, units, strict=True)
        )

    def _model(self, node: YamlNode) -> Arm:
        model, urdf = child_at(node, "model"), child_at(node, "urdf")
        if (model is None) == (urdf is None):
            self.read.findings.add(
                node.where, "K005", "an arm needs one description", "give `model` or `urdf`"
            )
        if urdf is not None:
            from cellwright.kb.loader.urdf import read_urdf  # slow to import, and few cells need it

            return read_urdf(urdf, node, self.read)
        if model is None:
            return Arm("", ())
        known = bundled_arms()
        path = known[model.value] if model.value in known else self.read.file(model)
        if path is None:
            return Arm("", ())
        if is_file(path):
            return read_arm(path, self.read.findings)
        self.read.findings.note(unknown_name("arm", model.value, known, model.where))
        return Arm("", ())

    def _body(self, name: str, kind: BodyKind, node: YamlNode) -> Body:
        features = {
            key: self.read.pose(value)
            for key, _, value in mapping_members(child_at(node, "features"))
        }
        return Body(
            name,
            kind,
            read_placement(node, self.read),
            self.read.shapes(child_at(node, "shapes")),
            features,
            read_guide(child_at(node, "joint"), self.read),
            read_plain(child_at(node, "mass")),
            read_plain(child_at(node, "friction")),
        )

    def _check_followers(self, bodies: Mapping[str, Body]) -> None:
        """A body follows one that has a joint, and follows none itself."""
        leaders = {name for name, body in bodies.items() if body.guide and not body.guide.follows}
        for guide in (body.guide for body in bodies.values()):
            if guide and guide.follows and guide.follows not in leaders:
                self.read.findings.note(
                    unknown_name("body with a joint", guide.follows, leaders, guide.where)
                )

    def _region(self, name: str, node: YamlNode) -> Region:
        shape = self.read.shape(node)
        parents = child_at(node, "parents")
        placement = read_placement(node, self.read)
        self.frames.is_known(placement)
        solid = child_at(node, "solid")
        return Region(
            name,
            shape or Sphere(1.0),
            placement,
            tuple(item.value for item in parents.value) if parents else (),
            solid is not None and solid.value == "true",
            self.nodes[name].where,
        )

    def _zone(self, name: str, node: YamlNode) -> Zone:
        placement, speed = read_placement(node, self.read), child_at(node, "speed")
        self.frames.is_known(placement)
        allowed = self.read.number(speed) if speed else ZONE_SPEED_M_S
        if speed is not None and allowed <= 0.0:
            hint = "give a speed above 0, or an obstacle in `fixtures` where no arm may go"
            self.read.findings.add(
                speed.where, "K005", f"the speed of zone '{name}' is not above 0", hint
            )
        return Zone(name, self.read.shape(node) or Sphere(1.0), placement, allowed)

    def _check_parents(self, regions: Mapping[str, Region]) -> None:
        for _, _, node in self.reader.entries("regions"):
            parents = child_at(node, "parents")
            for item in parents.value if parents else []:
                if item.value not in regions:
                    self.read.findings.note(unknown_name("region", item.value, regions, item.where))
        for name in regions:
            if name in _region_ancestors(regions, name):
                where = self.nodes[name].where
                self.read.findings.add(
                    where,
                    "K701",
                    f"region '{name}' is its own ancestor",
                    "remove one parent of the circle",
                )


_BODIES = {"fixtures": BodyKind.FIXTURE, "parts": BodyKind.PART, "tools": BodyKind.TOOL}


def _arm_links(arms: Mapping[str, MountedArm]) -> list[str]:
    return [f"{name}.{link.name}" for name, arm in arms.items() for link in arm.arm.links]


def _region_ancestors(regions: Mapping[str, Region], name: str) -> set[str]:
    ancestors: set[str] = set()
    open_ = list(regions[name].parents)
    while open_:
        parent = open_.pop()
        if parent in regions and parent not in ancestors:
            ancestors.add(parent)
            open_ += regions[parent].parents
    return ancestors
