"""Generates the contact states of clusters and the steps between them, by the cell's joints.

One law serves both directions: a contact can be made between two clusters, and broken into them, if
the anchor point of one of them is moved by a controllable chain and nothing in that cluster is held
by the ground or by a passive joint.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from cellwright.engine.model.task_space import (
    ClusterForm,
    ContactEdge,
    ContactStep,
    FormSpace,
    Removed,
    TokenCluster,
    TokenType,
)
from cellwright.engine.ports import ContactFilter
from cellwright.engine.stages.states.clusters import (
    Key,
    NamedCluster,
    Types,
    cluster_components,
    cluster_neighbours,
    counts_of,
    form_of_cluster,
    free_slots,
    join_clusters,
    part_of_cluster,
)
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.contact_model import (
    ContactClass,
    ContactModel,
    Octuple,
    OneWay,
    Quadruple,
    class_of,
)


class ContactRules:
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
            token.classes[at.position],
            token.members[0][at.position],
            at.anchor_class,
            at.anchors[0],
        )

    @cached_property
    def covers(self) -> Mapping[str, frozenset[str]]:
        """For each contact class, those that stand over it and hold it fast."""
        classes = self.model.contact_classes
        return {
            name: frozenset(
                contact_class.name
                for contact_class in classes.values()
                if contact_class.over == name
            )
            for name in classes
        }

    def chain(self, cluster: TokenCluster) -> frozenset[int]:
        """The nodes that controllable joints move, directly or through fixed and controllable
        contacts.
        """
        near = cluster_neighbours(cluster)
        open_ = [node for node, kind in enumerate(cluster.nodes) if self.types[kind].driven]
        reached = set(open_)
        while open_:
            node = open_.pop()
            for edge, neighbour in near[node]:
                rigid = self.model.contact_classes[edge.kind].rigid
                if rigid and neighbour not in reached and self._driven_end(cluster, node, edge):
                    reached.add(neighbour)
                    open_.append(neighbour)
        return frozenset(node for node in reached if not self.types[cluster.nodes[node]].fixed)

    def _driven_end(self, cluster: TokenCluster, node: int, edge: ContactEdge) -> bool:
        """Whether a contact is at a part of the node that moves: in a robot, beyond its joints."""
        kind = self.types[cluster.nodes[node]]
        if not kind.driven:
            return True
        return (
            kind.slots[edge.key_slot if edge.key == node else edge.lock_slot].position
            in kind.driven
        )

    def mobile(self, cluster: TokenCluster) -> frozenset[int]:
        """The nodes of a connected cluster that a robot can carry anywhere; empty if something
        holds the cluster back.
        """
        if not all(self.types[kind].loose for kind in cluster.nodes):
            return frozenset()
        return self.chain(cluster)

    def moves(self, cluster: TokenCluster, mobile: frozenset[int], node: int, slot: int) -> bool:
        """Whether the anchor points of a slot are on what moves."""
        kind = self.types[cluster.nodes[node]]
        return node in mobile and (not kind.driven or kind.slots[slot].position in kind.driven)

    def changeable(self, parted: TokenCluster, edge: ContactEdge) -> bool:
        """Whether a contact can be made in a cluster, or side-by-side clusters, without it, or
        broken so that it is left.
        """
        kind = self.model.contact_classes[edge.kind]
        if any(self._between(parted, edge, kind) for kind in self.covers[edge.kind]):
            return False
        if kind.over:
            return self._between(parted, edge, kind.over) and bool(
                self.chain(parted) & {edge.key, edge.lock}
            )
        for nodes in cluster_components(parted):
            sides = {edge.key, edge.lock} & set(nodes)
            if len(sides) == 2:
                return False
            if sides and self._free_side(parted, nodes, edge):
                return True
        return False

    def _free_side(self, parted: TokenCluster, nodes: list[int], edge: ContactEdge) -> bool:
        kinds = (self.types[parted.nodes[node]] for node in nodes)
        if not all(kind.loose for kind in kinds):
            return False
        chain = self.chain(parted)
        ends = ((edge.key, edge.key_slot), (edge.lock, edge.lock_slot))
        return any(node in nodes and self.moves(parted, chain, node, slot) for node, slot in ends)

    @staticmethod
    def _between(cluster: TokenCluster, edge: ContactEdge, kind: str) -> bool:
        return any((e.kind, e.key, e.lock) == (kind, edge.key, edge.lock) for e in cluster.edges)

    def makes(self, edge: ContactEdge) -> bool:
        """Whether such a contact can be made at all."""
        return self.model.contact_classes[edge.kind].one_way is not OneWay.BREAKING

    def breaks(self, edge: ContactEdge) -> bool:
        """Whether such a contact can be broken at all."""
        return self.model.contact_classes[edge.kind].one_way is not OneWay.MAKING


MAX_FORMS = 20_000
Filters = Mapping[str, ContactFilter]


def generate_states(
    model: ContactModel, types: tuple[TokenType, ...], filters: Filters, most: int = MAX_FORMS
) -> FormSpace:
    """All forms that clusters of these tokens can take from the start on, and the steps between
    them.

    It stops when there are more than `most` forms; then the answer is not `complete`. Raises
    `InvalidInput` if a filter does not let the start pass.
    """
    run = _Generation(model, types, filters, ContactRules(model, types), most)
    start = [run.initial(cluster, names) for cluster, names in _initial_clusters(model, types)]
    complete = run.exhaust()
    return FormSpace(
        model,
        types,
        tuple(run.forms),
        tuple(sorted(run.steps)),
        tuple(sorted(start)),
        tuple(run.removed.values()),
        complete,
    )


def _initial_clusters(
    model: ContactModel, types: tuple[TokenType, ...]
) -> Iterator[tuple[TokenCluster, tuple[str, ...]]]:
    """The clusters at the start, with their objects.

    Contacts with objects that are no part of these tokens are left out.
    """
    at = {
        name: (node, kind, position)
        for node, (kind, member) in enumerate(
            (kind, member) for kind, token_type in enumerate(types) for member in token_type.members
        )
        for position, name in enumerate(member)
    }
    nodes = tuple(kind for kind, token_type in enumerate(types) for _ in token_type.members)
    rules = ContactRules(model, types)
    edges = []
    for contact in model.initial:
        if contact.first.instance in at and contact.second.instance in at:
            key, lock = (
                _end_at(types, at[p.instance], p.anchor) for p in (contact.first, contact.second)
            )
            kind = rules.kind(nodes[key[0]], key[1], nodes[lock[0]], lock[1])
            assert kind is not None, "the loader accepts only contacts of a contact class"
            edges.append(ContactEdge(*key, *lock, kind.name))
    whole = TokenCluster(nodes, tuple(edges))
    members = [member for token_type in types for member in token_type.members]
    for component in cluster_components(whole):
        yield (
            part_of_cluster(whole, component),
            tuple(name for node in component for name in members[node]),
        )


def _end_at(types: Sequence[TokenType], at: tuple[int, int, int], anchor: str) -> tuple[int, int]:
    node, kind, position = at
    slots = enumerate(types[kind].slots)
    return node, next(
        n for n, slot in slots if slot.position == position and anchor in slot.anchors
    )


@dataclass
class _Generation:
    """One generation: what was found, and which forms are still to be looked at."""

    model: ContactModel
    types: tuple[TokenType, ...]
    filters: Filters
    rules: ContactRules
    most: int
    forms: list[ClusterForm] = field(default_factory=list)
    steps: set[ContactStep] = field(default_factory=set)
    removed: dict[tuple[Key, str], Removed] = field(default_factory=dict)
    known: dict[Key, int] = field(default_factory=dict)
    refused: set[Key] = field(default_factory=set)
    mobile: list[int] = field(default_factory=list)

    def initial(self, cluster: TokenCluster, names: Sequence[str]) -> int:
        """The form of a cluster at the start."""
        form_number = self._form(cluster, None)
        if form_number is None:
            last = list(self.removed.values())[-1]
            message = f"the filter '{last.filter}' refuses the start: {last.reason}"
            hint = f"look at the contacts of: {', '.join(names)}"
            raise InvalidInput([Diagnostic(Source(self.model.path), "K712", message, hint)])
        return form_number

    def exhaust(self) -> bool:
        """Look at each form alone and with every form before it. Whether all were looked at."""
        done = 0
        while done < len(self.forms):
            if len(self.forms) > self.most:
                return False
            self._alone(done)
            carried = self.rules.mobile(self.forms[done].cluster)
            if carried:
                self.mobile.append(done)
            for second in range(done + 1) if carried else self.mobile:
                self._together(done, second)
            done += 1
        return True

    def _alone(self, number: int) -> None:
        form = self.forms[number]
        seen = set()
        for edge in form.cluster.edges:
            alike = (
                form.orbits[edge.key],
                edge.key_slot,
                form.orbits[edge.lock],
                edge.lock_slot,
                edge.kind,
            )
            if alike not in seen and self.rules.breaks(edge):
                seen.add(alike)
                self._break(number, edge)
        for edge in self._inside(form.cluster):
            if self.rules.changeable(form.cluster, edge):
                self._make((number,), form.cluster, edge)

    def _break(self, number: int, edge: ContactEdge) -> None:
        cluster = self.forms[number].cluster
        edges = list(cluster.edges)
        edges.remove(edge)
        opened = TokenCluster(cluster.nodes, tuple(edges))
        if not self.rules.changeable(opened, edge):
            return
        parts = cluster_components(opened)
        forms = [self._form(part_of_cluster(opened, nodes), None) for nodes in parts]
        if all(form_number is not None for form_number in forms):
            outputs = [
                (form_number, nodes)
                for form_number, nodes in zip(forms, parts, strict=True)
                if form_number is not None
            ]
            outputs.sort(key=lambda output: output[0])
            moved = tuple(
                (0, n, kind, count)
                for n, (_, nodes) in enumerate(outputs)
                for kind, count in sorted(counts_of(tuple(cluster.nodes[i] for i in nodes)).items())
            )
            self._step(
                (number,),
                tuple(form_number for form_number, _ in outputs),
                False,
                cluster,
                edge,
                moved,
            )

    def _inside(self, cluster: TokenCluster) -> Iterator[ContactEdge]:
        """The contacts that could be made inside a cluster: those that stand over one that is
        there.
        """
        open_ = free_slots(cluster, self.types)
        for under in cluster.edges:
            for name in self.rules.covers[under.kind]:
                for key_slot in open_[under.key]:
                    for lock_slot in open_[under.lock]:
                        kinds = cluster.nodes[under.key], cluster.nodes[under.lock]
                        kind = self.rules.kind(kinds[0], key_slot, kinds[1], lock_slot)
                        if kind is not None and kind.name == name:
                            yield ContactEdge(under.key, key_slot, under.lock, lock_slot, name)

    def _together(self, first: int, second: int) -> None:
        """Try every contact of two forms, one of which is mobile."""
        pair = join_clusters(self.forms[first].cluster, self.forms[second].cluster)
        if any(
            n > len(self.types[k].members) for k, n in counts_of(tuple(sorted(pair.nodes))).items()
        ):
            return
        shift = len(self.forms[first].cluster.nodes)
        sides = [self._ends(first, 0), self._ends(second, shift)]
        carried = [self.rules.mobile(self.forms[number].cluster) for number in (first, second)]
        for a, a_slot, a_node in sides[0]:
            for b, b_slot, b_node in sides[1]:
                edge = self._edge(pair, (a, a_slot), (b, b_slot))
                if edge is None:
                    continue
                clusters = (self.forms[first].cluster, self.forms[second].cluster)
                if self.rules.moves(clusters[0], carried[0], a_node, a_slot) or self.rules.moves(
                    clusters[1], carried[1], b_node, b_slot
                ):
                    self._make((first, second), pair, edge)

    def _ends(self, number: int, shift: int) -> list[tuple[int, int, int]]:
        """The free slots of a form, one for all that are alike: (node counted from `shift`,
        slot, node).
        """
        form = self.forms[number]
        seen, ends = set(), []
        for node, slots in enumerate(free_slots(form.cluster, self.types)):
            if form.orbits[node] not in seen:
                seen.add(form.orbits[node])
                ends += [(node + shift, slot, node) for slot in slots]
        return ends

    def _edge(
        self, pair: TokenCluster, a: tuple[int, int], b: tuple[int, int]
    ) -> ContactEdge | None:
        for key, lock in ((a, b), (b, a)):
            kind = self.rules.kind(pair.nodes[key[0]], key[1], pair.nodes[lock[0]], lock[1])
            if kind is not None and not kind.over:
                return ContactEdge(*key, *lock, kind.name)
        return None

    def _make(self, inputs: tuple[int, ...], parted: TokenCluster, edge: ContactEdge) -> None:
        if not self.rules.makes(edge):
            return
        joined_form = self._form(
            TokenCluster(parted.nodes, tuple(sorted((*parted.edges, edge)))), edge
        )
        if joined_form is None:
            return
        inputs = tuple(sorted(inputs))
        moved = tuple(
            (n, 0, kind, count)
            for n, form in enumerate(inputs)
            for kind, count in sorted(counts_of(self.forms[form].cluster.nodes).items())
        )
        self._step(inputs, (joined_form,), True, parted, edge, moved)

    def _step(
        self,
        inputs: tuple[int, ...],
        outputs: tuple[int, ...],
        makes: bool,
        cluster: TokenCluster,
        edge: ContactEdge,
        moved: tuple[tuple[int, int, int, int], ...],
    ) -> None:
        ends = (cluster.nodes[edge.key], edge.key_slot), (cluster.nodes[edge.lock], edge.lock_slot)
        self.steps.add(ContactStep(inputs, outputs, makes, edge.kind, ends, moved))

    def _form(self, cluster: TokenCluster, change: ContactEdge | None) -> int | None:
        """The number of a form, new or known; None if a filter removes it."""
        key, form = form_of_cluster(cluster, self.types)
        if key in self.known:
            return self.known[key]
        if key in self.refused or self._filtered(key, cluster, change):
            self.refused.add(key)
            return None
        self.known[key] = len(self.forms)
        self.forms.append(form)
        return self.known[key]

    def _filtered(self, key: Key, cluster: TokenCluster, change: ContactEdge | None) -> bool:
        named = NamedCluster(cluster, self.types)
        contacts = tuple(named.contacts.values())
        changed: Octuple | None = None
        if change is not None:
            changed = named.contacts[cluster.edges.index(change)]
        for name, state_filter in self.filters.items():
            reason = state_filter.reason(named.objects, contacts, changed)
            if reason:
                self.removed[key, name] = Removed(name, reason, contacts)
                return True
        return False
