"""PNML in: place/transition nets, and symmetric nets with one class of tokens."""

from collections.abc import Iterator
from pathlib import Path

from cellwright.engine.formats.interop.pnml.writing import COLOURED, PLAIN, TYPES
from cellwright.engine.model.petri import PetriArc, PetriNet, PetriPlace, PetriTransition
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, read_file
from cellwright.kb.loader.xml import Element, read_xml
from cellwright.kb.numbers import DIGITS, NumberError, whole

MOST_TOKENS = 10**9


def read_pnml(path: Path) -> PetriNet:
    """The first net of a file. Raises `InvalidInput`."""
    return read_text(read_file(path))


def read_text(file: File) -> PetriNet:
    """The first net of a text. Pages are joined. Raises `InvalidInput` for other documents and other types of nets."""
    root = read_xml(file)
    net = root.first("net")
    if root.tag != "pnml" or net is None:
        raise _refused(root.where, "this is not PNML", "it begins with <pnml> and contains a <net>")
    if net.get("type") not in (PLAIN, COLOURED):
        hint = f"one of: {PLAIN}, {COLOURED}"
        raise _refused(net.where, f"a net of the type '{net.get('type')}'", hint)
    parts = list(_parts(net))
    found = PetriNet(
        net.get("id"),
        tuple(_place(each) for each in parts if each.tag == "place"),
        tuple(_transition(each) for each in parts if each.tag == "transition"),
        tuple(_arc(each) for each in parts if each.tag == "arc"),
        dict(_types(net)),
    )
    _require_ends(found, parts)
    return found


def _refused(where: Source, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(where, "K811", message, hint)])


def _parts(element: Element) -> Iterator[Element]:
    for each in element.children:
        if each.tag == "page":
            yield from _parts(each)
        else:
            yield each


def _require_ends(net: PetriNet, parts: list[Element]) -> None:
    places, transitions = {each.id for each in net.places}, {each.id for each in net.transitions}
    for element in (each for each in parts if each.tag == "arc"):
        ends = element.get("source"), element.get("target")
        if not (ends[0] in places and ends[1] in transitions) and not (
            ends[0] in transitions and ends[1] in places
        ):
            message = f"the arc '{element.get('id')}' does not join a place and a transition"
            raise _refused(element.where, message, "name one of each as `source` and `target`")


def _deep(element: Element | None, tag: str) -> Iterator[Element]:
    """All elements of a tag inside an element, in order."""
    for each in element.children if element is not None else []:
        if each.tag == tag:
            yield each
        yield from _deep(each, tag)


def _said(element: Element, tag: str) -> str:
    label = element.first(tag)
    text = label.first("text") if label is not None else None
    return text.text if text is not None else ""


def _number(element: Element, tag: str, otherwise: int) -> int:
    said = _said(element, tag)
    try:
        return whole(said, 0, MOST_TOKENS) if said else otherwise
    except NumberError as error:
        message = f"'{said[:DIGITS]}' {error}, so it is no number of tokens"
        raise _refused(element.where, message, "write a whole number") from None


def _notes(element: Element) -> tuple[str, ...]:
    own = (each for each in element.all("toolspecific") if each.get("tool") == "cellwright")
    return tuple(note.text for each in own for note in each.all("note"))


def _types(net: Element) -> Iterator[tuple[str, tuple[str, ...]]]:
    for partition in _deep(net.first("declaration"), "partition"):
        if partition.get("id") == TYPES:
            for each in partition.all("partitionelement"):
                yield each.get("name"), tuple(one.get("declaration") for one in each.all("useroperator"))


def _place(element: Element) -> PetriPlace:
    marking = tuple(
        each.get("declaration") for each in _deep(element.first("hlinitialMarking"), "useroperator")
    )
    count = _number(element, "initialMarking", len(marking))
    return PetriPlace(element.get("id"), _said(element, "name"), count, marking, _notes(element))


def _transition(element: Element) -> PetriTransition:
    guard = element.first("condition")
    names = [each.get("refvariable") for each in _deep(guard, "variable")]
    types = [each.get("declaration").removeprefix("type ") for each in _deep(guard, "useroperator")]
    return PetriTransition(
        element.get("id"), _said(element, "name"), tuple(zip(names, types, strict=False)), _notes(element)
    )


def _arc(element: Element) -> PetriArc:
    variables = tuple(each.get("refvariable") for each in _deep(element.first("hlinscription"), "variable"))
    count = _number(element, "inscription", max(1, len(variables)))
    return PetriArc(element.get("id"), element.get("source"), element.get("target"), count, variables)
