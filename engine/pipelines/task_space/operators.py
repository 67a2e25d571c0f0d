"""The planning operators of a net: one for each case of a transition, and those that move joints."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from cellwright.engine.model.task_space import Net, Transition
from cellwright.engine.pipelines.task_space.vocabulary import Vocabulary, whole
from cellwright.engine.stages.states.tokens import bodies, moved_by_hand
from cellwright.kb.model.contacts import ConditionKind, Meaning, PermanentContact, Restriction, describes
from cellwright.kb.model.octuples import ANY, Octuple, Quadruple, variable
from cellwright.kb.terms import Atom, Function, Term, Variable


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
        said = [f'  {key}: "{", ".join(dict.fromkeys(values))}"' for key, values in parts.items() if values]
        if self.online:
            looks = ", ".join(f'{{fact: "{each}"}}' for each in dict.fromkeys(self.online))
            said.append(f"  online: [{looks}]")
        return [f"{self.name.lower()}{used}:", *([f"  types: {{{types}}}"] if types else []), *said]


def operators(net: Net, vocabulary: Vocabulary) -> Iterator[OperatorText]:
    """The operators of all transitions, then those of the joints."""
    for transition in net.transitions:
        cases = [named for case in transition.cases for named in _by_meaning(vocabulary, case)]
        for number, (case, meanings) in enumerate(cases, 1):
            name = transition.name if len(cases) == 1 else f"{transition.name}_{number}"
            yield _operator(vocabulary, transition, name, case, meanings)
    yield from _joints(net, vocabulary)


Meant = list[tuple[Meaning, dict[str, str]]]


def _by_meaning(
    vocabulary: Vocabulary, case: Sequence[Octuple]
) -> Iterator[tuple[tuple[Octuple, ...], Meant]]:
    """A case for each of several anchor points that the changed contact means something else at."""
    changed, *others = case
    for anchors in _choices(vocabulary, changed):
        named = tuple(_chosen(each, anchors) for each in (changed, *others))
        yield named, list(_meanings(vocabulary, named[0]))


def _choices(vocabulary: Vocabulary, changed: Octuple) -> Iterator[dict[tuple[str, str], str]]:
    for end in (changed.first, changed.second):
        if variable(end.anchor) and any(
            point.anchor not in (ANY, end.anchor) and not variable(point.anchor)
            for meaning in vocabulary.model.meanings
            for point in (meaning.contact.first, meaning.contact.second)
            if point.anchor_class == end.anchor_class
        ):
            anchors = vocabulary.model.classes[end.object_class].anchors.values()
            for each in anchors:
                if each.anchor_class == end.anchor_class:
                    yield {(end.instance, end.anchor): each.name}
            return
    yield {}


def _chosen(contact: Octuple, anchors: dict[tuple[str, str], str]) -> Octuple:
    def renamed(point: Quadruple) -> Quadruple:
        anchor = anchors.get((point.instance, point.anchor), point.anchor)
        return Quadruple(point.object_class, point.instance, point.anchor_class, anchor)

    return Octuple(renamed(contact.first), renamed(contact.second))


def _meanings(vocabulary: Vocabulary, contact: Octuple) -> Iterator[tuple[Meaning, dict[str, str]]]:
    """What a contact stands for, with the objects for the variables."""
    model = vocabulary.model
    sample = Octuple(*(_sample(vocabulary, each) for each in (contact.first, contact.second)))
    terms = {
        _sample(vocabulary, each).instance: vocabulary.object(each, {})
        for each in (contact.first, contact.second)
    }
    for meaning in model.meanings:
        for bound in describes(model, meaning.contact, sample):
            yield meaning, {name: terms.get(value, value) for name, value in bound.items()}
            break


def _sample(vocabulary: Vocabulary, point: Quadruple) -> Quadruple:
    """An anchor point with the name of an object that it can be."""
    if point.instance in vocabulary.model.objects:
        return point
    return Quadruple(
        point.object_class, vocabulary.members(point.object_class)[0], point.anchor_class, point.anchor
    )


def _operator(
    vocabulary: Vocabulary, transition: Transition, name: str, case: Sequence[Octuple], meanings: Meant
) -> OperatorText:
    made = OperatorText(name)
    changed, *others = case
    ends = [vocabulary.point(each, made.variables) for each in (changed.first, changed.second)]
    contact, voids = f"contact({ends[0]}, {ends[1]})", [f"void({each})" for each in ends]
    if transition.makes:
        made.preconditions += voids
        made.adds.append(contact)
    else:
        made.preconditions.append(contact)
        made.adds += voids
        made.deletes.append(contact)
    for each in others:
        point = vocabulary.point(each.first, made.variables)
        if each.second.void:
            made.preconditions.append(f"void({point})")
        else:
            made.preconditions.append(f"contact({point}, {vocabulary.point(each.second, made.variables)})")
    made.where += _unlike(made.variables)
    for meaning, terms in meanings:
        before = meaning.broken if transition.makes else meaning.made
        made.preconditions += [written(atom, terms) for atom in before]
    made.preconditions += _restricted(vocabulary, transition)
    made.online += _looked_at(transition)
    made.resources += _robots(vocabulary, case)
    return made


def _unlike(variables: dict[str, str]) -> Iterator[str]:
    """Objects of the same type are different objects."""
    names = [name for name, type_ in variables.items() if not type_.endswith("_mark")]
    for n, first in enumerate(names):
        yield from (
            f"{first} != {second}" for second in names[n + 1 :] if variables[first] == variables[second]
        )


def _restricted(vocabulary: Vocabulary, transition: Transition) -> Iterator[str]:
    """The settings of joints that a transition waits for. Sensors and clocks are looked at when the plan runs."""
    for each in transition.restrictions:
        if each.kind is ConditionKind.JOINT:
            yield setting(vocabulary.model.permanent[each.subject], each.value)


def _looked_at(transition: Transition) -> Iterator[str]:
    """The readings of sensors and clocks that are looked at when a step of the transition begins."""
    for each in transition.restrictions:
        if each.kind is not ConditionKind.JOINT:
            yield reading(each)


def reading(restriction: Restriction) -> str:
    """The fact that a sensor or a clock reads what a restriction wants."""
    return f"gauge_reads({restriction.subject}_gauge, {restriction.subject}_{restriction.value})"


def setting(joint: PermanentContact, value: str) -> str:
    """The fact that a joint has a setting: that of the domain, or one of the engine's own."""
    if joint.fact is None:
        return f"setting({joint.name}_joint, {joint.name}_{value})"
    variables = {name: value for name in _variables(joint.fact)}
    return written(joint.fact, variables)


