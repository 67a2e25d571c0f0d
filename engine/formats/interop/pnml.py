"""Petri nets in PNML (ISO/IEC 15909-2), read and written; contact-state nets as Petri nets."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

from cellwright.engine.model.task_space import (
    ContactNet,
    NetPlace,
    PetriArc,
    PetriNet,
    PetriPlace,
    PetriTransition,
    Transition,
)
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, read_file
from cellwright.kb.loader.strict_xml import XmlElement, read_xml
from cellwright.kb.numbers import MAX_NUMBER_CHARACTERS, NumberError, read_whole

PNML_GRAMMAR = "http://www.pnml.org/version-2009/grammar"
PLAIN, COLOURED = f"{PNML_GRAMMAR}/ptnet", f"{PNML_GRAMMAR}/symmetricnet"
TOKEN, TYPES = "token", "types"  # the class of all tokens, and how it is parted


def write_pnml(net: PetriNet) -> str:
    """The document. The same net gives the same bytes."""
    return "\n".join(_net_lines(net)) + "\n"


def _net_lines(net: PetriNet) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield f'<pnml xmlns="{PNML_GRAMMAR}/pnml">'
    yield f'<net id={quoteattr(net.id)} type="{COLOURED if net.coloured else PLAIN}">'
    yield f"<name><text>{escape(net.id)}</text></name>"
    if net.coloured:
        yield from _declaration_lines(net)
    yield '<page id="page">'
    for place in net.places:
        yield from _place_lines(net, place)
    for transition in net.transitions:
        yield from _transition_lines(transition)
    for arc in net.arcs:
        yield from _arc_lines(net, arc)
    yield from ("</page>", "</net>", "</pnml>")


def _declaration_lines(net: PetriNet) -> Iterator[str]:
    yield "<declaration><structure><declarations>"
    yield f'<namedsort id="{TOKEN}" name="{TOKEN}"><finiteenumeration>'
    for tokens in net.types.values():
        yield from (
            f"<feconstant id={quoteattr(token)} name={quoteattr(token)}/>" for token in tokens
        )
    yield "</finiteenumeration></namedsort>"
    yield f'<partition id="{TYPES}" name="{TYPES}"><usersort declaration="{TOKEN}"/>'
    for type_, tokens in net.types.items():
        yield f"<partitionelement id={quoteattr('type ' + type_)} name={quoteattr(type_)}>"
        yield from (f"<useroperator declaration={quoteattr(token)}/>" for token in tokens)
        yield "</partitionelement>"
    yield "</partition>"
    for name in dict.fromkeys(
        name for transition in net.transitions for name, _ in transition.variables
    ):
        yield (
            f"<variabledecl id={quoteattr(name)} name={quoteattr(name)}><usersort "
            f'declaration="{TOKEN}"/></variabledecl>'
        )
    yield "</declarations></structure></declaration>"


def _place_lines(net: PetriNet, place: PetriPlace) -> Iterator[str]:
    yield f"<place id={quoteattr(place.id)}>"
    yield f"<name><text>{escape(place.name)}</text></name>"
    if not net.coloured:
        yield f"<initialMarking><text>{place.count}</text></initialMarking>"
    else:
        yield f'<type><structure><usersort declaration="{TOKEN}"/></structure></type>'
        if place.marking:
            terms = [f"<useroperator declaration={quoteattr(token)}/>" for token in place.marking]
            yield f"<hlinitialMarking><structure>{_token_sum(terms)}</structure></hlinitialMarking>"
    yield from _note_lines(place.notes)
    yield "</place>"


def _token_sum(terms: Sequence[str]) -> str:
    """A multiset in which each term stands once."""
    template = (
        "<numberof><subterm><numberconstant "
        'value="1"><positive/></numberconstant></subterm><subterm>{}</subterm></numberof>'
    )
    parts = [template.format(term) for term in terms]
    return (
        parts[0]
        if len(parts) == 1
        else "<add>" + "".join(f"<subterm>{part}</subterm>" for part in parts) + "</add>"
    )


def _transition_lines(transition: PetriTransition) -> Iterator[str]:
    yield f"<transition id={quoteattr(transition.id)}>"
    yield f"<name><text>{escape(transition.name)}</text></name>"
    if transition.variables:
        yield f"<condition><structure>{_guard_text(transition.variables)}</structure></condition>"
    yield from _note_lines(transition.notes)
    yield "</transition>"


def _guard_text(variables: Sequence[tuple[str, str]]) -> str:
    """Each variable is bound to a token of its type."""
    parts = [
        f'<equality><subterm><partitionelementof refpartition="{TYPES}"><subterm><variable '
        f"refvariable={quoteattr(name)}/>"
        "</subterm></partitionelementof></subterm><subterm><useroperator "
        f"declaration={quoteattr('type ' + type_)}/>"
        "</subterm></equality>"
        for name, type_ in variables
    ]
    whole = parts[0]
    for part in parts[1:]:
        whole = f"<and><subterm>{whole}</subterm><subterm>{part}</subterm></and>"
    return whole


def _arc_lines(net: PetriNet, arc: PetriArc) -> Iterator[str]:
    yield (
        f"<arc id={quoteattr(arc.id)} source={quoteattr(arc.source)} "
        f"target={quoteattr(arc.target)}>"
    )
    if not net.coloured:
        yield f"<inscription><text>{arc.count}</text></inscription>"
    else:
        terms = [f"<variable refvariable={quoteattr(name)}/>" for name in arc.variables]
        yield f"<hlinscription><structure>{_token_sum(terms)}</structure></hlinscription>"
    yield "</arc>"


def _note_lines(notes: Sequence[str]) -> Iterator[str]:
    if notes:
        yield '<toolspecific tool="cellwright" version="1">'
        yield from (f"<note>{escape(note)}</note>" for note in notes)
        yield "</toolspecific>"


MOST_TOKENS = 10**9
# how dialects call the label that says what an arc means
ARC_TYPES = ("type", "arctype", "arcType")
ORDINARY = ("", "normal", "ordinary", "default", "regular", "arc")
UNLIMITED = ("", "0", "-1", "inf", "infinite", "omega")
REFERENCES = {"referencePlace": "place", "referenceTransition": "transition"}


def read_pnml(path: Path) -> PetriNet:
    """The first net of a file. Raises `InvalidInput`."""
    return read_text(read_file(path))


def read_text(file: File) -> PetriNet:
    """The first net of a text.

    Pages are joined. Raises `InvalidInput` for other documents and other types of nets.
    """
    root = read_xml(file)
    net = root.first("net")
    if root.tag != "pnml" or net is None:
        raise _bad_net(root.where, "this is not PNML", "it begins with <pnml> and contains a <net>")
    if net.get("type") not in (PLAIN, COLOURED):
        hint = f"one of: {PLAIN}, {COLOURED}"
        raise _bad_net(net.where, f"a net of the type '{net.get('type')}'", hint)
    parts = list(_net_parts(net))
    for part in parts:
        _require_plain(part)
    real = _references(parts)
    petri_net = PetriNet(
        net.get("id"),
        tuple(_read_place(part) for part in parts if part.tag == "place"),
        tuple(_read_transition(part) for part in parts if part.tag == "transition"),
        tuple(_read_arc(each, real) for each in parts if each.tag == "arc"),
        dict(_token_types(net)),
    )
    _require_ends(petri_net, parts, real)
    return petri_net


def _bad_net(where: Source, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(where, "K811", message, hint)])


def _net_parts(element: XmlElement) -> Iterator[XmlElement]:
    for child in element.children:
        if child.tag == "page":
            yield from _net_parts(child)
        else:
            yield child


def _require_plain(element: XmlElement) -> None:
    """Raise `InvalidInput` for an arc or a place that means something else than in a plain net."""
    if element.tag == "arc":
        labels = [element.first(tag) for tag in ARC_TYPES]
        said = [element.get("type"), *(_label(each) for each in labels if each is not None)]
        other = next((each for each in said if each.strip().lower() not in ORDINARY), "")
        if other:
            message = f"the arc '{element.get('id')}' is of the type '{other}'"
            raise _bad_net(
                element.where,
                message,
                "only ordinary arcs are read: one token for one, or a weight",
            )
    limit = element.first("capacity") if element.tag == "place" else None
    if limit is not None and _label(limit).strip() not in UNLIMITED:
        message = f"the place '{element.get('id')}' has a capacity of {_label(limit).strip()}"
        raise _bad_net(element.where, message, "add a place for the room that is left")


def _label(element: XmlElement) -> str:
    """What a label says, as an attribute or as a text."""
    text = element.first("text") or element.first("value")
    return element.get("value") or (text.text if text is not None else element.text)


def _references(parts: list[XmlElement]) -> dict[str, str]:
    """For each reference node the node for which it stands, over other references.

    Raises `InvalidInput` for circles.
    """
    named = {each.get("id"): each for each in parts if each.tag in REFERENCES}
    known = {each.get("id"): each.tag for each in parts if each.tag in REFERENCES.values()}
    found: dict[str, str] = {}
    for name, element in named.items():
        target, seen = element.get("ref"), {name}
        while target in named and target not in seen:
            seen.add(target)
            target = named[target].get("ref")
        if known.get(target) != REFERENCES[element.tag]:
            message = (
                f"'{name}' refers to '{element.get('ref')}', which leads to no "
                f"{REFERENCES[element.tag]}"
            )
            raise _bad_net(element.where, message, "name a node of the same kind as `ref`")
        found[name] = target
    return found


def _require_ends(net: PetriNet, parts: list[XmlElement], real: Mapping[str, str]) -> None:
    places, transitions = (
        {place.id for place in net.places},
        {transition.id for transition in net.transitions},
    )
    for element in (arc for arc in parts if arc.tag == "arc"):
        ends = [real.get(each, each) for each in (element.get("source"), element.get("target"))]
        if not (ends[0] in places and ends[1] in transitions) and not (
            ends[0] in transitions and ends[1] in places
        ):
            message = f"the arc '{element.get('id')}' does not join a place and a transition"
            raise _bad_net(element.where, message, "name one of each as `source` and `target`")


def _elements_inside(element: XmlElement | None, tag: str) -> Iterator[XmlElement]:
    """All elements of a tag inside an element, in order."""
    for child in element.children if element is not None else []:
        if child.tag == tag:
            yield child
        yield from _elements_inside(child, tag)


def _text_of(element: XmlElement, tag: str) -> str:
    label = element.first(tag)
    text = label.first("text") if label is not None else None
    return text.text if text is not None else ""


def _number_of(element: XmlElement, tag: str, otherwise: int) -> int:
    said = _text_of(element, tag)
    try:
        return read_whole(said, 0, MOST_TOKENS) if said else otherwise
    except NumberError as error:
        message = f"'{said[:MAX_NUMBER_CHARACTERS]}' {error}, so it is no number of tokens"
        raise _bad_net(element.where, message, "write a whole number") from None


def _notes_of(element: XmlElement) -> tuple[str, ...]:
    own = (
        tool_part
        for tool_part in element.all("toolspecific")
        if tool_part.get("tool") == "cellwright"
    )
    return tuple(note.text for tool_part in own for note in tool_part.all("note"))


def _token_types(net: XmlElement) -> Iterator[tuple[str, tuple[str, ...]]]:
    for partition in _elements_inside(net.first("declaration"), "partition"):
        if partition.get("id") == TYPES:
            for partition_element in partition.all("partitionelement"):
                yield (
                    partition_element.get("name"),
                    tuple(
                        operator.get("declaration")
                        for operator in partition_element.all("useroperator")
                    ),
                )


def _read_place(element: XmlElement) -> PetriPlace:
    marking = tuple(
        operator.get("declaration")
        for operator in _elements_inside(element.first("hlinitialMarking"), "useroperator")
    )
    count = _number_of(element, "initialMarking", len(marking))
    return PetriPlace(
        element.get("id"), _text_of(element, "name"), count, marking, _notes_of(element)
    )


def _read_transition(element: XmlElement) -> PetriTransition:
    guard = element.first("condition")
    names = [variable.get("refvariable") for variable in _elements_inside(guard, "variable")]
    types = [
        operator.get("declaration").removeprefix("type ")
        for operator in _elements_inside(guard, "useroperator")
    ]
    return PetriTransition(
        element.get("id"),
        _text_of(element, "name"),
        tuple(zip(names, types, strict=False)),
        _notes_of(element),
    )


def _read_arc(element: XmlElement, real: Mapping[str, str]) -> PetriArc:
    variables = tuple(
        variable.get("refvariable")
        for variable in _elements_inside(element.first("hlinscription"), "variable")
    )
    count = _number_of(element, "inscription", max(1, len(variables)))
    source, target = (
        real.get(each, each) for each in (element.get("source"), element.get("target"))
    )
    return PetriArc(element.get("id"), source, target, count, variables)


def unfold_net(net: ContactNet) -> PetriNet:
    """A place/transition net.

    A token is a whole cluster; the net by contact class gives the coarser net of its places.
    """
    places = tuple(
        PetriPlace(p.name, p.say, p.initial, (), tuple(_place_notes(p))) for p in net.places
    )
    transitions: list[PetriTransition] = []
    arcs: list[PetriArc] = []
    for number, transition in enumerate(net.transitions, 1):
        name = f"T{number}"
        transitions.append(
            PetriTransition(name, transition.name, (), _transition_conditions(transition))
        )
        for place, count in sorted(Counter(transition.inputs).items()):
            arcs.append(PetriArc(f"{place}_{name}", place, name, count))
        for place, count in sorted(Counter(transition.outputs).items()):
            arcs.append(PetriArc(f"{name}_{place}", name, place, count))
    return PetriNet(_xml_id(net.name), places, tuple(transitions), tuple(arcs))


def symmetric_net(net: ContactNet) -> PetriNet:
    """A symmetric net: the tokens are the permanent clusters, each of its type."""
    start = _initial_marking(net)
    places = tuple(
        PetriPlace(p.name, p.say, len(start[p.name]), tuple(start[p.name]), tuple(_place_notes(p)))
        for p in net.places
    )
    transitions: list[PetriTransition] = []
    arcs: list[PetriArc] = []
    for number, transition in enumerate(net.transitions, 1):
        for mode, moved in enumerate(_transition_modes(net, transition), 1):
            name = f"T{number}_{mode}"
            variables = [
                (source, target, f"{type_}_{n}", type_)
                for type_, rows in _by_type(moved).items()
                for n, (source, target) in enumerate(rows, 1)
            ]
            bound = tuple((_xml_id(variable), type_) for _, _, variable, type_ in variables)
            transitions.append(
                PetriTransition(name, transition.name, bound, _transition_conditions(transition))
            )
            arcs += _arcs_of(
                name,
                [(source, target, _xml_id(variable)) for source, target, variable, _ in variables],
            )
    return PetriNet(_xml_id(net.name), places, tuple(transitions), tuple(arcs), dict(net.colours))


Rows = list[tuple[str, str]]


def _transition_modes(
    net: ContactNet, transition: Transition
) -> Iterator[tuple[tuple[str, str, str, int], ...]]:
    """What each step of a transition moves: (from place, to place, type, count). Each different
    one once.
    """
    at = {form: place.name for place in net.places for form in place.forms}
    names = list(net.colours)
    seen = dict.fromkeys(
        tuple(
            sorted(
                (at[step.inputs[source]], at[step.outputs[target]], names[kind], count)
                for source, target, kind, count in step.moved
            )
        )
        for step in transition.steps
    )
    yield from seen


def _by_type(moved: tuple[tuple[str, str, str, int], ...]) -> dict[str, Rows]:
    by_type: dict[str, Rows] = {}
    for source, target, type_, count in moved:
        by_type.setdefault(type_, []).extend([(source, target)] * count)
    return by_type


def _arcs_of(name: str, variables: list[tuple[str, str, str]]) -> Iterator[PetriArc]:
    inputs: dict[str, list[str]] = {}
    outputs: dict[str, list[str]] = {}
    for source, target, variable in variables:
        inputs.setdefault(source, []).append(variable)
        outputs.setdefault(target, []).append(variable)
    for place, moved in inputs.items():
        yield PetriArc(f"{place}_{name}", place, name, len(moved), tuple(moved))
    for place, moved in outputs.items():
        yield PetriArc(f"{name}_{place}", name, place, len(moved), tuple(moved))


def _initial_marking(net: ContactNet) -> dict[str, list[str]]:
    """The tokens in each place at the start."""
    left = {name: list(tokens) for name, tokens in net.colours.items()}
    marking: dict[str, list[str]] = {}
    for place in net.places:
        tokens_here = marking.setdefault(place.name, [])
        for type_, count in place.tokens:
            tokens_here += [left[type_].pop(0) for _ in range(count)]
    return marking


def _place_notes(place: NetPlace) -> Iterator[str]:
    yield from (f"capacity {type_} {count}" for type_, count in place.capacity)
    yield from (f"contact {contact}" for contact in place.contacts)


def _transition_conditions(transition: Transition) -> tuple[str, ...]:
    return tuple(f"if {restriction}" for restriction in transition.restrictions)


def _xml_id(name: str) -> str:
    """A name as an XML identifier."""
    return "".join(
        character if character.isalnum() or character in "_-." else "_" for character in name
    )


__all__ = ["read_pnml", "write_contact_net", "write_pnml"]


def write_contact_net(net: ContactNet, coloured: bool) -> str:
    """A net of contact states as PNML: as a symmetric net, or as a place/transition net with a
    place for each cluster.
    """

    return write_pnml(symmetric_net(net) if coloured else unfold_net(net))
