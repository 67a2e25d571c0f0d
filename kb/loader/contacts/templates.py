"""Octuples in `contacts.yaml`: parsed, and their names checked against the classes and objects of the model."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.reader import Findings
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.contacts import AnchorPoint, ContactClass, ObjectClass, class_of
from cellwright.kb.model.octuples import (
    ANY,
    NotAnOctuple,
    Octuple,
    Quadruple,
    matches,
    parse_octuple,
    variable,
)


@dataclass
class Templates:
    """Reads octuples for one model."""

    findings: Findings
    classes: Mapping[str, ObjectClass]
    objects: Mapping[str, str]
    contact_classes: Mapping[str, ContactClass] = field(default_factory=dict)

    def of(self, node: Node | None) -> Octuple | None:
        """The octuple in a scalar; None if there is none or if it is wrong, which is reported."""
        if node is None:
            return None
        try:
            found = parse_octuple(str(node.value), self.classes)
        except NotAnOctuple as error:
            hint = "write class:object.anchor_class:anchor - class:object.anchor_class:anchor, with * for anything"
            self.findings.add(node.where, "K710", str(error), hint)
            return None
        sound = [self._sound(each, node) for each in (found.first, found.second)]
        return found if all(sound) else None

    def _sound(self, point: Quadruple, node: Node) -> bool:
        """Whether every name of an anchor point is known, and some anchor point is what the names say."""
        for kind, name, known in (
            ("object class", point.object_class, list(self.classes)),
            ("object", point.instance, list(self.objects)),
            ("anchor class", point.anchor_class, sorted({each.anchor_class for _, each in self._points()})),
            ("anchor point", point.anchor, sorted({each.name for _, each in self._points()})),
        ):
            if name != ANY and not variable(name) and name not in known:
                if kind == "object class" or name[:1].islower():
                    self.findings.note(unknown_name(kind, name, known, node.where))
                    return False
            elif kind != "object class" and variable(name) and kind == "anchor class":
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
        instances = [name for name, each in self.objects.items() if each == kind]
        named = template.instance == ANY or variable(template.instance) or template.instance in instances
        point = Quadruple(kind, template.instance, anchor.anchor_class, anchor.name)
        return named and matches(template, point, self.classes[kind].lineage) is not None

    def keyed(self, template: Octuple, key: Node) -> Octuple:
        """The octuple of a contact class with its key first. Two keys or two locks are reported."""
        sides = [self._is_key(each) for each in (template.first, template.second)]
        if sides == [True, False]:
            return template
        if sides == [False, True]:
            return template.turned
        found = "two keys" if all(sides) else "two locks"
        self.findings.add(
            key.where,
            "K711",
            f"the contact class joins {found}",
            "keys match locks: see `key` and `lock` of the classes",
        )
        return template

    def _is_key(self, point: Quadruple) -> bool:
        return next((each.key for kind, each in self._points() if self._described(point, kind, each)), True)

    def instances(self, nodes: Iterable[Node]) -> Iterator[Octuple]:
        """The contacts of a list, each with its key first. Those that no contact class describes are reported.

        So are anchor points that are taken twice.
        """
        taken: dict[Quadruple, Node] = {}
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

    def _whole(self, contact: Octuple, node: Node) -> Octuple | None:
        points = []
        for each in (contact.first, contact.second):
            if each.instance not in self.objects or each.anchor == ANY or variable(each.anchor):
                self.findings.add(
                    node.where,
                    "K710",
                    f"'{each}' leaves an object open",
                    "the start names each object and anchor point",
                )
                return None
            kind = self.objects[each.instance]
            points.append(
                replace(
                    each, object_class=kind, anchor_class=self.classes[kind].anchors[each.anchor].anchor_class
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
