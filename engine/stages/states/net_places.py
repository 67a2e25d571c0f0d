"""Places of the net: clusters with the same outline, with template, description and capacity.

By default these contacts matter: in a cluster with a robot, those of the robot, of the object in
its hand, and of everything that moves along; in other clusters all. Where an object has several
anchor points of a class, nobody counts which of them are taken: their number is a capacity.
`relevance` in the contact model says what is different in a cell.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.model.task_space import (
    AnchorSlot,
    ContactEdge,
    FormSpace,
    NetPlace,
    TokenCluster,
)
from cellwright.engine.stages.states.clusters import (
    NamedCluster,
    cluster_neighbours,
    counts_of,
    free_slots,
)
from cellwright.engine.stages.states.global_states import Graph
from cellwright.engine.stages.states.state_generation import ContactRules
from cellwright.kb.model.contact_model import (
    Octuple,
    Quadruple,
    number_objects,
    template_bindings,
    void_of,
)

Mark = tuple[object, ...]
Near = Sequence[Sequence[tuple[ContactEdge, int]]]
Positions = Sequence[frozenset[int]]  # for each node


@dataclass(frozen=True, slots=True)
class ClusterOutline:
    """`order` lists the nodes that matter, from the root. `core` is what distinguishes the place.

    `margin` says of the other single anchor points of these nodes what is there. `counted` are the
    contacts that only count, and `hanging` the nodes beyond them.
    """

    cluster: TokenCluster
    order: tuple[int, ...]
    core: tuple[Mark, ...]
    edges: tuple[ContactEdge, ...]
    margin: dict[tuple[int, int], Mark]
    counted: tuple[ContactEdge, ...]
    hanging: frozenset[int]

    @property
    def key(self) -> Mark:
        """Equal for clusters of one place."""
        return (
            tuple(self.cluster.nodes[node] for node in self.order),
            tuple(sorted(self.core, key=str)),
        )


class Outliner:
    """Makes the outlines of the clusters of a space."""

    def __init__(self, space: FormSpace, full: bool = False) -> None:
        self.space, self.types, self.full = space, space.types, full
        self.rules = ContactRules(space.model, space.types)

    def outline(self, cluster: TokenCluster) -> ClusterOutline:
        """The outline of a connected cluster."""
        near = cluster_neighbours(cluster)
        whole = [self._seen(cluster, node, near) for node in range(len(cluster.nodes))]
        named = NamedCluster(cluster, self.types) if self.space.model.relevance else None
        order, core, edges = self._roots(cluster), list[Mark](), dict[ContactEdge, None]()
        for node in order:
            for slot, at, neighbours_there in self._slots(cluster, node, near):
                if at.position in whole[node] and self._matters(
                    cluster, named, (node, slot), at, neighbours_there
                ):
                    core += [] if neighbours_there else [(order.index(node), slot, "void")]
                    order += [
                        neighbour for _, neighbour in neighbours_there if neighbour not in order
                    ]
                    edges |= dict.fromkeys(edge for edge, _ in neighbours_there)
        core += [self._mark(edge, order) for edge in edges]
        margin = dict(self._margin(cluster, order, edges, whole, near))
        counted, hanging = self._beside(cluster, order, edges, near)
        return ClusterOutline(
            cluster, tuple(order), tuple(core), tuple(edges), margin, counted, hanging
        )

    def _slots(
        self, cluster: TokenCluster, node: int, near: Near
    ) -> Iterator[tuple[int, AnchorSlot, list[tuple[ContactEdge, int]]]]:
        """The slots of a node, each with its contacts."""
        for slot, at in enumerate(self.types[cluster.nodes[node]].slots):
            yield (
                slot,
                at,
                [
                    (edge, neighbour)
                    for edge, neighbour in near[node]
                    if (node, slot) in _edge_ends(edge)
                ],
            )

    def _matters(
        self,
        cluster: TokenCluster,
        named: NamedCluster | None,
        end: tuple[int, int],
        at: AnchorSlot,
        neighbours_there: Sequence[tuple[ContactEdge, int]],
    ) -> bool:
        """Whether the contacts of a slot are distinguished: as the model says, else where there
        is one anchor point.
        """
        if self.full:
            return True
        verdict = (
            self._verdict(cluster, named, *end, neighbours_there) if named is not None else None
        )
        return not at.several if verdict is None else verdict

    def _margin(
        self,
        cluster: TokenCluster,
        order: Sequence[int],
        edges: Collection[ContactEdge],
        whole: Positions,
        near: Near,
    ) -> Iterator[tuple[tuple[int, int], Mark]]:
        """What is at the other single anchor points of the nodes that matter."""
        for number, node in enumerate(order):
            for slot, at, neighbours_there in self._slots(cluster, node, near):
                matters = at.position in whole[node] or any(
                    edge in edges for edge, _ in neighbours_there
                )
                if not matters and not at.several:
                    yield (
                        (number, slot),
                        tuple(
                            (cluster.nodes[neighbour], edge.kind)
                            for edge, neighbour in neighbours_there
                        ),
                    )

    def _beside(
        self,
        cluster: TokenCluster,
        order: Sequence[int],
        edges: Collection[ContactEdge],
        near: Near,
    ) -> tuple[tuple[ContactEdge, ...], frozenset[int]]:
        """The contacts at anchor points of which there are several, what hangs on them, and so
        on.
        """
        beside, hanging = dict[ContactEdge, None](), dict[int, None]()
        for node in order:
            for _, at, neighbours_there in self._slots(cluster, node, near):
                if at.several:
                    beside |= dict.fromkeys(
                        edge for edge, _ in neighbours_there if edge not in edges
                    )
                    hanging |= dict.fromkeys(
                        neighbour for _, neighbour in neighbours_there if neighbour not in order
                    )
        open_ = list(hanging)
        for node in open_:
            beyond = [(edge, neighbour) for edge, neighbour in near[node] if neighbour not in order]
            beside |= dict.fromkeys(edge for edge, _ in beyond)
            open_ += [neighbour for _, neighbour in beyond if neighbour not in hanging]
            hanging |= dict.fromkeys(neighbour for _, neighbour in beyond)
        return tuple(beside), frozenset(hanging)

    def _mark(self, edge: ContactEdge, order: list[int]) -> Mark:
        return (
            order.index(edge.key),
            edge.key_slot,
            order.index(edge.lock),
            edge.lock_slot,
            edge.kind,
        )

    def _roots(self, cluster: TokenCluster) -> list[int]:
        """The robots; without any, the one node that stands firmest."""

        def rank(node: int) -> tuple[bool, bool, int, int]:
            kind = self.types[cluster.nodes[node]]
            return not kind.fixed, not kind.passive, cluster.nodes[node], node

        ranked = sorted(range(len(cluster.nodes)), key=rank)
        return [node for node in ranked if self.types[cluster.nodes[node]].driven] or ranked[:1]

    def _seen(
        self, cluster: TokenCluster, node: int, near: Sequence[Sequence[tuple[ContactEdge, int]]]
    ) -> frozenset[int]:
        """The positions of a node's objects whose contacts matter."""
        kind = self.types[cluster.nodes[node]]
        every = frozenset(range(len(kind.classes)))
        if self.full or kind.loose or not any(self.types[node].driven for node in cluster.nodes):
            return every
        holders = (
            kind.slots[edge.lock_slot if edge.lock == node else edge.key_slot].position
            for edge, neighbour in near[node]
            if self.types[cluster.nodes[neighbour]].driven
        )
        return frozenset(holders)

    def _verdict(
        self,
        cluster: TokenCluster,
        named: NamedCluster,
        node: int,
        slot: int,
        neighbours_there: Sequence[tuple[ContactEdge, int]],
    ) -> bool | None:
        """What `relevance` says of a slot: whether its contacts matter; None if it says
        nothing. The last entry decides.
        """
        shown = [named.contacts[cluster.edges.index(e)] for e, _ in neighbours_there]
        shown = shown or self._possible(named.point(node, slot), cluster.nodes[node], slot)
        verdict = None
        for rule in self.space.model.relevance:
            hit = bool(shown) and all(self._about(rule.contact, contact) for contact in shown)
            if hit and (rule.during is None or self._holds(rule.during, named)):
                verdict = rule.matters
        return verdict

    def _possible(self, point: Quadruple, kind: int, slot: int) -> list[Octuple]:
        """The contacts that could be at a free anchor point: one for each slot that matches."""
        possible = []
        for token_number, token in enumerate(self.types):
            for n, at in enumerate(token.slots):
                ends = (
                    (kind, slot, token_number, n)
                    if self.types[kind].slots[slot].key
                    else (token_number, n, kind, slot)
                )
                if self.rules.kind(*ends) is not None:
                    name = token.members[0][at.position]
                    partner = Quadruple(
                        token.classes[at.position], name, at.anchor_class, at.anchors[0]
                    )
                    possible.append(Octuple(point, partner))
        return possible

    def _about(self, template: Octuple, contact: Octuple) -> bool:
        return next(template_bindings(self.space.model, template, contact), None) is not None

    def _holds(self, template: Octuple, named: NamedCluster) -> bool:
        return any(self._about(template, contact) for contact in named.contacts.values())


