"""Places: clusters that have the same outline, with the template in the normal form, a description and capacities."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.model.task_space import Cluster, Edge, Place, Space
from cellwright.engine.stages.states.clusters import counts_of
from cellwright.engine.stages.states.counting import Graph
from cellwright.engine.stages.states.outlines import Mark, Outline, Outliner, counted, needed
from cellwright.kb.model.octuples import Octuple, Quadruple, numbered


@dataclass(frozen=True)
class Sorted:
    """The forms sorted into places: `place_of` gives the number of a form's place, `outlines` the outline of each form."""

    places: tuple[Place, ...]
    place_of: Mapping[int, int]
    outlines: Mapping[int, Outline]
    uniform: tuple[frozenset[tuple[int, int]], ...]


def places(space: Space, graph: Graph | None, full: bool = False) -> Sorted:
    """All places with a form that can be reached. They are numbered in the order in which they are reached."""
    outliner = Outliner(space, full)
    order = list(_reached(space, graph))
    outlines = {form: outliner.outline(space.forms[form].cluster) for form in order}
    groups: dict[Mark, list[int]] = {}
    for form in order:
        groups.setdefault(outlines[form].key, []).append(form)
    most = _capacities(space, graph, groups, order)
    start = Counter(space.initial)
    made: list[Place] = []
    place_of: dict[int, int] = {}
    uniform = []
    for number, (key, forms) in enumerate(groups.items()):
        same = _uniform([outlines[form] for form in forms])
        largest = outlines[max(forms, key=lambda form: len(space.forms[form].cluster.nodes))]
        first = [contact for contact, _ in needed(largest, space, same)]
        contacts = normal(space, [*first, *counted(largest, space)], full)
        capacity = tuple((space.types[kind].name, n) for kind, n in sorted(most[key].items()) if n)
        robot = any(space.types[kind].driven for kind in largest.cluster.nodes)
        initial = sum(start[form] for form in forms)
        there = Counter[int]()
        for form in forms:
            for kind, n in counts_of(space.forms[form].cluster.nodes).items():
                there[kind] += n * start[form]
        tokens = tuple((space.types[kind].name, n) for kind, n in sorted(there.items()) if n)
        said = describe(space, largest)
        made.append(Place(f"P{number + 1}", said, contacts, capacity, robot, tuple(forms), initial, tokens))
        uniform.append(same)
        place_of |= {form: number for form in forms}
    return Sorted(tuple(made), place_of, outlines, tuple(uniform))


def _reached(space: Space, graph: Graph | None) -> Iterator[int]:
    """The forms in the order in which they appear: at the start those without contacts first."""
    first = sorted(set(space.initial), key=lambda form: (len(space.forms[form].cluster.edges) > 0, form))
    seen = dict.fromkeys(first)
    if graph is None:
        seen |= dict.fromkeys(range(len(space.forms)))
    else:
        for following in graph.values():
            for step, _ in following:
                seen |= dict.fromkeys(step.outputs)
    yield from seen


def _capacities(
    space: Space, graph: Graph | None, groups: Mapping[Mark, list[int]], order: Sequence[int]
) -> dict[Mark, Counter[int]]:
    """The most tokens of each type that are in a place at the same time."""
    key_of = {form: key for key, forms in groups.items() for form in forms}
    most = {key: Counter[int]() for key in groups}
    markings = graph if graph is not None else [(form,) for form in order]
    for marking in markings:
        here: dict[Mark, Counter[int]] = {}
        for form in marking:
            here.setdefault(key_of[form], Counter()).update(counts_of(space.forms[form].cluster.nodes))
        for key, count in here.items():
            most[key] |= count
    return most


def _uniform(outlines: Sequence[Outline]) -> frozenset[tuple[int, int]]:
    """The anchor points beside the core at which the same holds in all clusters of a place."""
    first, *others = outlines
    return frozenset(
        at for at, mark in first.margin.items() if all(each.margin.get(at) == mark for each in others)
    )


def normal(space: Space, contacts: Sequence[Octuple], full: bool = False) -> tuple[Octuple, ...]:
    """Contacts in the normal form, contacts before free anchor points.

    Objects are variables and, where there are several, so are anchor points; with `full`, everything has its name.
    """
    ordered = sorted(contacts, key=lambda each: each.second.void)
    if full:
        return tuple(ordered)
    several = {
        (space.types[k].classes[slot.position], anchor)
        for k in range(len(space.types))
        for slot in space.types[k].slots
        if slot.several and len(slot.anchors) > 1
        for anchor in slot.anchors
    }
    names: dict[tuple[str, str], str] = {}

    def renamed(point: Quadruple) -> Quadruple:
        if (point.object_class, point.anchor) not in several:
            return point
        name = names.setdefault((point.instance, point.anchor), f"A{len(names) + 1}")
        return Quadruple(point.object_class, point.instance, point.anchor_class, name)

    return numbered([Octuple(renamed(each.first), renamed(each.second)) for each in ordered])


def describe(space: Space, outline: Outline) -> str:
    """A place in words: what the robot holds, and where that is; or what is with a device."""
    cluster, types = outline.cluster, space.types
    root = outline.order[0]
    name = types[cluster.nodes[root]].name
    if not outline.edges:
        inside = _inside(space, outline)
        return f"{name} with {inside}" if inside else f"{name} free"
    if not types[cluster.nodes[root]].driven:
        inside = _inside(space, outline)
        parts = _partners(space, cluster, root, outline.edges)
        return f"{name} with {', '.join([*parts, *([inside] if inside else [])])}"
    said = []
    for edge in outline.edges:
        if root in (edge.key, edge.lock):
            held, slot = (edge.lock, edge.lock_slot) if edge.key == root else (edge.key, edge.key_slot)
            others = [e for e in outline.edges if e is not edge]
            on = _partners(space, cluster, held, others)
            said.append(types[cluster.nodes[held]].slot_name(slot) + (f" in {', '.join(on)}" if on else ""))
    return f"{name} holds {' and '.join(said)}"


def _partners(space: Space, cluster: Cluster, node: int, edges: Sequence[Edge]) -> list[str]:
    """The objects that a node is in contact with, with the contact classes."""
    found: dict[tuple[int, str], list[str]] = {}
    for edge in edges:
        if node in (edge.key, edge.lock):
            other, slot = (edge.lock, edge.lock_slot) if edge.key == node else (edge.key, edge.key_slot)
            name = space.types[cluster.nodes[other]].slot_name(slot)
            found.setdefault((other, name), []).append(edge.kind)
    return [f"{name} ({', '.join(kinds)})" for (_, name), kinds in found.items()]


def _inside(space: Space, outline: Outline) -> str:
    """What the several anchor points hold."""
    kinds = Counter(space.types[outline.cluster.nodes[node]].name for node in outline.hanging)
    return ", ".join(f"{kind} (up to {n})" if n > 1 else kind for kind, n in sorted(kinds.items()))
