"""Where things of a cell are: its frames, the guides of its bodies, and its places."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.geometry_values import ANGLE, FACTOR, LENGTH, QuantityReader
from cellwright.kb.loader.reader import LoadFindings, Reader
from cellwright.kb.loader.yaml_tree import YamlNode, child_at, required_child
from cellwright.kb.model.body_shapes import Vector
from cellwright.kb.model.cell_model import (
    TOUCH_DEPTH_M,
    Body,
    Guide,
    JointKind,
    MountedArm,
    Place,
    Placement,
)
from cellwright.kb.model.domain_model import WORLD_FRAME
from cellwright.kb.terms import Function


def read_placement(node: YamlNode, read: QuantityReader) -> Placement:
    """The pose of an entry, and the frame that it is given in, which need not be known."""
    parent = child_at(node, "in")
    where = parent.where if parent else node.where
    return Placement(parent.value if parent else WORLD_FRAME, read.pose(node), where)


@dataclass
class Frames:
    """The frames that were found so far. Wrong references to them are added to `findings`."""

    findings: LoadFindings
    placements: dict[str, Placement] = field(default_factory=dict)

    def names(self) -> Collection[str]:
        """All that something may be placed in."""
        return [WORLD_FRAME, *self.placements]

    def is_known(self, placement: Placement) -> bool:
        """Whether something is placed in a known frame; an unknown one is reported."""
        known = placement.parent == WORLD_FRAME or placement.parent in self.placements
        if not known:
            where = placement.where
            self.findings.note(unknown_name("frame", placement.parent, self.names(), where))
        return known

    def add(
        self,
        arms: Mapping[str, MountedArm],
        frames: Mapping[str, Placement],
        bodies: Mapping[str, Body],
    ) -> None:
        """Collect every frame by name, then check that each is placed in a known frame and none
        in itself.
        """
        self.placements |= dict(_of_arms(arms))
        self.placements |= frames
        for name, body in bodies.items():
            self.placements[name] = body.placement
            self.placements |= {f"{name}.{feature}": Placement(name) for feature in body.features}
        for name, placement in self.placements.items():
            if self.is_known(placement) and self._is_circular(name):
                hint = "follow `in` from frame to frame: it must end at `world`"
                self.findings.add(
                    placement.where, "K701", f"'{name}' is placed relative to itself", hint
                )

    def _is_circular(self, name: str) -> bool:
        seen, at = set[str](), name
        while at in self.placements and at not in seen:
            seen.add(at)
            at = self.placements[at].parent
        return at == name


def _of_arms(arms: Mapping[str, MountedArm]) -> Iterator[tuple[str, Placement]]:
    for name, arm in arms.items():
        for frame in ("flange", "tool", *(link.name for link in arm.arm.links)):
            yield f"{name}.{frame}", Placement(f"{name}.base")
        yield f"{name}.base", arm.base  # a link of this name may be elsewhere


KILOGRAMS = {"": 1.0, "kg": 1.0, "g": 0.001}


def read_guide(node: YamlNode | None, read: QuantityReader) -> Guide | None:
    """The guide of a body; None if none is given, or one that is reported."""
    if node is None:
        return None
    slides, swings = child_at(node, "slides"), child_at(node, "swings")
    axis = slides if slides is not None else swings
    if axis is None or (slides is None) == (swings is None):
        read.findings.add(
            node.where, "K005", "a joint slides or swings", "give one of `slides` and `swings`"
        )
        return None
    kind = JointKind.PRISMATIC if slides is not None else JointKind.REVOLUTE
    unit = LENGTH if slides is not None else ANGLE
    lower, upper = (read.number(item, unit) for item in required_child(node, "range").value)
    if lower > upper:
        read.findings.add(
            node.where, "K707", "the range of the joint is empty", "write the lesser value first"
        )
    follows = child_at(node, "follows")
    leader, where = (follows.value, follows.where) if follows else ("", node.where)
    return Guide(kind, _unit_vector(axis, read), lower, upper, leader, where)


def _unit_vector(node: YamlNode, read: QuantityReader) -> Vector:
    x, y, z = (read.number(item, FACTOR) for item in node.value)
    length = (x * x + y * y + z * z) ** 0.5
    if length < 1e-9:
        read.findings.add(
            node.where, "K707", "this direction has no length", "write [0, 0, 1] for z"
        )
        return (0.0, 0.0, 1.0)
    return (x / length, y / length, z / length)


def read_plain(node: YamlNode | None) -> float | None:
    """A mass in kg, or a number without a unit; None if none is given."""
    if node is None:
        return None
    number = str(node.value).rstrip("kg ")
    return float(number) * KILOGRAMS[str(node.value)[len(number) :].strip()]


@dataclass(frozen=True, slots=True)
class PlaceNames:
    """What a place may name: frames, arms and bodies."""

    frames: Frames
    arms: Collection[str]
    bodies: Mapping[str, Body]


def read_places(reader: Reader, read: QuantityReader, mentioned: PlaceNames) -> dict[str, Place]:
    """The places by name. What they name and the cell has not is reported."""
    places = _place_entries(reader, read, mentioned)
    return {place.name: place for place in places}


def _place_entries(reader: Reader, read: QuantityReader, mentioned: PlaceNames) -> Iterator[Place]:
    for _, key, node in reader.entries("places"):
        expression = reader.parse("term", key)
        term = expression.value if expression else None
        name = str(term) if isinstance(term, Function) else str(key.value)
        yield _read_place(name, key, node, read, mentioned)


def _read_place(
    name: str, key: YamlNode, node: YamlNode, read: QuantityReader, mentioned: PlaceNames
) -> Place:
    placement = read_placement(node, read)
    mentioned.frames.is_known(placement)
    approach, turns, depth = (
        child_at(node, "approach"),
        child_at(node, "turns"),
        child_at(node, "depth"),
    )
    touches = child_at(node, "touches")
    touched = touches.value if touches else []
    for item in touched:
        if item.value not in mentioned.bodies:
            read.findings.note(unknown_name("body", item.value, mentioned.bodies, item.where))
    return Place(
        name,
        Placement(placement.parent, placement.pose, key.where),
        _place_arm(key, node, read, mentioned.arms),
        _place_tool(node, read, mentioned.bodies),
        read.number(approach) if approach else 0.0,
        turns is not None and turns.value == "true",
        tuple(item.value for item in touched),
        read.number(depth) if depth else TOUCH_DEPTH_M,
    )


def _place_arm(key: YamlNode, node: YamlNode, read: QuantityReader, arms: Collection[str]) -> str:
    arm_node = child_at(node, "arm")
    if arm_node is not None:
        if arm_node.value not in arms:
            read.findings.note(unknown_name("arm", arm_node.value, arms, arm_node.where))
        return str(arm_node.value)
    if len(arms) != 1:
        read.findings.add(key.where, "K005", "the arm for this place is not given", "give `arm`")
        return ""
    return next(iter(arms))


def _place_tool(node: YamlNode, read: QuantityReader, bodies: Mapping[str, Body]) -> str:
    tool_node = child_at(node, "tool")
    if tool_node is None:
        return ""
    is_tool(str(tool_node.value), tool_node, read, bodies)
    return str(tool_node.value)


def is_tool(name: str, at: YamlNode, read: QuantityReader, bodies: Mapping[str, Body]) -> bool:
    """Whether a body is a tool with a tip; another one is reported."""
    tools = {name for name, body in bodies.items() if "tip" in body.features}
    if name not in tools:
        read.findings.note(unknown_name("tool with a `tip`", name, tools, at.where))
    return name in tools