def _edge_ends(edge: ContactEdge) -> tuple[tuple[int, int], tuple[int, int]]:
    return (edge.key, edge.key_slot), (edge.lock, edge.lock_slot)


def partner_classes(space: FormSpace) -> dict[str, str]:
    """For each anchor class, the class that matches it: what a free anchor point waits for."""
    partners_entry = {"*": "*"}
    for contact_class in space.model.contact_classes.values():
        partners_entry.setdefault(contact_class.key.anchor_class, contact_class.lock.anchor_class)
        partners_entry.setdefault(contact_class.lock.anchor_class, contact_class.key.anchor_class)
    for kind in space.types:
        for slot in kind.slots:
            partners_entry.setdefault(slot.anchor_class, "*")
    return partners_entry


Shown = tuple[Octuple, ContactEdge | None]


def needed_contacts(
    outline: ClusterOutline, space: FormSpace, uniform: frozenset[tuple[int, int]]
) -> Iterator[Shown]:
    """The contacts, with their edges, and the free anchor points that matter; of the margin
    only what is `uniform`.
    """
    named = NamedCluster(outline.cluster, space.types)
    edges = dict.fromkeys((*outline.edges, *_margin_edges(outline, uniform)))
    yield from ((named.contacts[outline.cluster.edges.index(edge)], edge) for edge in edges)
    core = {(number, slot) for number, slot, *rest in outline.core if rest == ["void"]}
    for void, node, slot in _free_points(outline, space, named):
        number = outline.order.index(node) if node in outline.order else -1
        if (number, slot) in core | uniform:
            yield void, None


