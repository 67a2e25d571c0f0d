"""How the planning domain names the objects and anchor points of a contact model."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.model.contacts import ContactModel
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.octuples import ANY, Quadruple, variable


@dataclass
class Vocabulary:
    """Names of types, functions and objects. An object that is the only one of its class stands for itself.

    `types` says which type of the domain the objects of a class have; new ones are `declared` with their objects.
    """

    model: ContactModel
    domain: Domain
    types: dict[str, str] = field(default_factory=dict)
    declared: dict[str, tuple[str, ...]] = field(default_factory=dict)
    marks: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for kind in self.model.classes:
            members = self.members(kind)
            if members and self.model.classes[kind].anchors:
                self.types[kind] = self._type(kind, members)
        for kind in self.types:
            for name, anchors in self._several(kind):
                self.marks[f"{function(kind, name)}_mark"] = anchors

    def members(self, kind: str) -> tuple[str, ...]:
        """The objects of exactly this class."""
        return tuple(each for each, of in self.model.objects.items() if of == kind)

    def _type(self, kind: str, members: tuple[str, ...]) -> str:
        """The type of the objects of a class: that of the domain if it knows them, else a new one."""
        known = {self.domain.objects[each] for each in members if each in self.domain.objects}
        if not known:
            taken = {*self.domain.types, *self.domain.objects, *self.model.objects, *self.domain.predicates}
            name = f"{kind.lower()}_object" if kind.lower() in taken else kind.lower()
            self.declared[name] = members
            return name
        whole = all(each in self.domain.objects for each in members)
        others = {each for each, of in self.domain.objects.items() if of in known} - set(members)
        if len(members) == 1 or (whole and len(known) == 1 and not others):
            return min(known)
        message = f"the objects of the class '{kind}' are not those of one type of the domain"
        hint = "give them a type of their own in domain.yaml"
        raise InvalidInput([Diagnostic(self.model.classes[kind].where, "K713", message, hint)])

    def _several(self, kind: str) -> Iterator[tuple[str, tuple[str, ...]]]:
        """The anchor classes of which an object of a class has several anchor points."""
        groups: dict[str, list[str]] = {}
        for each in self.model.classes[kind].anchors.values():
            groups.setdefault(each.anchor_class, []).append(each.name)
        yield from ((name, tuple(anchors)) for name, anchors in groups.items() if len(anchors) > 1)

    def object(self, point: Quadruple, variables: dict[str, str]) -> str:
        """The object of an anchor point: a constant, or a variable, which is noted with its type."""
        members = self.members(point.object_class)
        if point.instance in self.model.objects:
            return point.instance
        if len(members) == 1:
            return members[0]
        name = point.instance if variable(point.instance) else f"O{len(variables) + 1}"
        variables[name] = self.types[point.object_class]
        return name

    def point(self, point: Quadruple, variables: dict[str, str]) -> str:
        """An anchor point as a term. Variables in it are noted with their types."""
        named = function(point.object_class, point.anchor_class)
        instance = self.object(point, variables)
        marks = self.marks.get(f"{named}_mark")
        if marks is None:
            return f"{named}({instance})"
        if point.anchor in marks:
            return f"{named}({instance}, {self.mark(f'{named}_mark', point.anchor)})"
        mark = point.anchor if variable(point.anchor) and point.anchor != ANY else f"A{len(variables) + 1}"
        variables[mark] = f"{named}_mark"
        return f"{named}({instance}, {mark})"

    def mark(self, marks: str, anchor: str) -> str:
        """The constant for one of several anchor points: its name, unless something else has it, too."""
        alike = sum(anchor in anchors for anchors in self.marks.values())
        taken = {*self.domain.objects, *self.model.objects, *self._constants}
        return f"{marks.removesuffix('_mark')}_{anchor}" if alike > 1 or anchor in taken else anchor

    @property
    def _constants(self) -> frozenset[str]:
        return frozenset(name for each in self.domain.types.values() for name in each.constants)

    def declarations(self) -> dict[str, list[str]]:
        """Lines for the sections `types`, `functions` and `objects`."""
        types = ["anchor_point: term", *(f"{name}: object" for name in self.declared)]
        for name, anchors in self.marks.items():
            types.append(f"{name}: [{', '.join(self.mark(name, each) for each in anchors)}]")
        functions = []
        for kind, type_ in self.types.items():
            for anchor_class in dict.fromkeys(
                a.anchor_class for a in self.model.classes[kind].anchors.values()
            ):
                name = function(kind, anchor_class)
                several = f", {name}_mark" if f"{name}_mark" in self.marks else ""
                functions.append(f"{name}({type_}{several}): anchor_point")
        objects = [f"{name}: [{', '.join(members)}]" for name, members in self.declared.items()]
        return {"types": types, "functions": functions, "objects": objects}


def function(kind: str, anchor_class: str) -> str:
    """The name of the function for the anchor points of a class."""
    return f"{kind}_{anchor_class}".lower()


def whole(quadruple: Quadruple, model: ContactModel) -> Iterator[Quadruple]:
    """A template for each object class and anchor point that a template describes."""
    for kind in model.classes.values():
        fits = quadruple.object_class in (ANY, *kind.lineage)
        if not fits or not any(of == kind.name for of in model.objects.values()):
            continue
        groups: dict[str, list[str]] = {}
        for each in kind.anchors.values():
            if quadruple.anchor_class in (ANY, each.anchor_class) and (
                quadruple.anchor in (ANY, each.name) or variable(quadruple.anchor)
            ):
                groups.setdefault(each.anchor_class, []).append(each.name)
        for anchor_class, anchors in groups.items():
            anchor = anchors[0] if len(anchors) == 1 else quadruple.anchor
            yield Quadruple(kind.name, quadruple.instance, anchor_class, anchor)