def _variables(atom: Atom) -> Iterator[str]:
    for each in atom.arguments:
        if isinstance(each, Variable):
            yield each.name


def written(atom: Atom, terms: dict[str, str]) -> str:
    """An atom with terms for its variables."""

    def said(term: Term) -> str:
        if isinstance(term, Variable):
            return terms.get(term.name, term.name)
        if isinstance(term, Function) and term.arguments:
            return f"{term.name}({', '.join(map(said, term.arguments))})"
        return str(term)

    return f"{atom.name}({', '.join(map(said, atom.arguments))})" if atom.arguments else atom.name


def _robots(vocabulary: Vocabulary, case: Sequence[Octuple]) -> Iterator[str]:
    """The robots that take part: a step keeps them busy."""
    driven = {vocabulary.model.objects[each] for each in bodies(vocabulary.model).driven}
    for each in case:
        for point in (each.first, each.second):
            if point.object_class in driven:
                yield vocabulary.object(point, {})


def _joints(net: Net, vocabulary: Vocabulary) -> Iterator[OperatorText]:
    """For each joint and each pair of its settings, an operator for every way to hold it."""
    by_hand = moved_by_hand(vocabulary.model)
    for name, joint in vocabulary.model.permanent.items():
        for first in joint.settings:
            for second in joint.settings:
                if first != second:
                    yield from _moves(net, vocabulary, joint, by_hand[name], (first, second))


def _moves(
    net: Net, vocabulary: Vocabulary, joint: PermanentContact, handles: Sequence[str], way: tuple[str, str]
) -> Iterator[OperatorText]:
    first, second = (setting(joint, each) for each in way)
    name = f"{joint.name}_to_{way[1]}" + (f"_from_{way[0]}" if len(joint.settings) > 2 else "")
    grips = list(_grips(net, vocabulary, joint, handles))
    if not handles:
        yield OperatorText(name, {}, [], [first], [second], [first])
    for number, contact in enumerate(grips, 1):
        made = OperatorText(name if len(grips) == 1 else f"{name}_{number}")
        ends = [vocabulary.point(each, made.variables) for each in (contact.first, contact.second)]
        made.preconditions += [f"contact({ends[0]}, {ends[1]})", first]
        made.adds.append(second)
        made.deletes.append(first)
        made.resources += _robots(vocabulary, [contact])
        yield made


def _grips(
    net: Net, vocabulary: Vocabulary, joint: PermanentContact, handles: Sequence[str]
) -> Iterator[Octuple]:
    """The contacts by which robots hold what moves a joint."""
    model = vocabulary.model
    kinds = {model.objects[each] for each in handles}
    driven = {model.objects[each] for each in bodies(model).driven}
    seen: dict[Octuple, None] = {}
    for place in net.places:
        if place.name in net.joints.get(joint.name, ()):
            for contact in place.contacts:
                classes = {contact.first.object_class, contact.second.object_class}
                if not contact.second.void and classes & kinds and classes & driven:
                    seen[_held(contact, handles, model.objects)] = None
    yield from seen


def _held(contact: Octuple, handles: Sequence[str], objects: "dict[str, str] | object") -> Octuple:
    """The contact with the name of the handle, which is one object."""
    assert isinstance(objects, dict)

    def named(point: Quadruple) -> Quadruple:
        for each in handles:
            if objects[each] == point.object_class:
                return Quadruple(point.object_class, each, point.anchor_class, point.anchor)
        return Quadruple(
            point.object_class, ANY, point.anchor_class, ANY if variable(point.anchor) else point.anchor
        )

    return Octuple(named(contact.first), named(contact.second))


__all__ = ["OperatorText", "operators", "setting", "whole", "written"]
