"""What ties a cell to its domain: facts that place bodies, and what arms do in steps."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from fractions import Fraction

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.geometry_values import ANGLE, LENGTH, QuantityReader
from cellwright.kb.loader.reader import LoadFindings, Reader
from cellwright.kb.loader.yaml_tree import YamlNode, child_at, required_child
from cellwright.kb.model.cell_model import Body, Ends, JointKind, Location, Operation
from cellwright.kb.syntax import SECONDS_PER_UNIT
from cellwright.kb.terms import Function, Term, Variable, is_ground, term_variables


@dataclass(frozen=True, slots=True)
class CellNames:
    """The names that an entry may use."""

    bodies: Mapping[str, Body]
    places: Collection[str]
    frames: Collection[str]


def read_locations(reader: Reader, read: QuantityReader, known: CellNames) -> tuple[Location, ...]:
    """The entries in their order. Errors are added to the findings of `read`."""
    locations = []
    for _, key, node in reader.entries("locations"):
        fact = reader.parse("atom", key)
        if fact is not None:
            entry = _Entry(reader, read, known, fact.value)
            location = entry.location(key, node)
            locations += [location] if location else []
    return tuple(locations)


@dataclass(frozen=True, slots=True)
class _Entry:
    """Reads one entry."""

    reader: Reader
    read: QuantityReader
    known: CellNames
    fact: Function

    @property
    def findings(self) -> LoadFindings:
        """Where errors are added."""
        return self.read.findings

    def location(self, key: YamlNode, node: YamlNode) -> Location | None:
        place, frame, joint = (child_at(node, key) for key in ("place", "in", "joint"))
        if sum(option is not None for option in (place, frame, joint)) != 1:
            message, hint = (
                "this entry gives the body no place, or two",
                "give one of `place`, `in` and `joint`",
            )
            self.findings.add(node.where, "K005", message, hint)
            return None
        body = self._term(required_child(node, "body"), "body", self.known.bodies)
        where = self._term(place, "place", self.known.places) if place else None
        if frame is not None:
            self._check_frame(frame)
        if body is None or (place is not None and where is None):
            return None
        value = self._value(str(body), joint) if joint is not None else None
        by = self._feature(str(body), child_at(node, "by"))
        return Location(self.fact, body, where, frame.value if frame else "", key.where, value, by)

    def _feature(self, body: str, node: YamlNode | None) -> str:
        """The name of a feature of the body; where the body is a variable, of any body."""
        if node is None:
            return ""
        own = [self.known.bodies[body]] if body in self.known.bodies else self.known.bodies.values()
        features = {name for own_body in own for name in own_body.features}
        if node.value not in features:
            self.findings.note(unknown_name("feature", node.value, features, node.where))
        return str(node.value)

    def _value(self, body: str, joint: YamlNode) -> float:
        """How far the body goes along its joint, in m or rad."""
        known = self.known.bodies.get(body)
        guide = known.guide if known is not None else None
        if guide is None:
            message = f"'{body}' has no joint that it could move along"
            self.findings.add(
                joint.where, "K707", message, "give the body a `joint`, or name one that has"
            )
            return 0.0
        value = self.read.number(joint, ANGLE if guide.kind is JointKind.REVOLUTE else LENGTH)
        if not guide.lower - 1e-9 <= value <= guide.upper + 1e-9:
            hint = "change the value, or the `range` of the joint"
            self.findings.add(
                joint.where, "K707", f"this is beyond the range of the joint of '{body}'", hint
            )
        return value

    def _term(self, node: YamlNode, kind: str, known: Collection[str]) -> Term | None:
        """A term whose variables occur in the fact. A term without variables must be known."""
        parsed = self.reader.parse("term", node)
        if parsed is None:
            return None
        term: Term = parsed.value
        for variable in term_variables(term):
            self._check_variable(variable.name, node)
        if is_ground(term) and str(term) not in known:
            self.findings.note(unknown_name(kind, str(term), known, node.where))
        return term

    def _check_frame(self, node: YamlNode) -> None:
        first = node.value.partition(".")[0]
        if first[:1].isupper():
            self._check_variable(first, node)
        elif node.value not in self.known.frames:
            self.findings.note(unknown_name("frame", node.value, self.known.frames, node.where))

    def _check_variable(self, name: str, node: YamlNode) -> None:
        if Variable(name) not in set(term_variables(self.fact)):
            hint = f"use a variable of the fact {self.fact}"
            self.findings.add(node.where, "K105", f"the fact has no variable '{name}'", hint)


def read_operations(
    reader: Reader, findings: LoadFindings, known: CellNames
) -> tuple[Operation, ...]:
    """The entries in their order. Errors are added to `findings`."""
    operations = []
    for _, key, node in reader.entries("operations"):
        operator = reader.parse("atom", key)
        if operator is not None:
            operations.append(_read_operation(reader, findings, known, operator.value, key, node))
    return tuple(operations)


def _read_operation(
    reader: Reader,
    findings: LoadFindings,
    known: CellNames,
    operator: Function,
    key: YamlNode,
    node: YamlNode,
) -> Operation:
    at = child_at(node, "at")
    row = (at.value if at is not None and isinstance(at.value, list) else [at]) or [None]
    place, *more = (_operation_place(reader, findings, known, operator, stop) for stop in row)
    then = tuple(stop for stop in more if stop is not None)
    beside = child_at(node, "with")
    second_place, carried = (
        _operation_place(reader, findings, known, operator, beside),
        child_at(node, "carries"),
    )
    if (beside is not None and at is None) or (carried is not None and beside is None):
        findings.add(
            node.where,
            "K005",
            "two arms need two places",
            "give `at` and `with`: where each of them goes",
        )
    ends = child_at(node, "ends")
    drags, drives = (
        _moving_body(child_at(node, field), findings, known) for field in ("drags", "drives")
    )
    if at is None and drags:
        findings.add(
            node.where,
            "K005",
            "nothing is dragged without a place",
            "give `at`: where it is gripped",
        )
    if then:
        _check_row(node, findings)
    takes = _duration_s(child_at(node, "takes"))
    stop = Ends(ends.value if ends else "outside")
    load = None if carried is None else _carried_body(reader, findings, known, operator, carried)
    return Operation(
        operator, place, stop, drags, drives, takes, key.where, second_place, load, then
    )


def _check_row(node: YamlNode, findings: LoadFindings) -> None:
    """Report what an operation with several places in a row cannot have."""
    for field in ("with", "carries", "drags", "drives"):
        other = child_at(node, field)
        if other is not None:
            findings.add(
                other.where,
                "K005",
                f"`{field}` needs one place, and `at` has several in a row",
                "make it an operator of its own",
            )


def _operation_place(
    reader: Reader,
    findings: LoadFindings,
    known: CellNames,
    operator: Function,
    node: YamlNode | None,
) -> Term | None:
    """A place of the cell, perhaps with variables of the operator; None if none is given."""
    if node is None:
        return None
    parsed = reader.parse("term", node)
    place: Term | None = parsed.value if parsed else None
    _check_place(operator, place, node, findings, known)
    return place


def _carried_body(
    reader: Reader, findings: LoadFindings, known: CellNames, operator: Function, node: YamlNode
) -> Term | None:
    """The body that two arms carry: one of the cell, or a variable of the operator."""
    parsed = reader.parse("term", node)
    if parsed is None:
        return None
    load: Term = parsed.value
    if is_ground(load) and str(load) not in known.bodies:
        findings.note(unknown_name("body", str(load), known.bodies, node.where))
    _check_place(operator, None if is_ground(load) else load, node, findings, known)
    return load


def _duration_s(node: YamlNode | None) -> float:
    """A time in s; 0 if none is given."""
    if node is None:
        return 0.0
    number = str(node.value).rstrip("mins ")
    return float(Fraction(number) * SECONDS_PER_UNIT[str(node.value)[len(number) :].strip() or "s"])


def _check_place(
    operator: Function, place: Term | None, node: YamlNode, findings: LoadFindings, known: CellNames
) -> None:
    """Report a place that the cell has not, and a variable that the operator has not."""
    if place is None:
        return
    own = set(term_variables(operator))
    for variable in term_variables(place):
        if Variable(variable.name) not in own:
            hint = f"use a variable of the operator {operator}"
            findings.add(
                node.where, "K105", f"the operator has no variable '{variable.name}'", hint
            )
    if is_ground(place) and str(place) not in known.places:
        findings.note(unknown_name("place", str(place), known.places, node.where))


def _moving_body(node: YamlNode | None, findings: LoadFindings, known: CellNames) -> str:
    """The name of a body with a joint; empty if none is given."""
    if node is None:
        return ""
    moving = {name: body for name, body in known.bodies.items() if body.guide is not None}
    if node.value not in moving:
        findings.note(unknown_name("body with a joint", node.value, moving, node.where))
    return str(node.value)
