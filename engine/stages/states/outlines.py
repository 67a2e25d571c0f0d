"""What matters of a cluster: its outline. Clusters with the same outline are in the same place.

By default these contacts matter: in a cluster with a robot, those of the robot, of the object in its hand, and of everything
that moves along; in other clusters all. Where an object has several anchor points of a class, nobody counts which of them
are taken: their number is a capacity. `relevance` in the contact model says what is different in a cell.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from cellwright.engine.model.task_space import Cluster, Edge, Slot, Space
from cellwright.engine.stages.states.clusters import Named, free, neighbours
from cellwright.engine.stages.states.rules import Rules
from cellwright.kb.model.contacts import describes
from cellwright.kb.model.octuples import Octuple, Quadruple, void_of

Mark = tuple[object, ...]
Near = Sequence[Sequence[tuple[Edge, int]]]
Positions = Sequence[frozenset[int]]  # for each node


@dataclass(frozen=True, slots=True)
class Outline:
    """`order` lists the nodes that matter, from the root. `core` is what distinguishes the place.

    `margin` says of the other single anchor points of these nodes what is there. `counted` are the contacts that only
    count, and `hanging` the nodes beyond them.
    """

    cluster: Cluster
    order: tuple[int, ...]
    core: tuple[Mark, ...]
    edges: tuple[Edge, ...]
    margin: dict[tuple[int, int], Mark]
    counted: tuple[Edge, ...]
    hanging: frozenset[int]

    @property
    def key(self) -> Mark:
        """Equal for clusters of one place."""
        return (tuple(self.cluster.nodes[node] for node in self.order), tuple(sorted(self.core, key=str)))


class Outliner:
    """Makes the outlines of the clusters of a space."""

    def __init__(self, space: Space, full: bool = False) -> None:
        self.space, self.types, self.full = space, space.types, full
        self.rules = Rules(space.model, space.types)

    def outline(self, cluster: Cluster) -> Outline:
        """The outline of a connected cluster."""
        near = neighbours(cluster)
        whole = [self._seen(cluster, node, near) for node in range(len(cluster.nodes))]
        named = Named(cluster, self.types) if self.space.model.relevance else None
        order, core, edges = self._roots(cluster), list[Mark](), dict[Edge, None]()
        for node in order:
            for slot, at, there in self._slots(cluster, node, near):
                if at.position in whole[node] and self._matters(cluster, named, (node, slot), at, there):
                    core += [] if there else [(order.index(node), slot, "void")]
                    order += [other for _, other in there if other not in order]
                    edges |= dict.fromkeys(edge for edge, _ in there)
        core += [self._mark(edge, order) for edge in edges]
        margin = dict(self._margin(cluster, order, edges, whole, near))
        counted, hanging = self._beside(cluster, order, edges, near)
        return Outline(cluster, tuple(order), tuple(core), tuple(edges), margin, counted, hanging)

    def _slots(
        self, cluster: Cluster, node: int, near: Near
    ) -> Iterator[tuple[int, Slot, list[tuple[Edge, int]]]]:
        """The slots of a node, each with its contacts."""
        for slot, at in enumerate(self.types[cluster.nodes[node]].slots):
            yield slot, at, [(edge, other) for edge, other in near[node] if (node, slot) in _ends(edge)]

    def _matters(
        self,
        cluster: Cluster,
        named: Named | None,
        end: tuple[int, int],
        at: Slot,
        there: Sequence[tuple[Edge, int]],
    ) -> bool:
        """Whether the contacts of a slot are distinguished: as the model says, else where there is one anchor point."""
        if self.full:
            return True
        said = self._verdict(cluster, named, *end, there) if named is not None else None
        return not at.several if said is None else said

    def _margin(
        self, cluster: Cluster, order: Sequence[int], edges: Collection[Edge], whole: Positions, near: Near
    ) -> Iterator[tuple[tuple[int, int], Mark]]:
        """What is at the other single anchor points of the nodes that matter."""
        for number, node in enumerate(order):
            for slot, at, there in self._slots(cluster, node, near):
                known = at.position in whole[node] or any(edge in edges for edge, _ in there)
                if not known and not at.several:
                    yield (number, slot), tuple((cluster.nodes[other], edge.kind) for edge, other in there)

    def _beside(
        self, cluster: Cluster, order: Sequence[int], edges: Collection[Edge], near: Near
    ) -> tuple[tuple[Edge, ...], frozenset[int]]:
        """The contacts at anchor points of which there are several, what hangs on them, and so on."""
        found, hanging = dict[Edge, None](), dict[int, None]()
        for node in order:
            for _, at, there in self._slots(cluster, node, near):
                if at.several:
                    found |= dict.fromkeys(edge for edge, _ in there if edge not in edges)
                    hanging |= dict.fromkeys(other for _, other in there if other not in order)
        open_ = list(hanging)
        for node in open_:
            beyond = [(edge, other) for edge, other in near[node] if other not in order]
            found |= dict.fromkeys(edge for edge, _ in beyond)
            open_ += [other for _, other in beyond if other not in hanging]
            hanging |= dict.fromkeys(other for _, other in beyond)
        return tuple(found), frozenset(hanging)

    def _mark(self, edge: Edge, order: list[int]) -> Mark:
        return (order.index(edge.key), edge.key_slot, order.index(edge.lock), edge.lock_slot, edge.kind)

    def _roots(self, cluster: Cluster) -> list[int]:
        """The robots; without any, the one node that stands firmest."""

        def rank(node: int) -> tuple[bool, bool, int, int]:
            kind = self.types[cluster.nodes[node]]
            return not kind.fixed, not kind.passive, cluster.nodes[node], node

        ranked = sorted(range(len(cluster.nodes)), key=rank)
        return [node for node in ranked if self.types[cluster.nodes[node]].driven] or ranked[:1]

    def _seen(
        self, cluster: Cluster, node: int, near: Sequence[Sequence[tuple[Edge, int]]]
    ) -> frozenset[int]:
        """The positions of a node's objects whose contacts matter."""
        kind = self.types[cluster.nodes[node]]
        every = frozenset(range(len(kind.classes)))
        if self.full or kind.loose or not any(self.types[each].driven for each in cluster.nodes):
            return every
        held = (
            kind.slots[edge.lock_slot if edge.lock == node else edge.key_slot].position
            for edge, other in near[node]
            if self.types[cluster.nodes[other]].driven
        )
        return frozenset(held)

    def _verdict(
        self,
        cluster: Cluster,
        named: Named,
        node: int,
        slot: int,
        there: Sequence[tuple[Edge, int]],
    ) -> bool | None:
        """What `relevance` says of a slot: whether its contacts matter; None if it says nothing. The last entry decides."""
        shown = [named.contacts[cluster.edges.index(e)] for e, _ in there]
        shown = shown or self._possible(named.point(node, slot), cluster.nodes[node], slot)
        found = None
        for each in self.space.model.relevance:
            hit = bool(shown) and all(self._about(each.contact, contact) for contact in shown)
            if hit and (each.during is None or self._holds(each.during, named)):
                found = each.matters
        return found

    def _possible(self, point: Quadruple, kind: int, slot: int) -> list[Octuple]:
        """The contacts that could be at a free anchor point: one for each slot that matches."""
        found = []
        for other, token in enumerate(self.types):
            for n, at in enumerate(token.slots):
                ends = (kind, slot, other, n) if self.types[kind].slots[slot].key else (other, n, kind, slot)
                if self.rules.kind(*ends) is not None:
                    name = token.members[0][at.position]
                    partner = Quadruple(token.classes[at.position], name, at.anchor_class, at.anchors[0])
                    found.append(Octuple(point, partner))
        return found

    def _about(self, template: Octuple, contact: Octuple) -> bool:
        return next(describes(self.space.model, template, contact), None) is not None

    def _holds(self, template: Octuple, named: Named) -> bool:
        return any(self._about(template, contact) for contact in named.contacts.values())


