"""The `locations` of a `cell.yaml`: how facts of the domain place bodies."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.quantities import ANGLE, LENGTH, Quantities, child, required
from cellwright.kb.loader.reader import Findings, Reader
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.cell import Body, JointKind, Location
from cellwright.kb.terms import Function, Term, Variable, is_ground, variables


@dataclass(frozen=True, slots=True)
class Known:
    """The names that an entry may use."""

    bodies: Mapping[str, Body]
    places: Collection[str]
    frames: Collection[str]


def read_locations(reader: Reader, read: Quantities, known: Known) -> tuple[Location, ...]:
    """The entries in their order. Errors are added to the findings of `read`."""
    found = []
    for _, key, node in reader.entries("locations"):
        fact = reader.parse("atom", key)
        if fact is not None:
            entry = _Entry(reader, read, known, fact.value)
            location = entry.location(key, node)
            found += [location] if location else []
    return tuple(found)


@dataclass(frozen=True, slots=True)
class _Entry:
    """Reads one entry."""

    reader: Reader
    read: Quantities
    known: Known
    fact: Function

    @property
    def findings(self) -> Findings:
        """Where errors are added."""
        return self.read.findings

    def location(self, key: Node, node: Node) -> Location | None:
        place, frame, joint = (child(node, each) for each in ("place", "in", "joint"))
        if sum(each is not None for each in (place, frame, joint)) != 1:
            message, hint = (
                "this entry gives the body no place, or two",
                "give one of `place`, `in` and `joint`",
            )
            self.findings.add(node.where, "K005", message, hint)
            return None
        body = self._term(required(node, "body"), "body", self.known.bodies)
        where = self._term(place, "place", self.known.places) if place else None
        if frame is not None:
            self._check_frame(frame)
        if body is None or (place is not None and where is None):
            return None
        value = self._value(str(body), joint) if joint is not None else None
        by = self._feature(str(body), child(node, "by"))
        return Location(self.fact, body, where, frame.value if frame else "", key.where, value, by)

    def _feature(self, body: str, node: Node | None) -> str:
        """The name of a feature of the body; where the body is a variable, of any body."""
        if node is None:
            return ""
        own = [self.known.bodies[body]] if body in self.known.bodies else self.known.bodies.values()
        features = {name for each in own for name in each.features}
        if node.value not in features:
            self.findings.note(unknown_name("feature", node.value, features, node.where))
        return str(node.value)

    def _value(self, body: str, joint: Node) -> float:
        """How far the body goes along its joint, in m or rad."""
        known = self.known.bodies.get(body)
        guide = known.guide if known is not None else None
        if guide is None:
            message = f"'{body}' has no joint that it could move along"
            self.findings.add(joint.where, "K707", message, "give the body a `joint`, or name one that has")
            return 0.0
        value = self.read.number(joint, ANGLE if guide.kind is JointKind.REVOLUTE else LENGTH)
        if not guide.lower - 1e-9 <= value <= guide.upper + 1e-9:
            hint = "change the value, or the `range` of the joint"
            self.findings.add(joint.where, "K707", f"this is beyond the range of the joint of '{body}'", hint)
        return value

    def _term(self, node: Node, kind: str, known: Collection[str]) -> Term | None:
        """A term whose variables occur in the fact. A term without variables must be known."""
        parsed = self.reader.parse("term", node)
        if parsed is None:
            return None
        term: Term = parsed.value
        for variable in variables(term):
            self._check_variable(variable.name, node)
        if is_ground(term) and str(term) not in known:
            self.findings.note(unknown_name(kind, str(term), known, node.where))
        return term

    def _check_frame(self, node: Node) -> None:
        first = node.value.partition(".")[0]
        if first[:1].isupper():
            self._check_variable(first, node)
        elif node.value not in self.known.frames:
            self.findings.note(unknown_name("frame", node.value, self.known.frames, node.where))

    def _check_variable(self, name: str, node: Node) -> None:
        if Variable(name) not in set(variables(self.fact)):
            hint = f"use a variable of the fact {self.fact}"
            self.findings.add(node.where, "K105", f"the fact has no variable '{name}'", hint)
