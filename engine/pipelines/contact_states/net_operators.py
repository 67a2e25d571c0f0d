"""The planning operators of a net for its transitions and joints, and the names that they use."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from cellwright.engine.model.task_space import ContactNet, Transition
from cellwright.engine.stages.states.token_types import handled_objects_of_joints, permanent_bodies
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.model.contact_model import (
    ANY,
    ConditionKind,
    ContactModel,
    Meaning,
    Octuple,
    PermanentContact,
    Quadruple,
    Restriction,
    is_variable_name,
    template_bindings,
)
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.terms import Atom, Function, Term, Variable


@dataclass
class NetVocabulary:
    """Names of types, functions and objects. An object that is the only one of its class stands for
    itself.

    `types` says which type of the domain the objects of a class have; new ones are `declared` with
    their objects.
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
                self.marks[f"{anchor_function(kind, name)}_mark"] = anchors

    def members(self, kind: str) -> tuple[str, ...]:
        """The objects of exactly this class."""
        return tuple(member for member, of in self.model.objects.items() if of == kind)

    def _type(self, kind: str, members: tuple[str, ...]) -> str:
        """The type of the objects of a class: that of the domain if it knows them, else a new
        one.
        """
        known_types = {
            self.domain.objects[member] for member in members if member in self.domain.objects
        }
        if not known_types:
            taken = {
                *self.domain.types,
                *self.domain.objects,
                *self.model.objects,
                *self.domain.predicates,
            }
            name = f"{kind.lower()}_object" if kind.lower() in taken else kind.lower()
            self.declared[name] = members
            return name
        whole = all(member in self.domain.objects for member in members)
        other_members = {
            object_name for object_name, of in self.domain.objects.items() if of in known_types
        } - set(members)
        if len(members) == 1 or (whole and len(known_types) == 1 and not other_members):
            return min(known_types)
        message = f"the objects of the class '{kind}' are not those of one type of the domain"
        hint = "give them a type of their own in domain.yaml"
        raise InvalidInput([Diagnostic(self.model.classes[kind].where, "K713", message, hint)])

    def _several(self, kind: str) -> Iterator[tuple[str, tuple[str, ...]]]:
        """The anchor classes of which an object of a class has several anchor points."""
        groups: dict[str, list[str]] = {}
        for anchor in self.model.classes[kind].anchors.values():
            groups.setdefault(anchor.anchor_class, []).append(anchor.name)
        yield from ((name, tuple(anchors)) for name, anchors in groups.items() if len(anchors) > 1)

    def object(self, point: Quadruple, variables: dict[str, str]) -> str:
        """The object of an anchor point: a constant, or a variable, which is noted with its
        type.
        """
        members = self.members(point.object_class)
        if point.instance in self.model.objects:
            return point.instance
        if len(members) == 1:
            return members[0]
        name = point.instance if is_variable_name(point.instance) else f"O{len(variables) + 1}"
        variables[name] = self.types[point.object_class]
        return name

    def point(self, point: Quadruple, variables: dict[str, str]) -> str:
        """An anchor point as a term. Variables in it are noted with their types."""
        named = anchor_function(point.object_class, point.anchor_class)
        instance = self.object(point, variables)
        marks = self.marks.get(f"{named}_mark")
        if marks is None:
            return f"{named}({instance})"
        if point.anchor in marks:
            return f"{named}({instance}, {self.mark(f'{named}_mark', point.anchor)})"
        mark = (
            point.anchor
            if is_variable_name(point.anchor) and point.anchor != ANY
            else f"A{len(variables) + 1}"
        )
        variables[mark] = f"{named}_mark"
        return f"{named}({instance}, {mark})"

    def mark(self, marks: str, anchor: str) -> str:
        """The constant for one of several anchor points: its name, unless something else has
        it, too.
        """
        alike = sum(anchor in anchors for anchors in self.marks.values())
        taken = {*self.domain.objects, *self.model.objects, *self._constants}
        return f"{marks.removesuffix('_mark')}_{anchor}" if alike > 1 or anchor in taken else anchor

    @property
    def _constants(self) -> frozenset[str]:
        return frozenset(name for type_ in self.domain.types.values() for name in type_.constants)

    def declarations(self) -> dict[str, list[str]]:
        """Lines for the sections `types`, `functions` and `objects`."""
        types = ["anchor_point: term", *(f"{name}: object" for name in self.declared)]
        for name, anchors in self.marks.items():
            types.append(f"{name}: [{', '.join(self.mark(name, anchor) for anchor in anchors)}]")
        functions = []
        for kind, type_ in self.types.items():
            for anchor_class in dict.fromkeys(
                a.anchor_class for a in self.model.classes[kind].anchors.values()
            ):
                name = anchor_function(kind, anchor_class)
                several = f", {name}_mark" if f"{name}_mark" in self.marks else ""
                functions.append(f"{name}({type_}{several}): anchor_point")
        objects = [f"{name}: [{', '.join(members)}]" for name, members in self.declared.items()]
        return {"types": types, "functions": functions, "objects": objects}


