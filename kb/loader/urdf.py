"""Arms from URDF and SRDF: joints, links, collision shapes, and links that may touch."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

from cellwright.kb.diagnostics import InvalidInput, Source
from cellwright.kb.files import is_file, read_file
from cellwright.kb.loader.geometry_values import QuantityReader
from cellwright.kb.loader.reader import LoadFindings
from cellwright.kb.loader.strict_xml import XmlElement, read_xml
from cellwright.kb.loader.yaml_tree import YamlNode, child_at
from cellwright.kb.model.body_shapes import (
    MAX_MAGNITUDE,
    MESH_SUFFIXES,
    Box,
    Cylinder,
    Mesh,
    Offsets,
    PlacedShape,
    Pose,
    Shape,
    Sphere,
    Vector,
)
from cellwright.kb.model.cell_model import Arm, Inertia, Joint, JointKind, Link, Mimic
from cellwright.kb.numbers import NumberError, read_decimal

MAX_URDF_NUMBER = 1e300  # more is no number for us; LARGEST is what a cell may have
MIN_URDF_SCALE = 1e-9  # a scale nearer to zero leaves nothing
INERTIA_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


@dataclass(frozen=True, slots=True)
class ElementReader:
    """Reads elements and reports their errors. Meshes are looked up in `folders`."""

    findings: LoadFindings
    folders: list[Path]

    def note(self, element: XmlElement, message: str, hint: str) -> None:
        """Report an error in an element."""
        self.findings.add(element.where, "K703", message, hint)

    def broken(self, element: XmlElement, message: str, hint: str) -> InvalidInput:
        """The exception for an error after which reading cannot continue."""
        self.note(element, message, hint)
        return InvalidInput(self.findings.diagnostics)

    def shapes(self, link: XmlElement) -> tuple[PlacedShape, ...]:
        """The collision shapes of a link."""
        shapes = []
        for collision in link.all("collision"):
            geometry = collision.first("geometry")
            if geometry is None or len(geometry.children) != 1:
                self.note(collision, "a collision element without one geometry", "add <geometry>")
                continue
            shape = self._shape(geometry.children[0])
            if shape is not None:
                shapes.append(PlacedShape(shape, self.origin(collision)))
        return tuple(shapes)

    def _shape(self, element: XmlElement) -> Shape | None:
        match element.tag:
            case "box":
                size = self.vector(element, "size", "0 0 0")
                return Box(size) if self._extent(element, *size) else None
            case "sphere":
                (radius,) = self.numbers(element, "radius", 1, "0")
                return Sphere(radius) if self._extent(element, radius) else None
            case "cylinder":
                (radius,), (length,) = (
                    self.numbers(element, key, 1, "0") for key in ("radius", "length")
                )
                return Cylinder(radius, length) if self._extent(element, radius, length) else None
            case "mesh":
                return self._mesh(element)
            case _:
                self.note(
                    element, f"<{element.tag}> is not a shape", "box, sphere, cylinder or mesh"
                )
                return None

    def _extent(self, element: XmlElement, *sizes: float) -> bool:
        if min(sizes) > 0:
            return self._finite(element, *sizes)
        self.findings.add(
            element.where, "K702", f"a <{element.tag}> without a positive size", "give its size"
        )
        return False

    def _mesh(self, element: XmlElement) -> Mesh | None:
        name = element.get("filename")
        if name.startswith("package://") and ".." in Path(name).parts:
            hint = "name the folder with its packages under `packages`"
            self.findings.add(element.where, "K706", f"'{name[:80]}' leaves its package", hint)
            return None
        path = self._found(name)
        if path is None:
            hint = "name the folder with its packages under `packages`"
            self.findings.add(element.where, "K706", f"there is no mesh '{name[:80]}'", hint)
            return None
        if path.suffix.lower() not in MESH_SUFFIXES:
            hint = f"convert it to one of: {', '.join(MESH_SUFFIXES)}"
            self.note(element, f"'{path.suffix}' is not a supported mesh format", hint)
            return None
        scale = self.vector(element, "scale", "1 1 1")
        if min(map(abs, scale)) < MIN_URDF_SCALE:
            hint = "write 1, or 0.001 for millimetres"
            self.findings.add(element.where, "K702", "a scale of 0 leaves no volume", hint)
            return None
        return Mesh(str(path), scale, element.where)

    def _found(self, name: str) -> Path | None:
        """The file that a name leads to.

        A `package://` path is looked for within the folders of packages alone.
        """
        inside = name.removeprefix("package://").removeprefix("file://")
        if name.startswith("package://"):
            inside = inside.lstrip("/")
        candidates = (
            folder / part for folder in self.folders for part in (inside, inside.partition("/")[2])
        )
        return next((path for path in candidates if is_file(path) and self._is_inside(path)), None)

    def _is_inside(self, path: Path) -> bool:
        return any(path.resolve().is_relative_to(folder.resolve()) for folder in self.folders)

    def inertia(self, link: XmlElement) -> Inertia | None:
        """The mass and the moments of a link; None if it has none."""
        element = link.first("inertial")
        if element is None:
            return None
        mass, moments = element.first("mass"), element.first("inertia")
        (weight,) = self.numbers(mass, "value", 1) if mass is not None else [0.0]
        values = (
            [self.numbers(moments, key, 1, "0")[0] for key in INERTIA_MOMENTS]
            if moments is not None
            else [0.0] * 6
        )
        if weight < 0:
            self.note(
                element, f"link '{link.get('name')}' has a mass below zero", "give its mass in kg"
            )
        xx, xy, xz, yy, yz, zz = values
        return Inertia(weight, self.origin(element), (xx, xy, xz, yy, yz, zz))

    def origin(self, element: XmlElement) -> Pose:
        """The pose in its `<origin>`."""
        origin = element.first("origin")
        if origin is None:
            return Pose()
        return Pose(self.vector(origin, "xyz", "0 0 0"), self.vector(origin, "rpy", "0 0 0"))

    def vector(self, element: XmlElement, key: str, default: str) -> Vector:
        """Three numbers of an attribute."""
        x, y, z = self.numbers(element, key, 3, default)
        return (x, y, z) if self._finite(element, x, y, z) else (0.0, 0.0, 0.0)

    def _finite(self, element: XmlElement, *values: float) -> bool:
        """Whether numbers are not larger than those of any cell; reported if they are."""
        if max(map(abs, values)) <= MAX_MAGNITUDE:
            return True
        hint = "URDF has metres and radians"
        self.findings.add(
            element.where, "K113", f"a <{element.tag}> larger than {MAX_MAGNITUDE:g}", hint
        )
        return False

    def numbers(self, element: XmlElement, key: str, count: int, default: str = "") -> list[float]:
        """`count` finite numbers in an attribute.

        Another number of values is reported, and the result is zeros.
        """
        text = element.get(key, default)
        try:
            values = [read_decimal(part, MAX_URDF_NUMBER) for part in text.split()]
        except NumberError:
            values = []
        if len(values) != count or not all(map(math.isfinite, values)):
            self.note(
                element,
                f'{key}="{text[:40]}" is not {count} finite numbers',
                "separate them by blanks",
            )
            return [0.0] * count
        return values


MOVING_JOINTS = {
    "revolute": JointKind.REVOLUTE,
    "continuous": JointKind.REVOLUTE,
    "prismatic": JointKind.PRISMATIC,
}


@dataclass(frozen=True, slots=True)
class Description:
    """A robot as its file describes it: links with shapes, and joints by their child link."""

    name: str
    links: dict[str, tuple[PlacedShape, ...]]
    inertias: dict[str, Inertia | None]
    joints: dict[str, XmlElement]  # child link: joint element
    where: Source


def read_urdf(urdf: YamlNode, entry: YamlNode, read: QuantityReader) -> Arm:
    """The arm of a `cell.yaml` entry with `urdf`, `srdf`, `chain` and `packages`.

    Errors are added to the findings of `read`.
    """
    listed = child_at(entry, "packages")
    findings = read.findings
    packages = [
        path for item in (listed.value if listed else []) if (path := read.file(item)) is not None
    ]
    chain = child_at(entry, "chain")
    ends = (chain.value[0].value, chain.value[1].value) if chain else None
    srdf = child_at(entry, "srdf")
    try:
        file = read.file(urdf)
        return (
            Arm("", ())
            if file is None
            else urdf_arm(file, read.file(srdf) if srdf else None, ends, packages, findings)
        )
    except InvalidInput as error:
        for diagnostic in error.diagnostics:
            if diagnostic not in findings.diagnostics:
                findings.note(diagnostic)
        return Arm("", ())


def urdf_arm(
    urdf: Path,
    srdf: Path | None,
    ends: tuple[str, str] | None,
    packages: list[Path],
    findings: LoadFindings,
) -> Arm:
    """The serial arm between two links of a URDF (by default the longest chain).

    Raises `InvalidInput`.
    """
    robot = _Robot(ElementReader(findings, [*packages, urdf.parent]))
    description = robot.description(read_xml(read_file(urdf)))
    first, last = ends or robot.longest(description)
    path = robot.path(description, first, last)
    arm = robot.arm(description, path, first)
    return replace(arm, allowed=_allowed_pairs(srdf, arm, findings) | _adjacent_links(description))


@dataclass(frozen=True, slots=True)
class _Robot:
    """Reads one description and reports its errors."""

    read: ElementReader

    def description(self, root: XmlElement) -> Description:
        if root.tag != "robot":
            raise self.read.broken(
                root, f"<{root.tag}> is not a robot", "a URDF begins with <robot>"
            )
        links: dict[str, tuple[PlacedShape, ...]] = {}
        inertias: dict[str, Inertia | None] = {}
        for link in root.all("link"):
            name = link.get("name")
            if not name or name in links:
                self.read.note(
                    link,
                    "a link without a name, or a second one of that name",
                    "name each link once",
                )
            links[name], inertias[name] = self.read.shapes(link), self.read.inertia(link)
        joints: dict[str, XmlElement] = {}
        for joint in root.all("joint"):
            self._joint(joint, links, joints)
        if not links:
            raise self.read.broken(root, "a robot without links", "is this the right file?")
        return Description(root.get("name"), links, inertias, joints, root.where)

    def _joint(
        self,
        joint: XmlElement,
        links: dict[str, tuple[PlacedShape, ...]],
        joints: dict[str, XmlElement],
    ) -> None:
        parent, below = _joint_end(joint, "parent"), _joint_end(joint, "child")
        if joint.get("type") not in {*MOVING_JOINTS, "fixed", "floating", "planar"}:
            self.read.note(
                joint, f"unknown joint type '{joint.get('type')}'", "revolute, prismatic or fixed"
            )
        for name in (parent, below):
            if name not in links:
                self.read.note(
                    joint, f"joint '{joint.get('name')}' names no link '{name}'", "declare the link"
                )
        if below in joints:
            self.read.note(joint, f"link '{below}' has two parent joints", "a robot is a tree")
        joints[below] = joint

    def longest(self, description: Description) -> tuple[str, str]:
        """The chain with the most moving joints; if several are equal, the first in the file."""
        chains = {name: self._ancestry(description, name) for name in description.links}
        moving = {
            name: sum(_is_moving(description.joints[link]) for link in chain)
            for name, chain in chains.items()
        }
        most = max(moving.values())
        last = min(
            (name for name in moving if moving[name] == most), key=lambda name: len(chains[name])
        )
        chain = chains[last]
        return (_joint_end(description.joints[chain[0]], "parent") if chain else last), last

    def _ancestry(self, description: Description, link: str) -> list[str]:
        """The links on the way from the root down to `link`, without the root.

        Raises `InvalidInput` for a circle.
        """
        chain: list[str] = []
        while link in description.joints:
            if link in chain:
                raise self.read.broken(
                    description.joints[link],
                    f"link '{link}' is its own ancestor",
                    "a robot is a tree",
                )
            chain.append(link)
            link = _joint_end(description.joints[link], "parent")
        return chain[::-1]

    def path(self, description: Description, first: str, last: str) -> list[str]:
        """The links after `first` down to `last`.

        Raises `InvalidInput` if there is no such chain.
        """
        for name in (first, last):
            if name not in description.links:
                near = ", ".join(list(description.links)[:12])
                raise self.read.broken(
                    XmlElement("", {}, description.where),
                    f"the robot has no link '{name}'",
                    f"it has: {near}",
                )
        chain = self._ancestry(description, last)
        if first in chain:
            return chain[chain.index(first) + 1 :]
        if chain and _joint_end(description.joints[chain[0]], "parent") == first:
            return chain
        raise self.read.broken(
            XmlElement("", {}, description.where),
            f"no chain from '{first}' to '{last}'",
            "check `chain`",
        )

    def arm(self, description: Description, path: list[str], first: str) -> Arm:
        """The arm with the moving joints of a chain.

        Rigid poses between them become part of origins, links and flange.
        """
        joints: list[Joint] = []
        rigid: list[Pose] = []
        frames: dict[str, tuple[int, tuple[Pose, ...]]] = {first: (0, ())}
        for link in path:
            joint = description.joints[link]
            rigid.append(self.read.origin(joint))
            if _is_moving(joint):
                joints.append(self._moving(joint, tuple(rigid)))
                rigid = []
            frames[link] = (len(joints), tuple(rigid))
        self._hang(description, frames)
        links = tuple(
            Link(name, frames[name][0], frames[name][1], shapes, description.inertias[name])
            for name, shapes in description.links.items()
            if name in frames
        )
        return Arm(description.name, tuple(joints), links, tuple(rigid))

    def _hang(
        self, description: Description, frames: dict[str, tuple[int, tuple[Pose, ...]]]
    ) -> None:
        """Place every link below the chain. Links above or beside the first link are left out."""
        waiting = True
        while waiting:
            waiting = False
            for link, joint in description.joints.items():
                above = _joint_end(joint, "parent")
                if link in frames or above not in frames:
                    continue
                carrier, poses = frames[above]
                frames[link] = (carrier, (*poses, self.read.origin(joint)))
                waiting = True
                if joint.get("type") != "fixed":
                    message = f"joint '{joint.get('name')}' is not on the chain"
                    self.read.findings.add(
                        joint.where, "K703", message, "its value is kept at zero", warning=True
                    )

    def _moving(self, joint: XmlElement, origin: Offsets) -> Joint:
        limit, axis = joint.first("limit"), joint.first("axis")
        kind = MOVING_JOINTS[joint.get("type")]
        bounded = limit is not None and joint.get("type") != "continuous"
        lower, upper, speed, effort = -math.inf, math.inf, None, None
        if limit is not None:
            speed, effort = (self._given(limit, key) for key in ("velocity", "effort"))
            if bounded:
                lower, upper = (
                    self.read.numbers(limit, key, 1, "0")[0] for key in ("lower", "upper")
                )
        elif joint.get("type") != "continuous":
            self.read.note(
                joint, f"joint '{joint.get('name')}' has no limits", "add <limit lower upper/>"
            )
        if lower >= upper:
            self.read.note(
                joint, f"joint '{joint.get('name')}' cannot move", "lower must be below upper"
            )
        direction = self.read.vector(axis, "xyz", "1 0 0") if axis is not None else (1.0, 0.0, 0.0)
        length = math.hypot(*direction)
        if length < 1e-9:
            self.read.note(
                joint, f"joint '{joint.get('name')}' has no axis", "give <axis xyz/> a direction"
            )
            direction, length = (1.0, 0.0, 0.0), 1.0
        x, y, z = (value / length for value in direction)
        follows = self._mimic(joint)
        return Joint(
            joint.get("name"),
            origin,
            (x, y, z),
            kind,
            lower,
            upper,
            speed,
            effort=effort,
            mimic=follows,
        )

    def _given(self, element: XmlElement, key: str) -> float | None:
        return self.read.numbers(element, key, 1)[0] if element.get(key) else None

    def _mimic(self, joint: XmlElement) -> Mimic | None:
        """Which joint a joint follows, and how."""
        mimic = joint.first("mimic")
        if mimic is None:
            return None
        message = (
            f"joint '{joint.get('name')}' follows '{mimic.get('joint')}', but is moved as if it "
            "were free"
        )
        self.read.findings.add(
            joint.where, "K703", message, "end the `chain` before it", warning=True
        )
        (factor,), (offset,) = (
            self.read.numbers(mimic, key, 1, default)
            for key, default in (("multiplier", "1"), ("offset", "0"))
        )
        return Mimic(mimic.get("joint"), factor, offset)


def _joint_end(joint: XmlElement, which: str) -> str:
    element = joint.first(which)
    return element.get("link") if element else ""


def _is_moving(joint: XmlElement) -> bool:
    return joint.get("type") in MOVING_JOINTS


def _adjacent_links(description: Description) -> frozenset[frozenset[str]]:
    """The pairs of links at each joint: they always touch there."""
    return frozenset(
        frozenset((_joint_end(joint, "parent"), link)) for link, joint in description.joints.items()
    )


def _allowed_pairs(
    srdf: Path | None, arm: Arm, findings: LoadFindings
) -> frozenset[frozenset[str]]:
    """The pairs that an SRDF disables. Raises `InvalidInput`."""
    if srdf is None:
        return frozenset()
    root, links = read_xml(read_file(srdf)), {link.name for link in arm.links}
    pairs = set()
    for pair in root.all("disable_collisions"):
        names = {pair.get("link1"), pair.get("link2")}
        for name in sorted(names - links):
            message = f"the SRDF names a link '{name}', which the arm does not have"
            findings.add(pair.where, "K703", message, "is it for this robot?", warning=True)
        pairs.add(frozenset(names))
    return frozenset(pairs)
