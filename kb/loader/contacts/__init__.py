"""The contact model in `contacts.yaml`. All its names are checked, those of the domain beside it, too."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, unknown_name
from cellwright.kb.loader.contacts.templates import Templates
from cellwright.kb.loader.domain import read_beside
from cellwright.kb.loader.inference import Typing
from cellwright.kb.loader.names import Names
from cellwright.kb.loader.quantities import Quantities, child, members
from cellwright.kb.loader.reader import Findings, Reader, require
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.contacts import (
    GROUND,
    AnchorPoint,
    ConditionKind,
    ContactClass,
    ContactModel,
    Meaning,
    ObjectClass,
    OneWay,
    PermanentContact,
    Relevance,
    Restriction,
    Undesirable,
)
from cellwright.kb.model.domain import Domain, Kind
from cellwright.kb.model.shapes import Pose
from cellwright.kb.targets import CONTACTS_FILE
from cellwright.kb.terms import Atom


def load_contacts(domain: Path) -> tuple[ContactModel, tuple[Diagnostic, ...]]:
    """The contact model beside a domain file, and warnings. Raises `InvalidInput` with all errors."""
    reader, known, names = read_beside(domain, CONTACTS_FILE, "contacts", "contact model")
    model = _ContactReader(reader, known, names).model(str(domain.with_name(CONTACTS_FILE)))
    require(reader.findings)
    return model, reader.findings.warnings()


class _ContactReader:
    """Reads one contact model: classes first, then objects, then what speaks of both."""

    def __init__(self, reader: Reader, domain: Domain, names: Names) -> None:
        self.reader, self.domain, self.names = reader, domain, names
        self.findings = reader.findings
        units = reader.root.descend(("units",))
        given = {key: str(node.value) for key, _, node in members(units)} if units is not reader.root else {}
        self.read = Quantities(self.findings, Path(), given.get("length", "m"), given.get("angle", "deg"))

    def model(self, path: str) -> ContactModel:
        self._known("domain", self.reader.root.descend(("contacts",)), [self.domain.name])
        classes = self._classes()
        objects = self._objects(classes)
        templates = Templates(self.findings, classes, objects)
        contact_classes = self._contact_classes(templates)
        templates.contact_classes = contact_classes
        return ContactModel(
            self.domain.name,
            classes,
            objects,
            contact_classes,
            self._permanent(objects),
            tuple(templates.instances(self.reader.items("initial"))),
            tuple(self._undesirable(templates)),
            tuple(self._relevance(templates)),
            tuple(self._restrictions(templates)),
            tuple(self._meanings(templates)),
            tuple(self._processes()),
            tuple(str(node.value) for node in self.reader.items("filters")) or ("stability", "templates"),
            self.reader.text("gravity") != "false",
            self._bodies(objects),
            path,
        )

    def _known(self, kind: str, node: Node, known: "Mapping[str, object] | list[str]") -> bool:
        if node.value in known:
            return True
        self.findings.note(unknown_name(kind, str(node.value), list(known), node.where))
        return False

    def _classes(self) -> dict[str, ObjectClass]:
        own = {name: (key, node) for name, key, node in self.reader.entries("classes")}
        found: dict[str, ObjectClass] = {}
        for name, (key, _) in own.items():
            lineage = self._lineage(name, own)
            anchors: dict[str, AnchorPoint] = {}
            for each in reversed(lineage):
                anchors |= dict(self._anchors(own[each][1], each == name))
            found[name] = ObjectClass(name, tuple(lineage), anchors, key.where)
        self._one_side(found)
        return found

    def _lineage(self, name: str, own: Mapping[str, tuple[Node, Node]]) -> list[str]:
        lineage = [name]
        while (parent := child(own[lineage[-1]][1], "parent")) is not None:
            first = len(lineage) == 1
            if parent.value not in own:
                if first:
                    self._known("object class", parent, list(own))
                break
            if parent.value in lineage:
                if first or parent.value == name:
                    self.findings.add(
                        parent.where, "K109", f"'{name}' is above itself", "remove one `parent`"
                    )
                break
            lineage.append(str(parent.value))
        return lineage

    def _anchors(self, node: Node, report: bool) -> Iterator[tuple[str, AnchorPoint]]:
        findings = self.findings if report else Findings()
        reader = Reader(node, findings)
        for names, key, entry in members(child(node, "anchors")):
            kinds = {each: str(found.value) for each in ("key", "lock") if (found := child(entry, each))}
            if len(kinds) != 1:
                findings.add(
                    key.where, "K005", "an anchor point is a key or a lock", "give either `key` or `lock`"
                )
                continue
            ((side, anchor_class),) = kinds.items()
            listed = Node([Node(names, key.file, key.start, key.end)], key.file, key.start, key.end)
            for name, _ in reader.names(listed):
                yield name, AnchorPoint(name, anchor_class, side == "key", self.read.pose(entry), key.where)

    def _one_side(self, classes: Mapping[str, ObjectClass]) -> None:
        """Report anchor classes that are keys here and locks there."""
        sides: dict[str, AnchorPoint] = {}
        for each in classes.values():
            for anchor in each.anchors.values():
                first = sides.setdefault(anchor.anchor_class, anchor)
                if first.key != anchor.key:
                    message = f"the anchor class '{anchor.anchor_class}' is a key here and a lock elsewhere"
                    self.findings.add(anchor.where, "K711", message, "give the two sides names of their own")
                    return

    def _objects(self, classes: Mapping[str, ObjectClass]) -> dict[str, str]:
        found: dict[str, str] = {}
        for kind, key, node in self.reader.entries("objects"):
            if not self._known("object class", Node(kind, key.file, key.start, key.end), classes):
                continue
            for name, place in self.reader.once(self.reader.names(node)):
                if name in found or name == GROUND:
                    self.findings.add(
                        place.where, "K104", f"'{name}' is declared already", "rename one of them"
                    )
                else:
                    found[name] = kind
        return found

    def _contact_classes(self, templates: Templates) -> dict[str, ContactClass]:
        found: dict[str, ContactClass] = {}
        entries = list(self.reader.entries("contact_classes"))
        for name, key, node in entries:
            template = templates.of(child(node, "contact"))
            if template is None:
                continue
            over = child(node, "over")
            if over is not None:
                self._known("contact class", over, [each for each, _, _ in entries if each != name])
            found[name] = ContactClass(
                name,
                templates.keyed(template, key),
                _text(node, "make") or "join",
                _text(node, "break") or "part",
                _texts(node, "freedom"),
                _text(node, "controllable") == "true",
                _text(node, "supports") != "false",
                OneWay(_text(node, "one_way")),
                str(over.value) if over is not None else "",
                key.where,
            )
        return found

    def _permanent(self, objects: Mapping[str, str]) -> dict[str, PermanentContact]:
        found = {}
        for name, key, node in self.reader.entries("permanent"):
            if not self.reader.is_name(name, key):
                continue
            first, second = node.value["between"][1].value
            self._known("object", first, [*objects, GROUND])
            self._known("object", second, list(objects))
            by, starts = child(node, "by"), child(node, "starts")
            if by is not None:
                self._known("object", by, objects)
            settings: dict[str, Pose] = {
                each: self.read.pose(value) for each, _, value in members(child(node, "settings"))
            }
            if starts is not None:
                self._known("setting", starts, settings)
            chosen = str(starts.value) if starts is not None else next(iter(settings), "")
            found[name] = PermanentContact(
                name,
                str(first.value),
                str(second.value),
                _texts(node, "freedom"),
                _text(node, "controllable") == "true",
                str(by.value) if by is not None else "",
                settings,
                chosen,
                next(iter(self._atoms(child(node, "fact"))), None),
                key.where,
            )
        return found

    def _bodies(self, objects: Mapping[str, str]) -> dict[str, str]:
        found = {}
        for name, key, node in self.reader.entries("bodies"):
            if self._known("object", Node(name, key.file, key.start, key.end), objects):
                found[name] = str(node.value)
        return found

    def _undesirable(self, templates: Templates) -> Iterator[Undesirable]:
        for name, key, node in self.reader.entries("undesirable"):
            contacts = tuple(filter(None, map(templates.of, node.value["contacts"][1].value)))
            if contacts:
                yield Undesirable(name, contacts, _text(node, "say"), key.where)

    def _relevance(self, templates: Templates) -> Iterator[Relevance]:
        for node in self.reader.items("relevance"):
            contact = templates.of(child(node, "contact"))
            if contact is not None:
                yield Relevance(contact, _text(node, "matters") == "true", templates.of(child(node, "while")))

    def _restrictions(self, templates: Templates) -> Iterator[Restriction]:
        joints = {name: node for name, _, node in self.reader.entries("permanent")}
        for node in self.reader.items("restrictions"):
            contact = templates.of(child(node, "contact"))
            given = [kind for kind in ConditionKind if child(node, kind.value) is not None]
            if len(given) != 1:
                hint = "give exactly one of: joint, sensor, time"
                self.findings.add(node.where, "K005", "a restriction looks at one thing", hint)
                continue
            subject, value = node.value[given[0].value][1], node.value["is"][1]
            if given[0] is ConditionKind.JOINT and self._known("joint", subject, joints):
                settings = child(joints[str(subject.value)], "settings")
                self._known("setting", value, {each: None for each, _, _ in members(settings)})
            if contact is not None:
                during = templates.of(child(node, "while"))
                yield Restriction(contact, given[0], str(subject.value), str(value.value), during)

    def _meanings(self, templates: Templates) -> Iterator[Meaning]:
        for node in self.reader.items("facts"):
            contact = templates.of(child(node, "contact"))
            made, broken = self._atoms(child(node, "made")), self._atoms(child(node, "broken"))
            if contact is not None:
                yield Meaning(contact, made, broken, node.where)

    def _processes(self) -> Iterator[str]:
        operators = [each.name for each in self.domain.operators]
        for node in self.reader.items("processes"):
            if self._known("operator", node, operators):
                yield str(node.value)

    def _atoms(self, node: Node | None) -> tuple[Atom, ...]:
        """Fluents of the domain, checked against their signatures."""
        expression = self.reader.parse("atoms", node) if node is not None else None
        if expression is None:
            return ()
        typing = Typing(self.names, {})
        for atom in expression.value:
            typing.atom(atom, expression, (Kind.FLUENT,))
        return tuple(expression.value)


def _text(node: Node, key: str) -> str:
    given = child(node, key)
    return str(given.value) if given is not None else ""


def _texts(node: Node, key: str) -> tuple[str, ...]:
    given = child(node, key)
    return tuple(str(item.value) for item in given.value) if given is not None else ()