def counted_contacts(outline: ClusterOutline, space: FormSpace) -> Iterator[Octuple]:
    """The contacts that only count, and the free anchor points of what hangs on them."""
    named = NamedCluster(outline.cluster, space.types)
    places = [n for n, edge in enumerate(outline.cluster.edges) if edge in outline.counted]
    yield from (named.contacts[n] for n in places)
    for void, node, slot in _free_points(outline, space, named):
        if (
            node in outline.hanging
            and not space.types[outline.cluster.nodes[node]].slots[slot].several
        ):
            yield void


def _free_points(
    outline: ClusterOutline, space: FormSpace, named: NamedCluster
) -> Iterator[tuple[Octuple, int, int]]:
    """The free anchor points of a cluster, each with its node and slot."""
    partner = partner_classes(space)
    for node, slots in enumerate(free_slots(outline.cluster, space.types)):
        for slot, count in slots.items():
            at = space.types[outline.cluster.nodes[node]].slots[slot]
            for number in range(len(at.anchors) - count, len(at.anchors)):
                yield (
                    Octuple(named.point(node, slot, number), void_of(partner[at.anchor_class])),
                    node,
                    slot,
                )


def _margin_edges(
    outline: ClusterOutline, uniform: frozenset[tuple[int, int]]
) -> Iterator[ContactEdge]:
    for number, slot in sorted(uniform):
        node = outline.order[number]
        yield from (
            edge
            for edge in outline.cluster.edges
            if (node, slot) in _edge_ends(edge) and edge not in outline.edges
        )


@dataclass(frozen=True)
class SortedForms:
    """The forms sorted into places: `place_of` gives the number of a form's place, `outlines`
    the outline of each form.
    """

    places: tuple[NetPlace, ...]
    place_of: Mapping[int, int]
    outlines: Mapping[int, ClusterOutline]
    uniform: tuple[frozenset[tuple[int, int]], ...]


def sort_places(space: FormSpace, graph: Graph | None, full: bool = False) -> SortedForms:
    """All places with a form that can be reached.

    They are numbered in the order in which they are reached.
    """
    outliner = Outliner(space, full)
    order = list(_reached_forms(space, graph))
    outlines = {form: outliner.outline(space.forms[form].cluster) for form in order}
    groups: dict[Mark, list[int]] = {}
    for form in order:
        groups.setdefault(outlines[form].key, []).append(form)
    most = _place_capacities(space, graph, groups, order)
    start = Counter(space.initial)
    built_places: list[NetPlace] = []
    place_of: dict[int, int] = {}
    uniform = []
    for number, (key, forms) in enumerate(groups.items()):
        same = _uniform_points([outlines[form] for form in forms])
        largest = outlines[max(forms, key=lambda form: len(space.forms[form].cluster.nodes))]
        first = [contact for contact, _ in needed_contacts(largest, space, same)]
        contacts = normal_form(space, [*first, *counted_contacts(largest, space)], full)
        capacity = tuple((space.types[kind].name, n) for kind, n in sorted(most[key].items()) if n)
        robot = any(space.types[kind].driven for kind in largest.cluster.nodes)
        initial = sum(start[form] for form in forms)
        form_counts = Counter[int]()
        for form in forms:
            for kind, n in counts_of(space.forms[form].cluster.nodes).items():
                form_counts[kind] += n * start[form]
        tokens = tuple((space.types[kind].name, n) for kind, n in sorted(form_counts.items()) if n)
        description = describe_place(space, largest)
        built_places.append(
            NetPlace(
                f"P{number + 1}",
                description,
                contacts,
                capacity,
                robot,
                tuple(forms),
                initial,
                tokens,
            )
        )
        uniform.append(same)
        place_of |= {form: number for form in forms}
    return SortedForms(tuple(built_places), place_of, outlines, tuple(uniform))


