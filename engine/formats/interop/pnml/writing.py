"""Petri nets as PNML."""

from collections.abc import Iterator, Sequence
from xml.sax.saxutils import escape, quoteattr

from cellwright.engine.model.petri import PetriArc, PetriNet, PetriPlace, PetriTransition

GRAMMAR = "http://www.pnml.org/version-2009/grammar"
PLAIN, COLOURED = f"{GRAMMAR}/ptnet", f"{GRAMMAR}/symmetricnet"
TOKEN, TYPES = "token", "types"  # the class of all tokens, and how it is parted


def write_pnml(net: PetriNet) -> str:
    """The document. The same net gives the same bytes."""
    return "\n".join(_lines(net)) + "\n"


def _lines(net: PetriNet) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield f'<pnml xmlns="{GRAMMAR}/pnml">'
    yield f'<net id={quoteattr(net.id)} type="{COLOURED if net.coloured else PLAIN}">'
    yield f"<name><text>{escape(net.id)}</text></name>"
    if net.coloured:
        yield from _declarations(net)
    yield '<page id="page">'
    for place in net.places:
        yield from _place(net, place)
    for transition in net.transitions:
        yield from _transition(transition)
    for arc in net.arcs:
        yield from _arc(net, arc)
    yield from ("</page>", "</net>", "</pnml>")


def _declarations(net: PetriNet) -> Iterator[str]:
    yield "<declaration><structure><declarations>"
    yield f'<namedsort id="{TOKEN}" name="{TOKEN}"><finiteenumeration>'
    for tokens in net.types.values():
        yield from (f"<feconstant id={quoteattr(each)} name={quoteattr(each)}/>" for each in tokens)
    yield "</finiteenumeration></namedsort>"
    yield f'<partition id="{TYPES}" name="{TYPES}"><usersort declaration="{TOKEN}"/>'
    for type_, tokens in net.types.items():
        yield f"<partitionelement id={quoteattr('type ' + type_)} name={quoteattr(type_)}>"
        yield from (f"<useroperator declaration={quoteattr(each)}/>" for each in tokens)
        yield "</partitionelement>"
    yield "</partition>"
    for name in dict.fromkeys(name for each in net.transitions for name, _ in each.variables):
        yield f'<variabledecl id={quoteattr(name)} name={quoteattr(name)}><usersort declaration="{TOKEN}"/></variabledecl>'
    yield "</declarations></structure></declaration>"


def _place(net: PetriNet, place: PetriPlace) -> Iterator[str]:
    yield f"<place id={quoteattr(place.id)}>"
    yield f"<name><text>{escape(place.name)}</text></name>"
    if not net.coloured:
        yield f"<initialMarking><text>{place.count}</text></initialMarking>"
    else:
        yield f'<type><structure><usersort declaration="{TOKEN}"/></structure></type>'
        if place.marking:
            terms = [f"<useroperator declaration={quoteattr(each)}/>" for each in place.marking]
            yield f"<hlinitialMarking><structure>{_sum(terms)}</structure></hlinitialMarking>"
    yield from _notes(place.notes)
    yield "</place>"


def _sum(terms: Sequence[str]) -> str:
    """A multiset in which each term stands once."""
    one = '<numberof><subterm><numberconstant value="1"><positive/></numberconstant></subterm><subterm>{}</subterm></numberof>'
    parts = [one.format(each) for each in terms]
    return (
        parts[0]
        if len(parts) == 1
        else "<add>" + "".join(f"<subterm>{each}</subterm>" for each in parts) + "</add>"
    )


def _transition(each: PetriTransition) -> Iterator[str]:
    yield f"<transition id={quoteattr(each.id)}>"
    yield f"<name><text>{escape(each.name)}</text></name>"
    if each.variables:
        yield f"<condition><structure>{_guard(each.variables)}</structure></condition>"
    yield from _notes(each.notes)
    yield "</transition>"


def _guard(variables: Sequence[tuple[str, str]]) -> str:
    """Each variable is bound to a token of its type."""
    parts = [
        f'<equality><subterm><partitionelementof refpartition="{TYPES}"><subterm><variable refvariable={quoteattr(name)}/>'
        f"</subterm></partitionelementof></subterm><subterm><useroperator declaration={quoteattr('type ' + type_)}/>"
        "</subterm></equality>"
        for name, type_ in variables
    ]
    whole = parts[0]
    for part in parts[1:]:
        whole = f"<and><subterm>{whole}</subterm><subterm>{part}</subterm></and>"
    return whole


def _arc(net: PetriNet, arc: PetriArc) -> Iterator[str]:
    yield f"<arc id={quoteattr(arc.id)} source={quoteattr(arc.source)} target={quoteattr(arc.target)}>"
    if not net.coloured:
        yield f"<inscription><text>{arc.count}</text></inscription>"
    else:
        terms = [f"<variable refvariable={quoteattr(name)}/>" for name in arc.variables]
        yield f"<hlinscription><structure>{_sum(terms)}</structure></hlinscription>"
    yield "</arc>"


def _notes(notes: Sequence[str]) -> Iterator[str]:
    if notes:
        yield '<toolspecific tool="cellwright" version="1">'
        yield from (f"<note>{escape(each)}</note>" for each in notes)
        yield "</toolspecific>"