def anchor_function(kind: str, anchor_class: str) -> str:
    """The name of the function for the anchor points of a class."""
    return f"{kind}_{anchor_class}".lower()


def object_templates(quadruple: Quadruple, model: ContactModel) -> Iterator[Quadruple]:
    """A template for each object class and anchor point that a template describes."""
    for kind in model.classes.values():
        fits = quadruple.object_class in (ANY, *kind.lineage)
        if not fits or not any(of == kind.name for of in model.objects.values()):
            continue
        groups: dict[str, list[str]] = {}
        for class_anchor in kind.anchors.values():
            if quadruple.anchor_class in (ANY, class_anchor.anchor_class) and (
                quadruple.anchor in (ANY, class_anchor.name) or is_variable_name(quadruple.anchor)
            ):
                groups.setdefault(class_anchor.anchor_class, []).append(class_anchor.name)
        for anchor_class, anchors in groups.items():
            anchor = anchors[0] if len(anchors) == 1 else quadruple.anchor
            yield Quadruple(kind.name, quadruple.instance, anchor_class, anchor)


@dataclass
class OperatorText:
    """An operator as it is written in a domain file."""

    name: str
    variables: dict[str, str] = field(default_factory=dict)
    where: list[str] = field(default_factory=list)
    preconditions: list[str] = field(default_factory=list)
    adds: list[str] = field(default_factory=list)
    deletes: list[str] = field(default_factory=list)
    resources: list[str] = field(default_factory=list)
    online: list[str] = field(default_factory=list)

    @property
    def lines(self) -> list[str]:
        """Its lines in the section `operators`."""
        used = f"({', '.join(self.variables)})" if self.variables else ""
        types = ", ".join(f"{name}: {type_}" for name, type_ in self.variables.items())
        parts = {
            "where": self.where,
            "preconditions": self.preconditions,
            "adds": self.adds,
            "deletes": self.deletes,
            "resources": self.resources,
        }
        parts_written = [
            f'  {key}: "{", ".join(dict.fromkeys(values))}"'
            for key, values in parts.items()
            if values
        ]
        if self.online:
            looks = ", ".join(
                f'{{fact: "{looked_fact}"}}' for looked_fact in dict.fromkeys(self.online)
            )
            parts_written.append(f"  online: [{looks}]")
        return [
            f"{self.name.lower()}{used}:",
            *([f"  types: {{{types}}}"] if types else []),
            *parts_written,
        ]


def net_operators(net: ContactNet, vocabulary: NetVocabulary) -> Iterator[OperatorText]:
    """The operators of all transitions, then those of the joints."""
    for transition in net.transitions:
        cases = [named for case in transition.cases for named in _by_meaning(vocabulary, case)]
        for number, (case, meanings) in enumerate(cases, 1):
            name = transition.name if len(cases) == 1 else f"{transition.name}_{number}"
            yield _case_operator(vocabulary, transition, name, case, meanings)
    yield from _joint_operators(net, vocabulary)


Meant = list[tuple[Meaning, dict[str, str]]]


def _by_meaning(
    vocabulary: NetVocabulary, case: Sequence[Octuple]
) -> Iterator[tuple[tuple[Octuple, ...], Meant]]:
    """A case for each of several anchor points that the changed contact means something else at."""
    changed, *other_contacts = case
    for anchors in _anchor_choices(vocabulary, changed):
        named = tuple(
            _with_anchors(contact_named, anchors) for contact_named in (changed, *other_contacts)
        )
        yield named, list(_contact_meanings(vocabulary, named[0]))


def _anchor_choices(
    vocabulary: NetVocabulary, changed: Octuple
) -> Iterator[dict[tuple[str, str], str]]:
    for end in (changed.first, changed.second):
        if is_variable_name(end.anchor) and any(
            point.anchor not in (ANY, end.anchor) and not is_variable_name(point.anchor)
            for meaning in vocabulary.model.meanings
            for point in (meaning.contact.first, meaning.contact.second)
            if point.anchor_class == end.anchor_class
        ):
            anchors = vocabulary.model.classes[end.object_class].anchors.values()
            for anchor in anchors:
                if anchor.anchor_class == end.anchor_class:
                    yield {(end.instance, end.anchor): anchor.name}
            return
    yield {}


