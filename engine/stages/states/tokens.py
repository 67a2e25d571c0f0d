"""The tokens of a cell: permanent clusters, found from the permanent contacts, and which of them can be exchanged.

Terminals are objects that no joint moves. They do not join what stands on them into one cluster (Matthiesen, section 4):
those without anchor points are left out, and joints on terminals are not followed. Terminals with anchor points that are
fixed to each other are one cluster.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import networkx as nx

from cellwright.engine.model.task_space import Slot, TokenType
from cellwright.kb.model.contacts import GROUND, ContactModel, PermanentContact
from cellwright.kb.model.octuples import ANY, Octuple, named_in, variable

Individuals = Collection[tuple[str, str]]  # (object class, anchor point) that may not be exchanged for others


@dataclass(frozen=True)
class Bodies:
    """What the permanent contacts say of each object."""

    terminals: frozenset[str]
    passive: frozenset[str]
    driven: frozenset[str]
    clusters: tuple[tuple[str, ...], ...] = field(default=())


def bodies(model: ContactModel) -> Bodies:
    """Terminals, what passive joints and what controllable joints move, and the permanent clusters of the rest."""
    fixed: nx.Graph[str] = nx.Graph()
    every: nx.Graph[str] = nx.Graph()
    for graph in (fixed, every):
        graph.add_nodes_from([GROUND, *model.objects])
    for contact in model.permanent.values():
        every.add_edge(contact.first, contact.second)
        if not contact.freedom and not contact.controllable:
            fixed.add_edge(contact.first, contact.second)
    terminals = frozenset(nx.node_connected_component(fixed, GROUND)) - {GROUND}
    driven = frozenset(_driven(model, terminals))
    hung = frozenset(nx.node_connected_component(every, GROUND)) - terminals - driven - {GROUND}
    clusters = tuple(sorted(_clusters(model, terminals), key=lambda each: _rank(model, each)))
    return Bodies(terminals, hung, driven, clusters)


def _driven(model: ContactModel, terminals: Collection[str]) -> Iterator[str]:
    """The objects that controllable joints move: beyond such a joint, through fixed and controllable contacts."""
    for joint in (each for each in model.permanent.values() if each.controllable and not each.by):
        onward: nx.Graph[str] = nx.Graph()
        onward.add_node(joint.second)
        others = (each for each in model.permanent.values() if each is not joint)
        onward.add_edges_from((c.first, c.second) for c in others if c.controllable or not c.freedom)
        reached = nx.node_connected_component(onward, joint.second)
        yield from (each for each in reached if each not in terminals and each != GROUND)


def _clusters(model: ContactModel, terminals: Collection[str]) -> Iterator[tuple[str, ...]]:
    bare = {each for each in terminals if not _anchors(model, each)} | {GROUND}
    together: nx.Graph[str] = nx.Graph()
    together.add_nodes_from(each for each in model.objects if each not in bare)
    for contact in model.permanent.values():
        ends = {contact.first, contact.second}
        on_terminal = contact.freedom and ends & set(terminals)
        if not ends & bare and not on_terminal:
            together.add_edge(contact.first, contact.second)
    order = list(model.objects)
    for each in nx.connected_components(together):
        objects = tuple(sorted((o for o in each if _anchors(model, o)), key=order.index))
        if objects:
            yield objects


def _anchors(model: ContactModel, instance: str) -> bool:
    return bool(model.classes[model.objects[instance]].anchors)


def _rank(model: ContactModel, objects: tuple[str, ...]) -> int:
    return list(model.objects).index(objects[0])


def token_types(
    model: ContactModel, parts: Collection[str] = (), full: bool = False, individuals: Individuals = ()
) -> tuple[TokenType, ...]:
    """The token types of a cell, or of the clusters of its `parts` alone (objects or classes, with only their anchor points).

    If `full`, every object and every anchor point is an individual.
    """
    found = bodies(model)
    named = set(_named(model))
    groups: dict[tuple[object, ...], list[tuple[str, ...]]] = {}
    for cluster in found.clusters:
        kept = tuple(each for each in cluster if not parts or _chosen(model, each, parts))
        if not kept:
            continue
        alone = full or any(each in named for each in kept)
        groups.setdefault(_signature(model, found, kept, alone), []).append(kept)
    splits = {(kind, anchor) for kind, anchor in individuals} | set(_named_points(model))
    return tuple(
        _type(model, found, members, full or any(each in named for each in members[0]), full, splits)
        for members in groups.values()
    )


def _chosen(model: ContactModel, instance: str, parts: Collection[str]) -> bool:
    return bool({instance, *model.kinds(instance)} & set(parts))


def _signature(
    model: ContactModel, found: Bodies, objects: tuple[str, ...], alone: bool
) -> tuple[object, ...]:
    if alone:
        return objects
    sides = tuple((each in found.terminals, each in found.passive, each in found.driven) for each in objects)
    inner = tuple(
        (objects.index(c.first), objects.index(c.second), c.freedom, c.controllable)
        for c in model.permanent.values()
        if c.first in objects and c.second in objects
    )
    return (tuple(model.objects[each] for each in objects), sides, inner)


def _patterns(model: ContactModel) -> Iterator[Octuple]:
    """Every template by which objects or anchor points could be told apart."""
    yield from (each.template for each in model.contact_classes.values())
    yield from (contact for each in model.undesirable for contact in each.contacts)
    for several in (model.relevance, model.restrictions):
        yield from (each.contact for each in several)
        yield from (each.during for each in several if each.during)


def _named(model: ContactModel) -> Iterator[str]:
    for pattern in _patterns(model):
        for point in named_in(pattern):
            if point.instance != ANY and not variable(point.instance):
                yield point.instance


def _named_points(model: ContactModel) -> Iterator[tuple[str, str]]:
    for pattern in _patterns(model):
        for point in named_in(pattern):
            if point.anchor != ANY and not variable(point.anchor):
                yield from ((kind, point.anchor) for kind in model.classes)


def _type(
    model: ContactModel,
    found: Bodies,
    members: list[tuple[str, ...]],
    alone: bool,
    full: bool,
    splits: Collection[tuple[str, str]],
) -> TokenType:
    first = members[0]
    classes = tuple(model.objects[each] for each in first)
    slots = [
        slot for position, kind in enumerate(classes) for slot in _slots(model, position, kind, full, splits)
    ]
    return TokenType(
        "+".join(first if alone else classes),
        tuple(members),
        classes,
        tuple(slots),
        any(each in found.terminals for each in first),
        any(each in found.passive for each in first),
        frozenset(n for n, each in enumerate(first) if each in found.driven),
    )


def _slots(
    model: ContactModel, position: int, kind: str, full: bool, splits: Collection[tuple[str, str]]
) -> Iterator[Slot]:
    anchors = model.classes[kind].anchors.values()
    counts: dict[str, int] = {}
    groups: dict[tuple[str, str], list[str]] = {}
    for each in anchors:
        counts[each.anchor_class] = counts.get(each.anchor_class, 0) + 1
        alone = full or (kind, each.name) in splits
        groups.setdefault((each.anchor_class, each.name if alone else ""), []).append(each.name)
    sides = {each.anchor_class: each.key for each in anchors}
    for (anchor_class, _), names in groups.items():
        yield Slot(position, anchor_class, tuple(names), sides[anchor_class], counts[anchor_class] > 1)


def moved_by_hand(model: ContactModel) -> Mapping[str, tuple[str, ...]]:
    """For each joint with settings, the objects that are handled in order to move it; empty if its controller does it."""
    found = bodies(model)
    return {name: tuple(_handles(joint, found)) for name, joint in model.permanent.items() if joint.settings}


def _handles(joint: PermanentContact, found: Bodies) -> Iterable[str]:
    if joint.by:
        return (joint.by,)
    if joint.controllable:
        return ()
    return (joint.second if joint.first in {GROUND, *found.terminals} else joint.first,)
