"""Nets of contact states as Petri nets for other tools."""

from collections import Counter
from collections.abc import Iterator

from cellwright.engine.model.petri import PetriArc, PetriNet, PetriPlace, PetriTransition
from cellwright.engine.model.task_space import Net, Place, Transition


def unfolded(net: Net) -> PetriNet:
    """A place/transition net. A token is a whole cluster; the net by contact class gives the coarser net of its places."""
    places = tuple(PetriPlace(p.name, p.say, p.initial, (), tuple(_notes(p))) for p in net.places)
    transitions: list[PetriTransition] = []
    arcs: list[PetriArc] = []
    for number, each in enumerate(net.transitions, 1):
        name = f"T{number}"
        transitions.append(PetriTransition(name, each.name, (), _conditions(each)))
        for place, count in sorted(Counter(each.inputs).items()):
            arcs.append(PetriArc(f"{place}_{name}", place, name, count))
        for place, count in sorted(Counter(each.outputs).items()):
            arcs.append(PetriArc(f"{name}_{place}", name, place, count))
    return PetriNet(_id(net.name), places, tuple(transitions), tuple(arcs))


def symmetric(net: Net) -> PetriNet:
    """A symmetric net: the tokens are the permanent clusters, each of its type."""
    start = _marking(net)
    places = tuple(
        PetriPlace(p.name, p.say, len(start[p.name]), tuple(start[p.name]), tuple(_notes(p)))
        for p in net.places
    )
    transitions: list[PetriTransition] = []
    arcs: list[PetriArc] = []
    for number, each in enumerate(net.transitions, 1):
        for mode, moved in enumerate(_modes(net, each), 1):
            name = f"T{number}_{mode}"
            variables = [
                (source, target, f"{type_}_{n}", type_)
                for type_, rows in _by_type(moved).items()
                for n, (source, target) in enumerate(rows, 1)
            ]
            bound = tuple((_id(variable), type_) for _, _, variable, type_ in variables)
            transitions.append(PetriTransition(name, each.name, bound, _conditions(each)))
            arcs += _arcs(
                name, [(source, target, _id(variable)) for source, target, variable, _ in variables]
            )
    return PetriNet(_id(net.name), places, tuple(transitions), tuple(arcs), dict(net.colours))


Rows = list[tuple[str, str]]


def _modes(net: Net, transition: Transition) -> Iterator[tuple[tuple[str, str, str, int], ...]]:
    """What each step of a transition moves: (from place, to place, type, count). Each different one once."""
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
    found: dict[str, Rows] = {}
    for source, target, type_, count in moved:
        found.setdefault(type_, []).extend([(source, target)] * count)
    return found


def _arcs(name: str, variables: list[tuple[str, str, str]]) -> Iterator[PetriArc]:
    inputs: dict[str, list[str]] = {}
    outputs: dict[str, list[str]] = {}
    for source, target, variable in variables:
        inputs.setdefault(source, []).append(variable)
        outputs.setdefault(target, []).append(variable)
    for place, moved in inputs.items():
        yield PetriArc(f"{place}_{name}", place, name, len(moved), tuple(moved))
    for place, moved in outputs.items():
        yield PetriArc(f"{name}_{place}", name, place, len(moved), tuple(moved))


def _marking(net: Net) -> dict[str, list[str]]:
    """The tokens in each place at the start."""
    left = {name: list(tokens) for name, tokens in net.colours.items()}
    found: dict[str, list[str]] = {}
    for place in net.places:
        here = found.setdefault(place.name, [])
        for type_, count in place.tokens:
            here += [left[type_].pop(0) for _ in range(count)]
    return found


def _notes(place: Place) -> Iterator[str]:
    yield from (f"capacity {type_} {count}" for type_, count in place.capacity)
    yield from (f"contact {each}" for each in place.contacts)


def _conditions(transition: Transition) -> tuple[str, ...]:
    return tuple(f"if {each}" for each in transition.restrictions)


def _id(name: str) -> str:
    """A name as an XML identifier."""
    return "".join(each if each.isalnum() or each in "_-." else "_" for each in name)