def _with_anchors(contact: Octuple, anchors: dict[tuple[str, str], str]) -> Octuple:
    def renamed(point: Quadruple) -> Quadruple:
        anchor = anchors.get((point.instance, point.anchor), point.anchor)
        return Quadruple(point.object_class, point.instance, point.anchor_class, anchor)

    return Octuple(renamed(contact.first), renamed(contact.second))


def _contact_meanings(
    vocabulary: NetVocabulary, contact: Octuple
) -> Iterator[tuple[Meaning, dict[str, str]]]:
    """What a contact stands for, with the objects for the variables."""
    model = vocabulary.model
    sample = Octuple(
        *(_sample_object(vocabulary, point) for point in (contact.first, contact.second))
    )
    terms = {
        _sample_object(vocabulary, point).instance: vocabulary.object(point, {})
        for point in (contact.first, contact.second)
    }
    for meaning in model.meanings:
        for bound in template_bindings(model, meaning.contact, sample):
            yield meaning, {name: terms.get(value, value) for name, value in bound.items()}
            break


def _sample_object(vocabulary: NetVocabulary, point: Quadruple) -> Quadruple:
    """An anchor point with the name of an object that it can be."""
    if point.instance in vocabulary.model.objects:
        return point
    return Quadruple(
        point.object_class,
        vocabulary.members(point.object_class)[0],
        point.anchor_class,
        point.anchor,
    )


def _case_operator(
    vocabulary: NetVocabulary,
    transition: Transition,
    name: str,
    case: Sequence[Octuple],
    meanings: Meant,
) -> OperatorText:
    operator_text = OperatorText(name)
    changed, *other_contacts = case
    ends = [
        vocabulary.point(point, operator_text.variables)
        for point in (changed.first, changed.second)
    ]
    contact, voids = f"contact({ends[0]}, {ends[1]})", [f"void({point})" for point in ends]
    if transition.makes:
        operator_text.preconditions += voids
        operator_text.adds.append(contact)
    else:
        operator_text.preconditions.append(contact)
        operator_text.adds += voids
        operator_text.deletes.append(contact)
    for contact_beside in other_contacts:
        point = vocabulary.point(contact_beside.first, operator_text.variables)
        if contact_beside.second.void:
            operator_text.preconditions.append(f"void({point})")
        else:
            operator_text.preconditions.append(
                f"contact({point}, "
                f"{vocabulary.point(contact_beside.second, operator_text.variables)})"
            )
    operator_text.where += _distinctness(operator_text.variables)
    for meaning, terms in meanings:
        before = meaning.broken if transition.makes else meaning.made
        operator_text.preconditions += [atom_with_terms(atom, terms) for atom in before]
    operator_text.preconditions += _waited_settings(vocabulary, transition)
    operator_text.online += _looked_at(transition)
    operator_text.resources += _busy_robots(vocabulary, case)
    return operator_text


def _distinctness(variables: dict[str, str]) -> Iterator[str]:
    """Objects of the same type are different objects."""
    names = [name for name, type_ in variables.items() if not type_.endswith("_mark")]
    for n, first in enumerate(names):
        yield from (
            f"{first} != {second}"
            for second in names[n + 1 :]
            if variables[first] == variables[second]
        )


def _waited_settings(vocabulary: NetVocabulary, transition: Transition) -> Iterator[str]:
    """The settings of joints that a transition waits for.

    Sensors and clocks are looked at when the plan runs.
    """
    for restriction in transition.restrictions:
        if restriction.kind is ConditionKind.JOINT:
            yield joint_setting_fact(
                vocabulary.model.permanent[restriction.subject], restriction.value
            )


def _looked_at(transition: Transition) -> Iterator[str]:
    """The readings of sensors and clocks that are looked at when a step of the transition
    begins.
    """
    for restriction in transition.restrictions:
        if restriction.kind is not ConditionKind.JOINT:
            yield gauge_reading_fact(restriction)


def gauge_reading_fact(restriction: Restriction) -> str:
    """The fact that a sensor or a clock reads what a restriction wants."""
    return f"gauge_reads({restriction.subject}_gauge, {restriction.subject}_{restriction.value})"


