"""Token types of a cell: permanent clusters of objects, and which of them can be exchanged.

Terminals are objects that no joint moves. They do not join what stands on them into one cluster
(Matthiesen, section 4): those without anchor points are left out, and joints on terminals are not
followed. Terminals with anchor points that are fixed to each other are one cluster.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import networkx as nx

from cellwright.engine.model.task_space import AnchorSlot, TokenType
from cellwright.kb.model.contact_model import (
    ANY,
    GROUND_OBJECT,
    ContactModel,
    Octuple,
    PermanentContact,
    is_variable_name,
    named_in,
)

# (object class, anchor point) that may not be exchanged for others
Individuals = Collection[tuple[str, str]]


@dataclass(frozen=True)
class PermanentBodies:
    """What the permanent contacts say of each object."""

    terminals: frozenset[str]
    passive: frozenset[str]
    driven: frozenset[str]
    clusters: tuple[tuple[str, ...], ...] = field(default=())


def permanent_bodies(model: ContactModel) -> PermanentBodies:
    """Terminals, what passive joints and what controllable joints move, and the permanent
    clusters of the rest.
    """
    fixed: nx.Graph[str] = nx.Graph()
    every: nx.Graph[str] = nx.Graph()
    for graph in (fixed, every):
        graph.add_nodes_from([GROUND_OBJECT, *model.objects])
    for contact in model.permanent.values():
        every.add_edge(contact.first, contact.second)
        if not contact.freedom and not contact.controllable:
            fixed.add_edge(contact.first, contact.second)
    terminals = frozenset(nx.node_connected_component(fixed, GROUND_OBJECT)) - {GROUND_OBJECT}
    driven = frozenset(_driven_objects(model, terminals))
    hung = (
        frozenset(nx.node_connected_component(every, GROUND_OBJECT))
        - terminals
        - driven
        - {GROUND_OBJECT}
    )
    clusters = tuple(
        sorted(
            _permanent_clusters(model, terminals), key=lambda cluster: _cluster_rank(model, cluster)
        )
    )
    return PermanentBodies(terminals, hung, driven, clusters)


def _driven_objects(model: ContactModel, terminals: Collection[str]) -> Iterator[str]:
    """The objects that controllable joints move: beyond such a joint, through fixed and
    controllable contacts.
    """
    for joint in (
        permanent
        for permanent in model.permanent.values()
        if permanent.controllable and not permanent.by
    ):
        onward: nx.Graph[str] = nx.Graph()
        onward.add_node(joint.second)
        further_joints = (
            permanent for permanent in model.permanent.values() if permanent is not joint
        )
        onward.add_edges_from(
            (c.first, c.second) for c in further_joints if c.controllable or not c.freedom
        )
        reached = nx.node_connected_component(onward, joint.second)
        yield from (
            instance
            for instance in reached
            if instance not in terminals and instance != GROUND_OBJECT
        )


def _permanent_clusters(
    model: ContactModel, terminals: Collection[str]
) -> Iterator[tuple[str, ...]]:
    bare = {terminal for terminal in terminals if not _has_anchors(model, terminal)} | {
        GROUND_OBJECT
    }
    together: nx.Graph[str] = nx.Graph()
    together.add_nodes_from(instance for instance in model.objects if instance not in bare)
    for contact in model.permanent.values():
        ends = {contact.first, contact.second}
        on_terminal = contact.freedom and ends & set(terminals)
        if not ends & bare and not on_terminal:
            together.add_edge(contact.first, contact.second)
    order = list(model.objects)
    for component in nx.connected_components(together):
        objects = tuple(sorted((o for o in component if _has_anchors(model, o)), key=order.index))
        if objects:
            yield objects


def _has_anchors(model: ContactModel, instance: str) -> bool:
    return bool(model.classes[model.objects[instance]].anchors)


def _cluster_rank(model: ContactModel, objects: tuple[str, ...]) -> int:
    return list(model.objects).index(objects[0])


def token_types(
    model: ContactModel,
    parts: Collection[str] = (),
    full: bool = False,
    individuals: Individuals = (),
) -> tuple[TokenType, ...]:
    """The token types of a cell, or of the clusters of its `parts` alone (objects or classes, with
    only their anchor points).

    If `full`, every object and every anchor point is an individual.
    """
    permanent = permanent_bodies(model)
    named = set(_named_objects(model))
    groups: dict[tuple[object, ...], list[tuple[str, ...]]] = {}
    for cluster in permanent.clusters:
        chosen = tuple(
            instance for instance in cluster if not parts or _is_chosen(model, instance, parts)
        )
        if not chosen:
            continue
        alone = full or any(instance in named for instance in chosen)
        groups.setdefault(_cluster_signature(model, permanent, chosen, alone), []).append(chosen)
    splits = {(kind, anchor) for kind, anchor in individuals} | set(_named_points(model))
    return tuple(
        _token_type(
            model,
            permanent,
            members,
            full or any(instance in named for instance in members[0]),
            full,
            splits,
        )
        for members in groups.values()
    )


def _is_chosen(model: ContactModel, instance: str, parts: Collection[str]) -> bool:
    return bool({instance, *model.kinds(instance)} & set(parts))


def _cluster_signature(
    model: ContactModel, permanent: PermanentBodies, objects: tuple[str, ...], alone: bool
) -> tuple[object, ...]:
    if alone:
        return objects
    sides = tuple(
        (
            instance in permanent.terminals,
            instance in permanent.passive,
            instance in permanent.driven,
        )
        for instance in objects
    )
    inner = tuple(
        (objects.index(c.first), objects.index(c.second), c.freedom, c.controllable)
        for c in model.permanent.values()
        if c.first in objects and c.second in objects
    )
    return (tuple(model.objects[instance] for instance in objects), sides, inner)


def _all_templates(model: ContactModel) -> Iterator[Octuple]:
    """Every template by which objects or anchor points could be told apart."""
    yield from (contact_class.template for contact_class in model.contact_classes.values())
    yield from (contact for undesired in model.undesirable for contact in undesired.contacts)
    for several in (model.relevance, model.restrictions):
        yield from (rule.contact for rule in several)
        yield from (rule.during for rule in several if rule.during)


def _named_objects(model: ContactModel) -> Iterator[str]:
    for pattern in _all_templates(model):
        for point in named_in(pattern):
            if point.instance != ANY and not is_variable_name(point.instance):
                yield point.instance


def _named_points(model: ContactModel) -> Iterator[tuple[str, str]]:
    for pattern in _all_templates(model):
        for point in named_in(pattern):
            if point.anchor != ANY and not is_variable_name(point.anchor):
                yield from ((kind, point.anchor) for kind in model.classes)


def _token_type(
    model: ContactModel,
    permanent: PermanentBodies,
    members: list[tuple[str, ...]],
    alone: bool,
    full: bool,
    splits: Collection[tuple[str, str]],
) -> TokenType:
    first = members[0]
    classes = tuple(model.objects[instance] for instance in first)
    slots = [
        slot
        for position, kind in enumerate(classes)
        for slot in _token_slots(model, position, kind, full, splits)
    ]
    return TokenType(
        "+".join(first if alone else classes),
        tuple(members),
        classes,
        tuple(slots),
        any(instance in permanent.terminals for instance in first),
        any(instance in permanent.passive for instance in first),
        frozenset(n for n, instance in enumerate(first) if instance in permanent.driven),
    )


def _token_slots(
    model: ContactModel, position: int, kind: str, full: bool, splits: Collection[tuple[str, str]]
) -> Iterator[AnchorSlot]:
    anchors = model.classes[kind].anchors.values()
    counts: dict[str, int] = {}
    groups: dict[tuple[str, str], list[str]] = {}
    for anchor in anchors:
        counts[anchor.anchor_class] = counts.get(anchor.anchor_class, 0) + 1
        alone = full or (kind, anchor.name) in splits
        groups.setdefault((anchor.anchor_class, anchor.name if alone else ""), []).append(
            anchor.name
        )
    sides = {anchor.anchor_class: anchor.key for anchor in anchors}
    for (anchor_class, _), names in groups.items():
        yield AnchorSlot(
            position, anchor_class, tuple(names), sides[anchor_class], counts[anchor_class] > 1
        )


def handled_objects_of_joints(model: ContactModel) -> Mapping[str, tuple[str, ...]]:
    """For each joint with settings, the objects that are handled in order to move it; empty if
    its controller does it.
    """
    permanent = permanent_bodies(model)
    return {
        name: tuple(_handled_objects(joint, permanent))
        for name, joint in model.permanent.items()
        if joint.settings
    }


def _handled_objects(joint: PermanentContact, permanent: PermanentBodies) -> Iterable[str]:
    if joint.by:
        return (joint.by,)
    if joint.controllable:
        return ()
    return (joint.second if joint.first in {GROUND_OBJECT, *permanent.terminals} else joint.first,)
