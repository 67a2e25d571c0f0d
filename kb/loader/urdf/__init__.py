"""Arms from URDF and SRDF: the chain of joints, everything fixed rigidly to it, and the links that may touch.

Movable joints outside the chain (fingers) are kept at zero, with a warning. As the format requires, lengths are metres and
angles radians. `package://` paths are looked up in the given folders, then beside the file.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path

from cellwright.kb.diagnostics import InvalidInput, Source
from cellwright.kb.loader.quantities import Quantities, child
from cellwright.kb.loader.reader import Findings
from cellwright.kb.loader.tree import Node, read_file
from cellwright.kb.loader.urdf.elements import ElementReader
from cellwright.kb.loader.xml import Element, read_xml
from cellwright.kb.model.cell import Arm, Inertia, Joint, JointKind, Link, Mimic
from cellwright.kb.model.shapes import Offsets, PlacedShape, Pose

MOVING = {"revolute": JointKind.REVOLUTE, "continuous": JointKind.REVOLUTE, "prismatic": JointKind.PRISMATIC}


@dataclass(frozen=True, slots=True)
class Description:
    """A robot as its file describes it: links with shapes, and joints by their child link."""

    name: str
    links: dict[str, tuple[PlacedShape, ...]]
    inertias: dict[str, Inertia | None]
    joints: dict[str, Element]  # child link: joint element
    where: Source


def read_urdf(urdf: Node, entry: Node, read: Quantities) -> Arm:
    """The arm of a `cell.yaml` entry with `urdf`, `srdf`, `chain` and `packages`. Errors are added to the findings of `read`."""
    listed = child(entry, "packages")
    findings = read.findings
    packages = [path for item in (listed.value if listed else []) if (path := read.file(item)) is not None]
    chain = child(entry, "chain")
    ends = (chain.value[0].value, chain.value[1].value) if chain else None
    srdf = child(entry, "srdf")
    try:
        file = read.file(urdf)
        return (
            Arm("", ())
            if file is None
            else arm_of(file, read.file(srdf) if srdf else None, ends, packages, findings)
        )
    except InvalidInput as error:
        for found in error.diagnostics:
            if found not in findings.diagnostics:
                findings.note(found)
        return Arm("", ())


def arm_of(
    urdf: Path,
    srdf: Path | None,
    ends: tuple[str, str] | None,
    packages: list[Path],
    findings: Findings,
) -> Arm:
    """The serial arm between two links of a URDF (by default the longest chain). Raises `InvalidInput`."""
    robot = _Robot(ElementReader(findings, [*packages, urdf.parent]))
    found = robot.description(read_xml(read_file(urdf)))
    first, last = ends or robot.longest(found)
    path = robot.path(found, first, last)
    arm = robot.arm(found, path, first)
    return replace(arm, allowed=_allowed(srdf, arm, findings) | _adjacent(found))


@dataclass(frozen=True, slots=True)
class _Robot:
    """Reads one description and reports its errors."""

    read: ElementReader

    def description(self, root: Element) -> Description:
        if root.tag != "robot":
            raise self.read.broken(root, f"<{root.tag}> is not a robot", "a URDF begins with <robot>")
        links: dict[str, tuple[PlacedShape, ...]] = {}
        inertias: dict[str, Inertia | None] = {}
        for link in root.all("link"):
            name = link.get("name")
            if not name or name in links:
                self.read.note(
                    link, "a link without a name, or a second one of that name", "name each link once"
                )
            links[name], inertias[name] = self.read.shapes(link), self.read.inertia(link)
        joints: dict[str, Element] = {}
        for joint in root.all("joint"):
            self._joint(joint, links, joints)
        if not links:
            raise self.read.broken(root, "a robot without links", "is this the right file?")
        return Description(root.get("name"), links, inertias, joints, root.where)

    def _joint(
        self, joint: Element, links: dict[str, tuple[PlacedShape, ...]], joints: dict[str, Element]
    ) -> None:
        parent, below = _end(joint, "parent"), _end(joint, "child")
        if joint.get("type") not in {*MOVING, "fixed", "floating", "planar"}:
            self.read.note(joint, f"unknown joint type '{joint.get('type')}'", "revolute, prismatic or fixed")
        for name in (parent, below):
            if name not in links:
                self.read.note(
                    joint, f"joint '{joint.get('name')}' names no link '{name}'", "declare the link"
                )
        if below in joints:
            self.read.note(joint, f"link '{below}' has two parent joints", "a robot is a tree")
        joints[below] = joint

    def longest(self, found: Description) -> tuple[str, str]:
        """The chain with the most moving joints; if several are equal, the first in the file."""
        chains = {name: self._ancestry(found, name) for name in found.links}
        moving = {name: sum(_moves(found.joints[each]) for each in chain) for name, chain in chains.items()}
        most = max(moving.values())
        last = min((name for name in moving if moving[name] == most), key=lambda name: len(chains[name]))
        chain = chains[last]
        return (_end(found.joints[chain[0]], "parent") if chain else last), last

    def _ancestry(self, found: Description, link: str) -> list[str]:
        """The links on the way from the root down to `link`, without the root. Raises `InvalidInput` for a circle."""
        chain: list[str] = []
        while link in found.joints:
            if link in chain:
                raise self.read.broken(
                    found.joints[link], f"link '{link}' is its own ancestor", "a robot is a tree"
                )
            chain.append(link)
            link = _end(found.joints[link], "parent")
        return chain[::-1]

    def path(self, found: Description, first: str, last: str) -> list[str]:
        """The links after `first` down to `last`. Raises `InvalidInput` if there is no such chain."""
        for name in (first, last):
            if name not in found.links:
                near = ", ".join(list(found.links)[:12])
                raise self.read.broken(
                    Element("", {}, found.where), f"the robot has no link '{name}'", f"it has: {near}"
                )
        chain = self._ancestry(found, last)
        if first in chain:
            return chain[chain.index(first) + 1 :]
        if chain and _end(found.joints[chain[0]], "parent") == first:
            return chain
        raise self.read.broken(
            Element("", {}, found.where), f"no chain from '{first}' to '{last}'", "check `chain`"
        )

    def arm(self, found: Description, path: list[str], first: str) -> Arm:
        """The arm with the moving joints of a chain. Rigid poses between them become part of origins, links and flange."""
        joints: list[Joint] = []
        rigid: list[Pose] = []
        frames: dict[str, tuple[int, tuple[Pose, ...]]] = {first: (0, ())}
        for link in path:
            joint = found.joints[link]
            rigid.append(self.read.origin(joint))
            if _moves(joint):
                joints.append(self._moving(joint, tuple(rigid)))
                rigid = []
            frames[link] = (len(joints), tuple(rigid))
        self._hang(found, frames)
        links = tuple(
            Link(name, frames[name][0], frames[name][1], shapes, found.inertias[name])
            for name, shapes in found.links.items()
            if name in frames
        )
        return Arm(found.name, tuple(joints), links, tuple(rigid))

    def _hang(self, found: Description, frames: dict[str, tuple[int, tuple[Pose, ...]]]) -> None:
        """Place every link below the chain. Links above or beside the first link are left out."""
        waiting = True
        while waiting:
            waiting = False
            for link, joint in found.joints.items():
                above = _end(joint, "parent")
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

    def _moving(self, joint: Element, origin: Offsets) -> Joint:
        limit, axis = joint.first("limit"), joint.first("axis")
        kind = MOVING[joint.get("type")]
        bounded = limit is not None and joint.get("type") != "continuous"
        lower, upper, speed, effort = -math.inf, math.inf, None, None
        if limit is not None:
            speed, effort = (self._given(limit, key) for key in ("velocity", "effort"))
            if bounded:
                lower, upper = (self.read.numbers(limit, key, 1, "0")[0] for key in ("lower", "upper"))
        elif joint.get("type") != "continuous":
            self.read.note(joint, f"joint '{joint.get('name')}' has no limits", "add <limit lower upper/>")
        if lower >= upper:
            self.read.note(joint, f"joint '{joint.get('name')}' cannot move", "lower must be below upper")
        direction = self.read.vector(axis, "xyz", "1 0 0") if axis is not None else (1.0, 0.0, 0.0)
        length = math.hypot(*direction)
        if length < 1e-9:
            self.read.note(joint, f"joint '{joint.get('name')}' has no axis", "give <axis xyz/> a direction")
            direction, length = (1.0, 0.0, 0.0), 1.0
        x, y, z = (value / length for value in direction)
        follows = self._mimic(joint)
        return Joint(
            joint.get("name"), origin, (x, y, z), kind, lower, upper, speed, effort=effort, mimic=follows
        )

    def _given(self, element: Element, key: str) -> float | None:
        return self.read.numbers(element, key, 1)[0] if element.get(key) else None

    def _mimic(self, joint: Element) -> Mimic | None:
        """Which joint a joint follows, and how."""
        mimic = joint.first("mimic")
        if mimic is None:
            return None
        message = (
            f"joint '{joint.get('name')}' follows '{mimic.get('joint')}', but is moved as if it were free"
        )
        self.read.findings.add(joint.where, "K703", message, "end the `chain` before it", warning=True)
        (factor,), (offset,) = (
            self.read.numbers(mimic, key, 1, default)
            for key, default in (("multiplier", "1"), ("offset", "0"))
        )
        return Mimic(mimic.get("joint"), factor, offset)


def _end(joint: Element, which: str) -> str:
    element = joint.first(which)
    return element.get("link") if element else ""


def _moves(joint: Element) -> bool:
    return joint.get("type") in MOVING


def _adjacent(found: Description) -> frozenset[frozenset[str]]:
    """The pairs of links at each joint: they always touch there."""
    return frozenset(frozenset((_end(joint, "parent"), link)) for link, joint in found.joints.items())


def _allowed(srdf: Path | None, arm: Arm, findings: Findings) -> frozenset[frozenset[str]]:
    """The pairs that an SRDF disables. Raises `InvalidInput`."""
    if srdf is None:
        return frozenset()
    root, links = read_xml(read_file(srdf)), {link.name for link in arm.links}
    found = set()
    for pair in root.all("disable_collisions"):
        names = {pair.get("link1"), pair.get("link2")}
        for name in sorted(names - links):
            message = f"the SRDF names a link '{name}', which the arm does not have"
            findings.add(pair.where, "K703", message, "is it for this robot?", warning=True)
        found.add(frozenset(names))
    return frozenset(found)
