"""Loads `contacts.yaml`: contacts as octuples (two anchor points of four names), names checked."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, unknown_name
from cellwright.kb.loader.domain_file import read_beside
from cellwright.kb.loader.geometry_values import QuantityReader
from cellwright.kb.loader.reader import LoadFindings, Reader, require_valid
from cellwright.kb.loader.symbol_table import SymbolTable
from cellwright.kb.loader.variable_types import Typing
from cellwright.kb.loader.yaml_tree import YamlNode, child_at, mapping_members
from cellwright.kb.model.body_shapes import Pose
from cellwright.kb.model.contact_model import (
    ANY,
    GROUND_OBJECT,
    AnchorPoint,
    ConditionKind,
    ContactClass,
    ContactModel,
    Meaning,
    NotAnOctuple,
    ObjectClass,
    Octuple,
    OneWay,
    PermanentContact,
    Quadruple,
    Relevance,
    Restriction,
    Undesirable,
    class_of,
    is_variable_name,
    match_quadruple,
    parse_octuple,
)
from cellwright.kb.model.domain_model import Domain, Kind
from cellwright.kb.targets import CONTACTS_FILE
from cellwright.kb.terms import Atom


@dataclass
class ContactTemplates:
    """Reads octuples for one model."""

    findings: LoadFindings
    classes: Mapping[str, ObjectClass]
    objects: Mapping[str, str]
    contact_classes: Mapping[str, ContactClass] = field(default_factory=dict)

    def of(self, node: YamlNode | None) -> Octuple | None:
        """The octuple in a scalar; None if there is none or if it is wrong, which is reported."""
        if node is None:
            return None
        try:
            octuple = parse_octuple(str(node.value), self.classes)
        except NotAnOctuple as error:
            hint = (
                "write class:object.anchor_class:anchor - class:object.anchor_class:anchor, "
                "with * for anything"
            )
            self.findings.add(node.where, "K710", str(error), hint)
            return None
        sound = [
            self._sound(contact_point, node) for contact_point in (octuple.first, octuple.second)
        ]
        return octuple if all(sound) else None

    def _sound(self, point: Quadruple, node: YamlNode) -> bool:
        """Whether every name of an anchor point is known, and some anchor point is what the
        names say.
        """
        for kind, name, known in (
            ("object class", point.object_class, list(self.classes)),
            ("object", point.instance, list(self.objects)),
            (
                "anchor class",
                point.anchor_class,
                sorted({declared_point.anchor_class for _, declared_point in self._points()}),
            ),
            (
                "anchor point",
                point.anchor,
                sorted({declared_point.name for _, declared_point in self._points()}),
            ),
        ):
            if name != ANY and not is_variable_name(name) and name not in known:
                if kind == "object class" or name[:1].islower():
                    self.findings.note(unknown_name(kind, name, known, node.where))
                    return False
            elif kind != "object class" and is_variable_name(name) and kind == "anchor class":
                self.findings.note(unknown_name(kind, name, known, node.where))
                return False
        if any(self._described(point, kind, anchor) for kind, anchor in self._points()):
            return True
        self.findings.add(
            node.where,
            "K711",
            f"no anchor point is '{point}'",
            "look at its class, and at the classes above it",
        )
        return False

    def _points(self) -> Iterator[tuple[str, AnchorPoint]]:
        for kind in self.classes.values():
            for anchor in kind.anchors.values():
                yield kind.name, anchor

    def _described(self, template: Quadruple, kind: str, anchor: AnchorPoint) -> bool:
        instances = [name for name, own_kind in self.objects.items() if own_kind == kind]
        named = (
            template.instance == ANY
            or is_variable_name(template.instance)
            or template.instance in instances
        )
        point = Quadruple(kind, template.instance, anchor.anchor_class, anchor.name)
        return named and match_quadruple(template, point, self.classes[kind].lineage) is not None

    def keyed(self, template: Octuple, key: YamlNode) -> Octuple:
        """The octuple of a contact class with its key first. Two keys or two locks are reported."""
        sides = [self._is_key(side) for side in (template.first, template.second)]
        if sides == [True, False]:
            return template
        if sides == [False, True]:
            return template.turned
        fault = "two keys" if all(sides) else "two locks"
        self.findings.add(
            key.where,
            "K711",
            f"the contact class joins {fault}",
            "keys match locks: see `key` and `lock` of the classes",
        )
        return template

    def _is_key(self, point: Quadruple) -> bool:
        return next(
            (
                declared_point.key
                for kind, declared_point in self._points()
                if self._described(point, kind, declared_point)
            ),
            True,
        )

    def instances(self, nodes: Iterable[YamlNode]) -> Iterator[Octuple]:
        """The contacts of a list, each with its key first. Those that no contact class describes
        are reported.

        So are anchor points that are taken twice.
        """
        taken: dict[Quadruple, YamlNode] = {}
        for node in nodes:
            contact = self.of(node)
            if contact is None:
                continue
            whole = self._whole(contact, node)
            if whole is None:
                continue
            for point in (whole.first, whole.second):
                if point in taken:
                    message = f"the anchor point '{point}' has another contact already"
                    self.findings.add(
                        node.where, "K712", message, "an anchor point has one contact at a time"
                    )
                taken[point] = node
            yield whole

    def _whole(self, contact: Octuple, node: YamlNode) -> Octuple | None:
        points = []
        for contact_point in (contact.first, contact.second):
            if (
                contact_point.instance not in self.objects
                or contact_point.anchor == ANY
                or is_variable_name(contact_point.anchor)
            ):
                self.findings.add(
                    node.where,
                    "K710",
                    f"'{contact_point}' leaves an object open",
                    "the start names each object and anchor point",
                )
                return None
            kind = self.objects[contact_point.instance]
            points.append(
                replace(
                    contact_point,
                    object_class=kind,
                    anchor_class=self.classes[kind].anchors[contact_point.anchor].anchor_class,
                )
            )
        whole = Octuple(*points)
        for turned in (whole, whole.turned):
            if class_of(turned, self.contact_classes, self.classes) is not None:
                return turned
        self.findings.add(
            node.where,
            "K711",
            "no contact class describes this contact",
            f"contact classes: {', '.join(self.contact_classes)}",
        )
        return None


def load_contacts(domain: Path) -> tuple[ContactModel, tuple[Diagnostic, ...]]:
    """The contact model beside a domain file, and warnings.

    Raises `InvalidInput` with all errors.
    """
    reader, known, names = read_beside(domain, CONTACTS_FILE, "contacts", "contact model")
    model = _ContactReader(reader, known, names).model(str(domain.with_name(CONTACTS_FILE)))
    require_valid(reader.findings)
    return model, reader.findings.warnings()


class _ContactReader:
    """Reads one contact model: classes first, then objects, then what speaks of both."""

    def __init__(self, reader: Reader, domain: Domain, names: SymbolTable) -> None:
        self.reader, self.domain, self.names = reader, domain, names
        self.findings = reader.findings
        units = reader.root.descend(("units",))
        unit_texts = (
            {key: str(node.value) for key, _, node in mapping_members(units)}
            if units is not reader.root
            else {}
        )
        self.read = QuantityReader(
            self.findings, Path(), unit_texts.get("length", "m"), unit_texts.get("angle", "deg")
        )

    def model(self, path: str) -> ContactModel:
        self._known("domain", self.reader.root.descend(("contacts",)), [self.domain.name])
        classes = self._classes()
        objects = self._objects(classes)
        templates = ContactTemplates(self.findings, classes, objects)
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
            tuple(str(node.value) for node in self.reader.items("filters"))
            or ("stability", "templates"),
            self.reader.text("gravity") != "false",
            self._bodies(objects),
            path,
        )

    def _known(self, kind: str, node: YamlNode, known: "Mapping[str, object] | list[str]") -> bool:
        if node.value in known:
            return True
        self.findings.note(unknown_name(kind, str(node.value), list(known), node.where))
        return False

    def _classes(self) -> dict[str, ObjectClass]:
        own = {name: (key, node) for name, key, node in self.reader.entries("classes")}
        classes: dict[str, ObjectClass] = {}
        for name, (key, _) in own.items():
            lineage = self._lineage(name, own)
            anchors: dict[str, AnchorPoint] = {}
            for ancestor in reversed(lineage):
                anchors |= dict(self._anchors(own[ancestor][1], ancestor == name))
            classes[name] = ObjectClass(name, tuple(lineage), anchors, key.where)
        self._one_side(classes)
        return classes

    def _lineage(self, name: str, own: Mapping[str, tuple[YamlNode, YamlNode]]) -> list[str]:
        lineage = [name]
        while (parent := child_at(own[lineage[-1]][1], "parent")) is not None:
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

    def _anchors(self, node: YamlNode, report: bool) -> Iterator[tuple[str, AnchorPoint]]:
        findings = self.findings if report else LoadFindings()
        reader = Reader(node, findings)
        for names, key, entry in mapping_members(child_at(node, "anchors")):
            kinds = {
                side: str(side_node.value)
                for side in ("key", "lock")
                if (side_node := child_at(entry, side))
            }
            if len(kinds) != 1:
                findings.add(
                    key.where,
                    "K005",
                    "an anchor point is a key or a lock",
                    "give either `key` or `lock`",
                )
                continue
            ((side, anchor_class),) = kinds.items()
            listed = YamlNode(
                [YamlNode(names, key.file, key.start, key.end)], key.file, key.start, key.end
            )
            for name, _ in reader.names(listed):
                yield (
                    name,
                    AnchorPoint(
                        name, anchor_class, side == "key", self.read.pose(entry), key.where
                    ),
                )

    def _one_side(self, classes: Mapping[str, ObjectClass]) -> None:
        """Report anchor classes that are keys here and locks there."""
        sides: dict[str, AnchorPoint] = {}
        for object_class in classes.values():
            for anchor in object_class.anchors.values():
                first = sides.setdefault(anchor.anchor_class, anchor)
                if first.key != anchor.key:
                    message = (
                        f"the anchor class '{anchor.anchor_class}' is a key here and a lock "
                        "elsewhere"
                    )
                    self.findings.add(
                        anchor.where, "K711", message, "give the two sides names of their own"
                    )
                    return

    def _objects(self, classes: Mapping[str, ObjectClass]) -> dict[str, str]:
        objects: dict[str, str] = {}
        for kind, key, node in self.reader.entries("objects"):
            if not self._known(
                "object class", YamlNode(kind, key.file, key.start, key.end), classes
            ):
                continue
            for name, place in self.reader.once(self.reader.names(node)):
                if name in objects or name == GROUND_OBJECT:
                    self.findings.add(
                        place.where, "K104", f"'{name}' is declared already", "rename one of them"
                    )
                else:
                    objects[name] = kind
        return objects

    def _contact_classes(self, templates: ContactTemplates) -> dict[str, ContactClass]:
        contact_classes: dict[str, ContactClass] = {}
        entries = list(self.reader.entries("contact_classes"))
        for name, key, node in entries:
            template = templates.of(child_at(node, "contact"))
            if template is None:
                continue
            over = child_at(node, "over")
            if over is not None:
                self._known(
                    "contact class",
                    over,
                    [other_class for other_class, _, _ in entries if other_class != name],
                )
            contact_classes[name] = ContactClass(
                name,
                templates.keyed(template, key),
                _child_text(node, "make") or "join",
                _child_text(node, "break") or "part",
                _child_texts(node, "freedom"),
                _child_text(node, "controllable") == "true",
                _child_text(node, "supports") != "false",
                OneWay(_child_text(node, "one_way")),
                str(over.value) if over is not None else "",
                key.where,
            )
        return contact_classes

    def _permanent(self, objects: Mapping[str, str]) -> dict[str, PermanentContact]:
        contacts = {}
        for name, key, node in self.reader.entries("permanent"):
            if not self.reader.is_name(name, key):
                continue
            first, second = node.value["between"][1].value
            self._known("object", first, [*objects, GROUND_OBJECT])
            self._known("object", second, list(objects))
            by, starts = child_at(node, "by"), child_at(node, "starts")
            if by is not None:
                self._known("object", by, objects)
            settings: dict[str, Pose] = {
                setting: self.read.pose(value)
                for setting, _, value in mapping_members(child_at(node, "settings"))
            }
            if starts is not None:
                self._known("setting", starts, settings)
            chosen = str(starts.value) if starts is not None else next(iter(settings), "")
            contacts[name] = PermanentContact(
                name,
                str(first.value),
                str(second.value),
                _child_texts(node, "freedom"),
                _child_text(node, "controllable") == "true",
                str(by.value) if by is not None else "",
                settings,
                chosen,
                next(iter(self._atoms(child_at(node, "fact"))), None),
                key.where,
            )
        return contacts

    def _bodies(self, objects: Mapping[str, str]) -> dict[str, str]:
        bodies = {}
        for name, key, node in self.reader.entries("bodies"):
            if self._known("object", YamlNode(name, key.file, key.start, key.end), objects):
                bodies[name] = str(node.value)
        return bodies

    def _undesirable(self, templates: ContactTemplates) -> Iterator[Undesirable]:
        for name, key, node in self.reader.entries("undesirable"):
            contacts = tuple(filter(None, map(templates.of, node.value["contacts"][1].value)))
            if contacts:
                yield Undesirable(name, contacts, _child_text(node, "say"), key.where)

    def _relevance(self, templates: ContactTemplates) -> Iterator[Relevance]:
        for node in self.reader.items("relevance"):
            contact = templates.of(child_at(node, "contact"))
            if contact is not None:
                yield Relevance(
                    contact,
                    _child_text(node, "matters") == "true",
                    templates.of(child_at(node, "while")),
                )

    def _restrictions(self, templates: ContactTemplates) -> Iterator[Restriction]:
        joints = {name: node for name, _, node in self.reader.entries("permanent")}
        for node in self.reader.items("restrictions"):
            contact = templates.of(child_at(node, "contact"))
            given = [kind for kind in ConditionKind if child_at(node, kind.value) is not None]
            if len(given) != 1:
                hint = "give exactly one of: joint, sensor, time"
                self.findings.add(node.where, "K005", "a restriction looks at one thing", hint)
                continue
            subject, value = node.value[given[0].value][1], node.value["is"][1]
            if given[0] is ConditionKind.JOINT and self._known("joint", subject, joints):
                settings = child_at(joints[str(subject.value)], "settings")
                self._known(
                    "setting", value, {setting: None for setting, _, _ in mapping_members(settings)}
                )
            if contact is not None:
                during = templates.of(child_at(node, "while"))
                yield Restriction(contact, given[0], str(subject.value), str(value.value), during)

    def _meanings(self, templates: ContactTemplates) -> Iterator[Meaning]:
        for node in self.reader.items("facts"):
            contact = templates.of(child_at(node, "contact"))
            made, broken = (
                self._atoms(child_at(node, "made")),
                self._atoms(child_at(node, "broken")),
            )
            if contact is not None:
                yield Meaning(contact, made, broken, node.where)

    def _processes(self) -> Iterator[str]:
        operators = [operator.name for operator in self.domain.operators]
        for node in self.reader.items("processes"):
            if self._known("operator", node, operators):
                yield str(node.value)

    def _atoms(self, node: YamlNode | None) -> tuple[Atom, ...]:
        """Fluents of the domain, checked against their signatures."""
        expression = self.reader.parse("atoms", node) if node is not None else None
        if expression is None:
            return ()
        typing = Typing(self.names, {})
        for atom in expression.value:
            typing.atom(atom, expression, (Kind.FLUENT,))
        return tuple(expression.value)


def _child_text(node: YamlNode, key: str) -> str:
    given = child_at(node, key)
    return str(given.value) if given is not None else ""


def _child_texts(node: YamlNode, key: str) -> tuple[str, ...]:
    given = child_at(node, key)
    return tuple(str(item.value) for item in given.value) if given is not None else ()