def _reached_forms(space: FormSpace, graph: Graph | None) -> Iterator[int]:
    """The forms in the order in which they appear: at the start those without contacts first."""
    first = sorted(
        set(space.initial), key=lambda form: (len(space.forms[form].cluster.edges) > 0, form)
    )
    seen = dict.fromkeys(first)
    if graph is None:
        seen |= dict.fromkeys(range(len(space.forms)))
    else:
        for following in graph.values():
            for step, _ in following:
                seen |= dict.fromkeys(step.outputs)
    yield from seen


def _place_capacities(
    space: FormSpace, graph: Graph | None, groups: Mapping[Mark, list[int]], order: Sequence[int]
) -> dict[Mark, Counter[int]]:
    """The most tokens of each type that are in a place at the same time."""
    key_of = {form: key for key, forms in groups.items() for form in forms}
    most = {key: Counter[int]() for key in groups}
    markings = graph if graph is not None else [(form,) for form in order]
    for marking in markings:
        largest_counts: dict[Mark, Counter[int]] = {}
        for form in marking:
            largest_counts.setdefault(key_of[form], Counter()).update(
                counts_of(space.forms[form].cluster.nodes)
            )
        for key, count in largest_counts.items():
            most[key] |= count
    return most


def _uniform_points(outlines: Sequence[ClusterOutline]) -> frozenset[tuple[int, int]]:
    """The anchor points beside the core at which the same holds in all clusters of a place."""
    first, *further = outlines
    return frozenset(
        at
        for at, mark in first.margin.items()
        if all(outline.margin.get(at) == mark for outline in further)
    )


def normal_form(
    space: FormSpace, contacts: Sequence[Octuple], full: bool = False
) -> tuple[Octuple, ...]:
    """Contacts in the normal form, contacts before free anchor points.

    Objects are variables and, where there are several, so are anchor points; with `full`,
    everything has its name.
    """
    ordered = sorted(contacts, key=lambda octuple: octuple.second.void)
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

    return number_objects(
        [Octuple(renamed(octuple.first), renamed(octuple.second)) for octuple in ordered]
    )


def describe_place(space: FormSpace, outline: ClusterOutline) -> str:
    """A place in words: what the robot holds, and where that is; or what is with a device."""
    cluster, types = outline.cluster, space.types
    root = outline.order[0]
    name = types[cluster.nodes[root]].name
    if not outline.edges:
        inside = _contents_in_words(space, outline)
        return f"{name} with {inside}" if inside else f"{name} free"
    if not types[cluster.nodes[root]].driven:
        inside = _contents_in_words(space, outline)
        parts = _partners_in_words(space, cluster, root, outline.edges)
        return f"{name} with {', '.join([*parts, *([inside] if inside else [])])}"
    words = []
    for edge in outline.edges:
        if root in (edge.key, edge.lock):
            object_node, slot = (
                (edge.lock, edge.lock_slot) if edge.key == root else (edge.key, edge.key_slot)
            )
            remaining_edges = [e for e in outline.edges if e is not edge]
            on = _partners_in_words(space, cluster, object_node, remaining_edges)
            words.append(
                types[cluster.nodes[object_node]].slot_name(slot)
                + (f" in {', '.join(on)}" if on else "")
            )
    return f"{name} holds {' and '.join(words)}"


def _partners_in_words(
    space: FormSpace, cluster: TokenCluster, node: int, edges: Sequence[ContactEdge]
) -> list[str]:
    """The objects that a node is in contact with, with the contact classes."""
    partners: dict[tuple[int, str], list[str]] = {}
    for edge in edges:
        if node in (edge.key, edge.lock):
            partner, slot = (
                (edge.lock, edge.lock_slot) if edge.key == node else (edge.key, edge.key_slot)
            )
            name = space.types[cluster.nodes[partner]].slot_name(slot)
            partners.setdefault((partner, name), []).append(edge.kind)
    return [f"{name} ({', '.join(kinds)})" for (_, name), kinds in partners.items()]


def _contents_in_words(space: FormSpace, outline: ClusterOutline) -> str:
    """What the several anchor points hold."""
    kinds = Counter(space.types[outline.cluster.nodes[node]].name for node in outline.hanging)
    return ", ".join(f"{kind} (up to {n})" if n > 1 else kind for kind, n in sorted(kinds.items()))