def _ends(edge: Edge) -> tuple[tuple[int, int], tuple[int, int]]:
    return (edge.key, edge.key_slot), (edge.lock, edge.lock_slot)


def partners(space: Space) -> dict[str, str]:
    """For each anchor class, the class that matches it: what a free anchor point waits for."""
    found = {"*": "*"}
    for each in space.model.contact_classes.values():
        found.setdefault(each.key.anchor_class, each.lock.anchor_class)
        found.setdefault(each.lock.anchor_class, each.key.anchor_class)
    for kind in space.types:
        for slot in kind.slots:
            found.setdefault(slot.anchor_class, "*")
    return found


Shown = tuple[Octuple, Edge | None]


def needed(outline: Outline, space: Space, uniform: frozenset[tuple[int, int]]) -> Iterator[Shown]:
    """The contacts, with their edges, and the free anchor points that matter; of the margin only what is `uniform`."""
    named = Named(outline.cluster, space.types)
    edges = dict.fromkeys((*outline.edges, *_margin_edges(outline, uniform)))
    yield from ((named.contacts[outline.cluster.edges.index(edge)], edge) for edge in edges)
    core = {(number, slot) for number, slot, *rest in outline.core if rest == ["void"]}
    for void, node, slot in _voids(outline, space, named):
        number = outline.order.index(node) if node in outline.order else -1
        if (number, slot) in core | uniform:
            yield void, None


def counted(outline: Outline, space: Space) -> Iterator[Octuple]:
    """The contacts that only count, and the free anchor points of what hangs on them."""
    named = Named(outline.cluster, space.types)
    places = [n for n, edge in enumerate(outline.cluster.edges) if edge in outline.counted]
    yield from (named.contacts[n] for n in places)
    for void, node, slot in _voids(outline, space, named):
        if node in outline.hanging and not space.types[outline.cluster.nodes[node]].slots[slot].several:
            yield void


def _voids(outline: Outline, space: Space, named: Named) -> Iterator[tuple[Octuple, int, int]]:
    """The free anchor points of a cluster, each with its node and slot."""
    partner = partners(space)
    for node, slots in enumerate(free(outline.cluster, space.types)):
        for slot, left in slots.items():
            at = space.types[outline.cluster.nodes[node]].slots[slot]
            for number in range(len(at.anchors) - left, len(at.anchors)):
                yield Octuple(named.point(node, slot, number), void_of(partner[at.anchor_class])), node, slot


def _margin_edges(outline: Outline, uniform: frozenset[tuple[int, int]]) -> Iterator[Edge]:
    for number, slot in sorted(uniform):
        node = outline.order[number]
        yield from (
            edge
            for edge in outline.cluster.edges
            if (node, slot) in _ends(edge) and edge not in outline.edges
        )
