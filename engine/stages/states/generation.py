"""Generates the forms of clusters, and the steps between them, until no new ones are found (Matthiesen, section 4).

It works on clusters, not on whole states: a step depends only on the clusters that it changes. So the forms are few.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from cellwright.engine.model.task_space import Cluster, Edge, Form, Removed, Space, Step, TokenType
from cellwright.engine.ports import ContactFilter
from cellwright.engine.stages.states.canonical import Key
from cellwright.engine.stages.states.clusters import Named, components, counts_of, form_of, free, joined, part
from cellwright.engine.stages.states.rules import Rules
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.contacts import ContactModel
from cellwright.kb.model.octuples import Octuple

MOST_FORMS = 20_000
Filters = Mapping[str, ContactFilter]


def generate(
    model: ContactModel, types: tuple[TokenType, ...], filters: Filters, most: int = MOST_FORMS
) -> Space:
    """All forms that clusters of these tokens can take from the start on, and the steps between them.

    It stops when there are more than `most` forms; then the answer is not `complete`. Raises `InvalidInput` if a filter
    does not let the start pass.
    """
    run = _Run(model, types, filters, Rules(model, types), most)
    start = [run.initial(cluster, names) for cluster, names in _initial(model, types)]
    complete = run.exhaust()
    return Space(
        model,
        types,
        tuple(run.forms),
        tuple(sorted(run.steps)),
        tuple(sorted(start)),
        tuple(run.removed.values()),
        complete,
    )


def _initial(model: ContactModel, types: tuple[TokenType, ...]) -> Iterator[tuple[Cluster, tuple[str, ...]]]:
    """The clusters at the start, with their objects. Contacts with objects that are no part of these tokens are left out."""
    at = {
        name: (node, kind, position)
        for node, (kind, member) in enumerate(
            (kind, member) for kind, each in enumerate(types) for member in each.members
        )
        for position, name in enumerate(member)
    }
    nodes = tuple(kind for kind, each in enumerate(types) for _ in each.members)
    rules = Rules(model, types)
    edges = []
    for contact in model.initial:
        if contact.first.instance in at and contact.second.instance in at:
            key, lock = (_end(types, at[p.instance], p.anchor) for p in (contact.first, contact.second))
            kind = rules.kind(nodes[key[0]], key[1], nodes[lock[0]], lock[1])
            assert kind is not None, "the loader accepts only contacts of a contact class"
            edges.append(Edge(*key, *lock, kind.name))
    whole = Cluster(nodes, tuple(edges))
    members = [member for each in types for member in each.members]
    for each in components(whole):
        yield part(whole, each), tuple(name for node in each for name in members[node])


def _end(types: Sequence[TokenType], at: tuple[int, int, int], anchor: str) -> tuple[int, int]:
    node, kind, position = at
    slots = enumerate(types[kind].slots)
    return node, next(n for n, slot in slots if slot.position == position and anchor in slot.anchors)


@dataclass
class _Run:
    """One generation: what was found, and which forms are still to be looked at."""

    model: ContactModel
    types: tuple[TokenType, ...]
    filters: Filters
    rules: Rules
    most: int
    forms: list[Form] = field(default_factory=list)
    steps: set[Step] = field(default_factory=set)
    removed: dict[tuple[Key, str], Removed] = field(default_factory=dict)
    known: dict[Key, int] = field(default_factory=dict)
    refused: set[Key] = field(default_factory=set)
    mobile: list[int] = field(default_factory=list)

    def initial(self, cluster: Cluster, names: Sequence[str]) -> int:
        """The form of a cluster at the start."""
        found = self._form(cluster, None)
        if found is None:
            last = list(self.removed.values())[-1]
            message = f"the filter '{last.filter}' refuses the start: {last.reason}"
            hint = f"look at the contacts of: {', '.join(names)}"
            raise InvalidInput([Diagnostic(Source(self.model.path), "K712", message, hint)])
        return found

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
            for other in range(done + 1) if carried else self.mobile:
                self._together(done, other)
            done += 1
        return True

    def _alone(self, number: int) -> None:
        form = self.forms[number]
        seen = set()
        for edge in form.cluster.edges:
            alike = (form.orbits[edge.key], edge.key_slot, form.orbits[edge.lock], edge.lock_slot, edge.kind)
            if alike not in seen and self.rules.breaks(edge):
                seen.add(alike)
                self._break(number, edge)
        for edge in self._inside(form.cluster):
            if self.rules.changeable(form.cluster, edge):
                self._make((number,), form.cluster, edge)

    def _break(self, number: int, edge: Edge) -> None:
        cluster = self.forms[number].cluster
        edges = list(cluster.edges)
        edges.remove(edge)
        left = Cluster(cluster.nodes, tuple(edges))
        if not self.rules.changeable(left, edge):
            return
        parts = components(left)
        found = [self._form(part(left, nodes), None) for nodes in parts]
        if all(each is not None for each in found):
            outputs = [(each, nodes) for each, nodes in zip(found, parts, strict=True) if each is not None]
            outputs.sort(key=lambda each: each[0])
            moved = tuple(
                (0, n, kind, count)
                for n, (_, nodes) in enumerate(outputs)
                for kind, count in sorted(counts_of(tuple(cluster.nodes[i] for i in nodes)).items())
            )
            self._step((number,), tuple(each for each, _ in outputs), False, cluster, edge, moved)

    def _inside(self, cluster: Cluster) -> Iterator[Edge]:
        """The contacts that could be made inside a cluster: those that stand over one that is there."""
        open_ = free(cluster, self.types)
        for under in cluster.edges:
            for name in self.rules.covers[under.kind]:
                for key_slot in open_[under.key]:
                    for lock_slot in open_[under.lock]:
                        kinds = cluster.nodes[under.key], cluster.nodes[under.lock]
                        kind = self.rules.kind(kinds[0], key_slot, kinds[1], lock_slot)
                        if kind is not None and kind.name == name:
                            yield Edge(under.key, key_slot, under.lock, lock_slot, name)

    def _together(self, first: int, second: int) -> None:
        """Try every contact of two forms, one of which is mobile."""
        pair = joined(self.forms[first].cluster, self.forms[second].cluster)
        if any(n > len(self.types[k].members) for k, n in counts_of(tuple(sorted(pair.nodes))).items()):
            return
        shift = len(self.forms[first].cluster.nodes)
        sides = [self._ends(first, 0), self._ends(second, shift)]
        carried = [self.rules.mobile(self.forms[each].cluster) for each in (first, second)]
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
        """The free slots of a form, one for all that are alike: (node counted from `shift`, slot, node)."""
        form = self.forms[number]
        seen, found = set(), []
        for node, slots in enumerate(free(form.cluster, self.types)):
            if form.orbits[node] not in seen:
                seen.add(form.orbits[node])
                found += [(node + shift, slot, node) for slot in slots]
        return found

    def _edge(self, pair: Cluster, a: tuple[int, int], b: tuple[int, int]) -> Edge | None:
        for key, lock in ((a, b), (b, a)):
            kind = self.rules.kind(pair.nodes[key[0]], key[1], pair.nodes[lock[0]], lock[1])
            if kind is not None and not kind.over:
                return Edge(*key, *lock, kind.name)
        return None

    def _make(self, inputs: tuple[int, ...], parted: Cluster, edge: Edge) -> None:
        if not self.rules.makes(edge):
            return
        made = self._form(Cluster(parted.nodes, tuple(sorted((*parted.edges, edge)))), edge)
        if made is None:
            return
        inputs = tuple(sorted(inputs))
        moved = tuple(
            (n, 0, kind, count)
            for n, form in enumerate(inputs)
            for kind, count in sorted(counts_of(self.forms[form].cluster.nodes).items())
        )
        self._step(inputs, (made,), True, parted, edge, moved)

    def _step(
        self,
        inputs: tuple[int, ...],
        outputs: tuple[int, ...],
        makes: bool,
        cluster: Cluster,
        edge: Edge,
        moved: tuple[tuple[int, int, int, int], ...],
    ) -> None:
        ends = (cluster.nodes[edge.key], edge.key_slot), (cluster.nodes[edge.lock], edge.lock_slot)
        self.steps.add(Step(inputs, outputs, makes, edge.kind, ends, moved))

    def _form(self, cluster: Cluster, change: Edge | None) -> int | None:
        """The number of a form, new or known; None if a filter removes it."""
        key, form = form_of(cluster, self.types)
        if key in self.known:
            return self.known[key]
        if key in self.refused or self._filtered(key, cluster, change):
            self.refused.add(key)
            return None
        self.known[key] = len(self.forms)
        self.forms.append(form)
        return self.known[key]

    def _filtered(self, key: Key, cluster: Cluster, change: Edge | None) -> bool:
        named = Named(cluster, self.types)
        contacts = tuple(named.contacts.values())
        changed: Octuple | None = None
        if change is not None:
            changed = named.contacts[cluster.edges.index(change)]
        for name, each in self.filters.items():
            reason = each.reason(named.objects, contacts, changed)
            if reason:
                self.removed[key, name] = Removed(name, reason, contacts)
                return True
        return False