def joint_setting_fact(joint: PermanentContact, value: str) -> str:
    """The fact that a joint has a setting: that of the domain, or one of the engine's own."""
    if joint.fact is None:
        return f"setting({joint.name}_joint, {joint.name}_{value})"
    variables = {name: value for name in _atom_variables(joint.fact)}
    return atom_with_terms(joint.fact, variables)


def _atom_variables(atom: Atom) -> Iterator[str]:
    for argument in atom.arguments:
        if isinstance(argument, Variable):
            yield argument.name


def atom_with_terms(atom: Atom, terms: dict[str, str]) -> str:
    """An atom with terms for its variables."""

    def said(term: Term) -> str:
        if isinstance(term, Variable):
            return terms.get(term.name, term.name)
        if isinstance(term, Function) and term.arguments:
            return f"{term.name}({', '.join(map(said, term.arguments))})"
        return str(term)

    return f"{atom.name}({', '.join(map(said, atom.arguments))})" if atom.arguments else atom.name


def _busy_robots(vocabulary: NetVocabulary, case: Sequence[Octuple]) -> Iterator[str]:
    """The robots that take part: a step keeps them busy."""
    driven = {vocabulary.model.objects[body] for body in permanent_bodies(vocabulary.model).driven}
    for contact in case:
        for point in (contact.first, contact.second):
            if point.object_class in driven:
                yield vocabulary.object(point, {})


def _joint_operators(net: ContactNet, vocabulary: NetVocabulary) -> Iterator[OperatorText]:
    """For each joint and each pair of its settings, an operator for every way to hold it."""
    by_hand = handled_objects_of_joints(vocabulary.model)
    for name, joint in vocabulary.model.permanent.items():
        for first in joint.settings:
            for second in joint.settings:
                if first != second:
                    yield from _setting_operators(
                        net, vocabulary, joint, by_hand[name], (first, second)
                    )


def _setting_operators(
    net: ContactNet,
    vocabulary: NetVocabulary,
    joint: PermanentContact,
    handles: Sequence[str],
    settings_pair: tuple[str, str],
) -> Iterator[OperatorText]:
    first, second = (joint_setting_fact(joint, value) for value in settings_pair)
    name = f"{joint.name}_to_{settings_pair[1]}" + (
        f"_from_{settings_pair[0]}" if len(joint.settings) > 2 else ""
    )
    grips = list(_grip_contacts(net, vocabulary, joint, handles))
    if not handles:
        yield OperatorText(name, {}, [], [first], [second], [first])
    for number, contact in enumerate(grips, 1):
        operator_text = OperatorText(name if len(grips) == 1 else f"{name}_{number}")
        ends = [
            vocabulary.point(point, operator_text.variables)
            for point in (contact.first, contact.second)
        ]
        operator_text.preconditions += [f"contact({ends[0]}, {ends[1]})", first]
        operator_text.adds.append(second)
        operator_text.deletes.append(first)
        operator_text.resources += _busy_robots(vocabulary, [contact])
        yield operator_text


def _grip_contacts(
    net: ContactNet, vocabulary: NetVocabulary, joint: PermanentContact, handles: Sequence[str]
) -> Iterator[Octuple]:
    """The contacts by which robots hold what moves a joint."""
    model = vocabulary.model
    kinds = {model.objects[handle] for handle in handles}
    driven = {model.objects[body] for body in permanent_bodies(model).driven}
    seen: dict[Octuple, None] = {}
    for place in net.places:
        if place.name in net.joints.get(joint.name, ()):
            for contact in place.contacts:
                classes = {contact.first.object_class, contact.second.object_class}
                if not contact.second.void and classes & kinds and classes & driven:
                    seen[_held_handle(contact, handles, model.objects)] = None
    yield from seen


def _held_handle(
    contact: Octuple, handles: Sequence[str], objects: "dict[str, str] | object"
) -> Octuple:
    """The contact with the name of the handle, which is one object."""
    assert isinstance(objects, dict)

    def named(point: Quadruple) -> Quadruple:
        for handle in handles:
            if objects[handle] == point.object_class:
                return Quadruple(point.object_class, handle, point.anchor_class, point.anchor)
        return Quadruple(
            point.object_class,
            ANY,
            point.anchor_class,
            ANY if is_variable_name(point.anchor) else point.anchor,
        )

    return Octuple(named(contact.first), named(contact.second))


__all__ = [
    "OperatorText",
    "atom_with_terms",
    "joint_setting_fact",
    "net_operators",
    "object_templates",
]
