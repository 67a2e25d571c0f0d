"""Which contacts a cell can change by itself: along kinematic chains of controllable contacts (Matthiesen, section 4).

One law serves both directions: a contact can be made between two clusters, and broken into them, if the anchor point of one
of them is moved by a controllable chain and nothing in that cluster is held by the ground or by a passive joint.
"""

from collections.abc import Mapping
from functools import cached_property

from cellwright.engine.model.task_space import Cluster, Edge
from cellwright.engine.stages.states.clusters import Types, components, neighbours
from cellwright.kb.model.contacts import ContactClass, ContactModel, OneWay, class_of
from cellwright.kb.model.octuples import Octuple, Quadruple


class Rules:
    """The contact classes of a model, ready for the slots of its token types."""

    def __init__(self, model: ContactModel, types: Types) -> None:
        self.model, self.types = model, types
        self._kinds: dict[tuple[int, int, int, int], ContactClass | None] = {}

    def kind(self, key: int, key_slot: int, lock: int, lock_slot: int) -> ContactClass | None:
        """The contact class of two slots of two types, the key first; None if they do not match."""
        asked = (key, key_slot, lock, lock_slot)
        if asked not in self._kinds:
            first, second = self.types[key].slots[key_slot], self.types[lock].slots[lock_slot]
            contact = Octuple(self._point(key, key_slot), self._point(lock, lock_slot))
            fits = first.key and not second.key
            self._kinds[asked] = (
                class_of(contact, self.model.contact_classes, self.model.classes) if fits else None
            )
        return self._kinds[asked]

    def _point(self, kind: int, slot: int) -> Quadruple:
        token, at = self.types[kind], self.types[kind].slots[slot]
        return Quadruple(
            token.classes[at.position], token.members[0][at.position], at.anchor_class, at.anchors[0]
        )

    @cached_property
    def covers(self) -> Mapping[str, frozenset[str]]:
        """For each contact class, those that stand over it and hold it fast."""
        classes = self.model.contact_classes
        return {
            name: frozenset(each.name for each in classes.values() if each.over == name) for name in classes
        }

    def chain(self, cluster: Cluster) -> frozenset[int]:
        """The nodes that controllable joints move, directly or through fixed and controllable contacts."""
        near = neighbours(cluster)
        open_ = [node for node, kind in enumerate(cluster.nodes) if self.types[kind].driven]
        reached = set(open_)
        while open_:
            node = open_.pop()
            for edge, other in near[node]:
                rigid = self.model.contact_classes[edge.kind].rigid
                if rigid and other not in reached and self._driven_end(cluster, node, edge):
                    reached.add(other)
                    open_.append(other)
        return frozenset(node for node in reached if not self.types[cluster.nodes[node]].fixed)

    def _driven_end(self, cluster: Cluster, node: int, edge: Edge) -> bool:
        """Whether a contact is at a part of the node that moves: in a robot, beyond its joints."""
        kind = self.types[cluster.nodes[node]]
        if not kind.driven:
            return True
        return kind.slots[edge.key_slot if edge.key == node else edge.lock_slot].position in kind.driven

    def mobile(self, cluster: Cluster) -> frozenset[int]:
        """The nodes of a connected cluster that a robot can carry anywhere; empty if something holds the cluster back."""
        if not all(self.types[kind].loose for kind in cluster.nodes):
            return frozenset()
        return self.chain(cluster)

    def moves(self, cluster: Cluster, mobile: frozenset[int], node: int, slot: int) -> bool:
        """Whether the anchor points of a slot are on what moves."""
        kind = self.types[cluster.nodes[node]]
        return node in mobile and (not kind.driven or kind.slots[slot].position in kind.driven)

    def changeable(self, parted: Cluster, edge: Edge) -> bool:
        """Whether a contact can be made in a cluster, or side-by-side clusters, without it, or broken so that it is left."""
        kind = self.model.contact_classes[edge.kind]
        if any(self._between(parted, edge, each) for each in self.covers[edge.kind]):
            return False
        if kind.over:
            return self._between(parted, edge, kind.over) and bool(self.chain(parted) & {edge.key, edge.lock})
        for nodes in components(parted):
            sides = {edge.key, edge.lock} & set(nodes)
            if len(sides) == 2:
                return False
            if sides and self._free_side(parted, nodes, edge):
                return True
        return False

    def _free_side(self, parted: Cluster, nodes: list[int], edge: Edge) -> bool:
        kinds = (self.types[parted.nodes[node]] for node in nodes)
        if not all(kind.loose for kind in kinds):
            return False
        chain = self.chain(parted)
        ends = ((edge.key, edge.key_slot), (edge.lock, edge.lock_slot))
        return any(node in nodes and self.moves(parted, chain, node, slot) for node, slot in ends)

    @staticmethod
    def _between(cluster: Cluster, edge: Edge, kind: str) -> bool:
        return any((e.kind, e.key, e.lock) == (kind, edge.key, edge.lock) for e in cluster.edges)

    def makes(self, edge: Edge) -> bool:
        """Whether such a contact can be made at all."""
        return self.model.contact_classes[edge.kind].one_way is not OneWay.BREAKING

    def breaks(self, edge: Edge) -> bool:
        """Whether such a contact can be broken at all."""
        return self.model.contact_classes[edge.kind].one_way is not OneWay.MAKING
