"""The cell in a `cell.yaml`: arms, frames, bodies, regions and places. All references between them are checked."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from kb.diagnostics import unknown_name
from kb.files import is_file
from kb.loader.arm import bundled_arms, pairs, quantities_of, read_arm
from kb.loader.cell_guides import read_guide, read_plain
from kb.loader.cell_locations import Known, read_locations
from kb.loader.cell_measuring import read_measuring
from kb.loader.cell_operations import read_operations
from kb.loader.quantities import ANGLE, Quantities, child, members
from kb.loader.reader import Findings, Reader, require, validate_shape
from kb.loader.tree import Node, read_file
from kb.loader.urdf import read_urdf
from kb.model.cell import (
    TOUCH_M,
    WORLD,
    ZONE_SPEED_M_S,
    Arm,
    Body,
    BodyKind,
    Cell,
    MountedArm,
    Place,
    Placement,
    Region,
    Zone,
)
from kb.model.shapes import Sphere
from kb.terms import Function

ARM_FRAMES = ("base", "flange", "tool")


def load_cell(path: Path) -> Cell:
    """The cell in a file. Raises `InvalidInput` with all errors."""
    findings = Findings()
    cell = read_cell(path, findings)
    require(findings)
    return cell


def read_cell(path: Path, findings: Findings) -> Cell:
    """The cell in a file. Errors are added to `findings`. Raises `InvalidInput` if the file does not have the form of a cell."""
    reader = Reader.of(read_file(path), findings)
    if not validate_shape(reader, "cell"):
        require(findings)
    return _CellReader(reader, quantities_of(reader, path.parent)).cell(str(path))


@dataclass
class _CellReader:
    """Reads one cell. Names are collected first, so that entries may refer to later entries."""

    reader: Reader
    read: Quantities
    placements: dict[str, Placement] = field(default_factory=dict)
    nodes: dict[str, Node] = field(default_factory=dict)

    def cell(self, path: str) -> Cell:
        arms = {name: self._arm(node) for name, node in self._section("arms")}
        frames = {name: self._placement(node) for name, node in self._section("frames")}
        bodies = {
            name: self._body(name, kind, node)
            for section, kind in _BODIES.items()
            for name, node in self._section(section)
        }
        self._check_followers(bodies)
        self._frames(arms, frames, bodies)
        regions = {name: self._region(name, node) for name, node in self._section("regions")}
        self._check_parents(regions)
        touchable = {*bodies, *regions, *_links(arms)}
        allowed = pairs(self.read.findings, self.reader.items("allowed_contacts"), touchable, "body or link")
        read = (self._place(key, node, arms, bodies) for _, key, node in self.reader.entries("places"))
        places = {place.name: place for place in read}
        known = Known(bodies, places, self._known())
        locations = read_locations(self.reader, self.read, known)
        zones = {name: self._zone(name, node) for name, node in self._section("zones")}
        operations = read_operations(self.reader, self.read.findings, known)
        name = self.reader.text("cell")
        measuring = {
            key: read_measuring(node, self.read, bodies)
            for key, key_node, node in self.reader.entries("measuring")
            if self._is_tool(key, key_node, bodies)
        }
        return Cell(
            name,
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
            path,
        )

    def _section(self, section: str) -> list[tuple[str, Node]]:
        """The named entries of a section. A name that another section uses already is reported."""
        entries = []
        for name, key, node in self.reader.entries(section):
            if not self.reader.is_name(name, key):
                continue
            if name in self.nodes or name == WORLD:
                hint = "arms, frames, bodies and regions share their names"
                self.read.findings.add(key.where, "K104", f"'{name}' is declared already", hint)
                continue
            self.nodes[name] = key
            entries.append((name, node))
        return entries

    def _placement(self, node: Node) -> Placement:
        parent = child(node, "in")
        where = parent.where if parent else node.where
        return Placement(parent.value if parent else WORLD, self.read.pose(node), where)

    def _arm(self, node: Node) -> MountedArm:
        arm = self._model(node)
        home = child(node, "home")
        values = tuple(self.read.number(item, ANGLE) for item in home.value) if home else ()
        if home and len(values) != len(arm.joints):
            hint = f"the arm has {len(arm.joints)} joints"
            self.read.findings.add(home.where, "K707", f"there are {len(values)} joint values", hint)
        return MountedArm(arm, self._placement(node), self.read.pose(child(node, "tool")), values, node.where)

    def _model(self, node: Node) -> Arm:
        model, urdf = child(node, "model"), child(node, "urdf")
        if (model is None) == (urdf is None):
            self.read.findings.add(
                node.where, "K005", "an arm needs one description", "give `model` or `urdf`"
            )
        if urdf is not None:
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

    def _body(self, name: str, kind: BodyKind, node: Node) -> Body:
        features = {key: self.read.pose(value) for key, _, value in members(child(node, "features"))}
        return Body(
            name,
            kind,
            self._placement(node),
            self.read.shapes(child(node, "shapes")),
            features,
            read_guide(child(node, "joint"), self.read),
            read_plain(child(node, "mass")),
            read_plain(child(node, "friction")),
        )

    def _check_followers(self, bodies: Mapping[str, Body]) -> None:
        """A body follows one that has a joint, and follows none itself."""
        leaders = {name for name, body in bodies.items() if body.guide and not body.guide.follows}
        for name, body in bodies.items():
            if body.guide and body.guide.follows and body.guide.follows not in leaders:
                where = self.nodes[name].where
                self.read.findings.note(unknown_name("body with a joint", body.guide.follows, leaders, where))

    def _frames(
        self, arms: Mapping[str, MountedArm], frames: Mapping[str, Placement], bodies: Mapping[str, Body]
    ) -> None:
        """Collect every frame by name, then check that each is placed in a known frame and none in itself."""
        for name, arm in arms.items():
            for frame in ("flange", "tool", *(link.name for link in arm.arm.links)):
                self.placements[f"{name}.{frame}"] = Placement(f"{name}.base")
            self.placements[f"{name}.base"] = arm.base  # a link of this name may be elsewhere
        self.placements |= frames
        for name, body in bodies.items():
            self.placements[name] = body.placement
            self.placements |= {f"{name}.{feature}": Placement(name) for feature in body.features}
        known = self._known()
        for name, placement in self.placements.items():
            if self._is_known(placement, known) and self._circular(name):
                hint = "follow `in` from frame to frame: it must end at `world`"
                self.read.findings.add(
                    placement.where, "K701", f"'{name}' is placed relative to itself", hint
                )

    def _known(self) -> Collection[str]:
        return [WORLD, *self.placements]

    def _is_known(self, placement: Placement, known: Collection[str]) -> bool:
        if placement.parent in known:
            return True
        self.read.findings.note(unknown_name("frame", placement.parent, known, placement.where))
        return False

    def _circular(self, name: str) -> bool:
        seen, at = set(), name
        while at in self.placements and at not in seen:
            seen.add(at)
            at = self.placements[at].parent
        return at == name

    def _region(self, name: str, node: Node) -> Region:
        shape = self.read.shape(node)
        parents = child(node, "parents")
        placement = self._placement(node)
        self._is_known(placement, self._known())
        solid = child(node, "solid")
        return Region(
            name,
            shape or Sphere(1.0),
            placement,
            tuple(item.value for item in parents.value) if parents else (),
            solid is not None and solid.value == "true",
            self.nodes[name].where,
        )

    def _zone(self, name: str, node: Node) -> Zone:
        placement, speed = self._placement(node), child(node, "speed")
        self._is_known(placement, self._known())
        allowed = self.read.number(speed) if speed else ZONE_SPEED_M_S
        if speed is not None and allowed <= 0.0:
            hint = "give a speed above 0, or an obstacle in `fixtures` where no arm may go"
            self.read.findings.add(speed.where, "K005", f"the speed of zone '{name}' is not above 0", hint)
        return Zone(name, self.read.shape(node) or Sphere(1.0), placement, allowed)

    def _check_parents(self, regions: Mapping[str, Region]) -> None:
        for _, _, node in self.reader.entries("regions"):
            parents = child(node, "parents")
            for item in parents.value if parents else []:
                if item.value not in regions:
                    self.read.findings.note(unknown_name("region", item.value, regions, item.where))
        for name in regions:
            if name in _ancestors(regions, name):
                where = self.nodes[name].where
                self.read.findings.add(
                    where, "K701", f"region '{name}' is its own ancestor", "remove one parent of the circle"
                )

    def _place(
        self, key: Node, node: Node, arms: Mapping[str, MountedArm], bodies: Mapping[str, Body]
    ) -> Place:
        expression = self.reader.parse("term", key)
        term = expression.value if expression else None
        name = str(term) if isinstance(term, Function) else str(key.value)
        placement = self._placement(node)
        self._is_known(placement, self._known())
        approach, turns, touches = child(node, "approach"), child(node, "turns"), child(node, "touches")
        touched = touches.value if touches else []
        for item in touched:
            if item.value not in bodies:
                self.read.findings.note(unknown_name("body", item.value, bodies, item.where))
        return Place(
            name,
            Placement(placement.parent, placement.pose, key.where),
            self._which_arm(key, node, arms),
            self._which_tool(node, bodies),
            self.read.number(approach) if approach else 0.0,
            turns is not None and turns.value == "true",
            tuple(item.value for item in touched),
            self.read.number(depth) if (depth := child(node, "depth")) else TOUCH_M,
        )

    def _which_arm(self, key: Node, node: Node, arms: Mapping[str, MountedArm]) -> str:
        given = child(node, "arm")
        if given is not None:
            if given.value not in arms:
                self.read.findings.note(unknown_name("arm", given.value, arms, given.where))
            return str(given.value)
        if len(arms) != 1:
            self.read.findings.add(key.where, "K005", "the arm for this place is not given", "give `arm`")
            return ""
        return next(iter(arms))

    def _is_tool(self, name: str, key: Node, bodies: Mapping[str, Body]) -> bool:
        """Whether a body is a tool with a tip; another one is reported."""
        tools = {each for each, body in bodies.items() if "tip" in body.features}
        if name not in tools:
            self.read.findings.note(unknown_name("tool with a `tip`", name, tools, key.where))
        return name in tools

    def _which_tool(self, node: Node, bodies: Mapping[str, Body]) -> str:
        given = child(node, "tool")
        if given is None:
            return ""
        tools = {name for name, body in bodies.items() if "tip" in body.features}
        if given.value not in tools:
            self.read.findings.note(unknown_name("tool with a `tip`", given.value, tools, given.where))
        return str(given.value)


_BODIES = {"fixtures": BodyKind.FIXTURE, "parts": BodyKind.PART, "tools": BodyKind.TOOL}


def _links(arms: Mapping[str, MountedArm]) -> list[str]:
    return [f"{name}.{link.name}" for name, arm in arms.items() for link in arm.arm.links]


def _ancestors(regions: Mapping[str, Region], name: str) -> set[str]:
    found: set[str] = set()
    open_ = list(regions[name].parents)
    while open_:
        parent = open_.pop()
        if parent in regions and parent not in found:
            found.add(parent)
            open_ += regions[parent].parents
    return found
