"""Plays the net: markings, transitions that can fire, shortest sequences, and bindings of places.

A situation is a set of contacts with all names, and the settings of the joints. A transition fires
for one contact: the clusters that it changes leave their places whole, and what becomes of them
goes to the places after (Matthiesen, section 4).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import networkx as nx

from cellwright.engine.model.task_space import (
    ContactEdge,
    ContactNet,
    ContactStep,
    FormSpace,
    TokenCluster,
    Transition,
)
from cellwright.engine.stages.states.clusters import NamedCluster, form_of_cluster
from cellwright.engine.stages.states.net_places import (
    Outliner,
    counted_contacts,
    needed_contacts,
    normal_form,
)
from cellwright.engine.stages.states.state_generation import ContactRules
from cellwright.engine.stages.states.token_types import handled_objects_of_joints
from cellwright.kb.model.contact_model import (
    ConditionKind,
    Octuple,
    Quadruple,
    is_variable_name,
    match_quadruple,
    template_bindings,
)


@dataclass(frozen=True, slots=True)
class NetSituation:
    """The contacts that hold, each with its key first, and the setting of each joint."""

    contacts: frozenset[Octuple]
    settings: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Firing:
    """A transition that can fire for a contact, or a joint that can be moved to a setting."""

    name: str
    contact: Octuple | None = None
    joint: str = ""
    setting: str = ""

    def __str__(self) -> str:
        return f"{self.name}: {self.contact}" if self.contact else self.name


class NetPlayer:
    """Plays the net of a space."""

    def __init__(self, space: FormSpace, net: ContactNet) -> None:
        self.space, self.net, self.types = space, net, space.types
        self.rules = ContactRules(space.model, space.types)
        self.token = {
            name: (kind, number, position)
            for kind, token_type in enumerate(space.types)
            for number, member in enumerate(token_type.members)
            for position, name in enumerate(member)
        }
        self.place_of = {form: place.name for place in net.places for form in place.forms}

    @cached_property
    def start(self) -> NetSituation:
        """The situation at the start."""
        known_contacts = (
            contact
            for contact in self.space.model.initial
            if {contact.first.instance, contact.second.instance} <= self.token.keys()
        )
        joints = self.space.model.permanent.values()
        return NetSituation(
            frozenset(known_contacts), tuple((j.name, j.starts) for j in joints if j.settings)
        )

    @cached_property
    def _known(self) -> dict[object, int]:
        return {
            form_of_cluster(form.cluster, self.types)[0]: n
            for n, form in enumerate(self.space.forms)
        }

    @cached_property
    def _transitions(self) -> dict[tuple[object, ...], Transition]:
        return {
            _step_key(step): transition
            for transition in self.net.transitions
            for step in transition.steps
        }

    def end(self, point: Quadruple) -> tuple[tuple[int, int], int]:
        """The token (type, number) of an anchor point, and its slot."""
        kind, number, position = self.token[point.instance]
        slots = enumerate(self.types[kind].slots)
        slot = next(
            n
            for n, numbered in slots
            if numbered.position == position and point.anchor in numbered.anchors
        )
        return (kind, number), slot

    def clusters(
        self, contacts: frozenset[Octuple]
    ) -> dict[tuple[int, int], tuple[tuple[int, int], ...]]:
        """The cluster of each token, as all its tokens."""
        graph: nx.Graph[tuple[int, int]] = nx.Graph()
        graph.add_nodes_from(
            (k, n)
            for k, token_type in enumerate(self.types)
            for n in range(len(token_type.members))
        )
        graph.add_edges_from((self.end(c.first)[0], self.end(c.second)[0]) for c in contacts)
        clusters: dict[tuple[int, int], tuple[tuple[int, int], ...]] = {}
        for part in nx.connected_components(graph):
            members = tuple(sorted(part))
            clusters |= dict.fromkeys(members, members)
        return clusters

    def form(self, tokens: Sequence[tuple[int, int]], contacts: frozenset[Octuple]) -> int | None:
        """The form of a cluster; None if it was not generated."""
        at = {token: n for n, token in enumerate(tokens)}
        edges = []
        for contact in sorted(contacts):
            (key, key_slot), (lock, lock_slot) = self.end(contact.first), self.end(contact.second)
            if key in at and lock in at:
                kind = self.rules.kind(key[0], key_slot, lock[0], lock_slot)
                edges.append(
                    ContactEdge(at[key], key_slot, at[lock], lock_slot, kind.name if kind else "")
                )
        cluster = TokenCluster(tuple(kind for kind, _ in tokens), tuple(sorted(edges)))
        return self._known.get(form_of_cluster(cluster, self.types)[0])

    def marking(self, situation: NetSituation) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Who is in which place: for each place, the objects of each cluster in it, the robot
        first.
        """
        marking: dict[str, list[tuple[str, ...]]] = {}
        for tokens in dict.fromkeys(self.clusters(situation.contacts).values()):
            form = self.form(tokens, situation.contacts)
            name = self.place_of[form] if form is not None else "?"
            objects = tuple(member for kind, n in tokens for member in self.types[kind].members[n])
            marking.setdefault(name, []).append(objects)
        order = [place.name for place in self.net.places]
        return {name: tuple(marking[name]) for name in order if name in marking}

    def firings(self, situation: NetSituation) -> Iterator[Firing]:
        """Everything that can be done in a situation: transitions in the order of their
        contacts, then joints.
        """
        clusters = self.clusters(situation.contacts)
        for contact in sorted(situation.contacts):
            yield from self._firing(situation, clusters, contact, False)
        taken = {
            point for contact in situation.contacts for point in (contact.first, contact.second)
        }
        free = [point for point in self._points if point not in taken]
        for key in free:
            for lock in free:
                (a, a_slot), (b, b_slot) = self.end(key), self.end(lock)
                if a != b and self.rules.kind(a[0], a_slot, b[0], b_slot) is not None:
                    yield from self._firing(situation, clusters, Octuple(key, lock), True)
        yield from self._joints(situation)

    @cached_property
    def _points(self) -> list[Quadruple]:
        model = self.space.model
        return [
            model.point(member[slot.position], anchor)
            for token_type in self.types
            for member in token_type.members
            for slot in token_type.slots
            for anchor in slot.anchors
        ]

    def _firing(
        self,
        situation: NetSituation,
        clusters: Mapping[tuple[int, int], tuple[tuple[int, int], ...]],
        contact: Octuple,
        makes: bool,
    ) -> Iterator[Firing]:
        (key, key_slot), (lock, lock_slot) = self.end(contact.first), self.end(contact.second)
        tokens = tuple(sorted({*clusters[key], *clusters[lock]}))
        after = situation.contacts ^ {contact}
        changed = self.clusters(after)
        sides = [
            sorted(
                form if form is not None else -1
                for part in {cluster[token] for token in tokens}
                for form in [self.form(part, contacts)]
            )
            for cluster, contacts in ((clusters, situation.contacts), (changed, after))
        ]
        kind = self.rules.kind(key[0], key_slot, lock[0], lock_slot)
        assert kind is not None, "only contacts of a contact class are asked about"
        ends = (key[0], key_slot), (lock[0], lock_slot)
        transition = self._transitions.get(
            (tuple(sides[0]), tuple(sides[1]), makes, kind.name, ends)
        )
        if transition is not None and self._allowed(situation, transition):
            yield Firing(transition.name, contact)

    def _allowed(self, situation: NetSituation, transition: Transition) -> bool:
        """Whether the joints are where the transition needs them.

        Sensors and clocks are looked at when a plan runs.
        """
        settings = dict(situation.settings)
        return all(
            settings.get(restriction.subject, restriction.value) == restriction.value
            for restriction in transition.restrictions
            if restriction.kind is ConditionKind.JOINT
        )

    def _joints(self, situation: NetSituation) -> Iterator[Firing]:
        driven = {
            name
            for kind in self.types
            for m in kind.members
            for n, name in enumerate(m)
            if n in kind.driven
        }
        contact_pairs = [
            {contact.first.instance, contact.second.instance} for contact in situation.contacts
        ]
        for joint, handles in handled_objects_of_joints(self.space.model).items():
            able = not handles or any(
                pair & driven and pair & set(handles) for pair in contact_pairs
            )
            for setting in self.space.model.permanent[joint].settings if able else ():
                if (joint, setting) not in situation.settings:
                    yield Firing(f"{joint} to {setting}", None, joint, setting)

    def fire(self, situation: NetSituation, firing: Firing) -> NetSituation:
        """The situation after. Raises `ValueError` for what cannot be done."""
        if firing not in self.firings(situation):
            raise ValueError(f"{firing} cannot fire here")
        return self.after(situation, firing)

    @staticmethod
    def after(situation: NetSituation, firing: Firing) -> NetSituation:
        """The situation after what is known to be possible."""
        if firing.contact is not None:
            return replace(situation, contacts=situation.contacts ^ {firing.contact})
        settings = tuple(
            (name, firing.setting if name == firing.joint else value)
            for name, value in situation.settings
        )
        return replace(situation, settings=settings)


def _step_key(step: ContactStep) -> tuple[object, ...]:
    return (step.inputs, step.outputs, step.makes, step.kind, step.ends)


MAX_SITUATIONS = 20_000


@dataclass(frozen=True, slots=True)
class OperatorSequence:
    """What is to be done in turn; None if nothing leads there. `exhausted`: everything that can
    be reached was looked at.
    """

    firings: tuple[Firing, ...] | None
    exhausted: bool


def find_sequence(
    player: NetPlayer, goals: Sequence[Octuple], most: int = MAX_SITUATIONS
) -> OperatorSequence:
    """The shortest sequence after which every goal holds; a goal is a contact, or a free anchor
    point.

    The search gives up after `most` situations.
    """
    start = player.start
    came: dict[NetSituation, tuple[NetSituation, Firing] | None] = {start: None}
    open_ = [start]
    for situation in open_:
        if all(holds_in(player, situation, goal) for goal in goals):
            return OperatorSequence(tuple(_trace_back(came, situation)), False)
        if len(came) > most:
            return OperatorSequence(None, False)
        for firing in player.firings(situation):
            following = player.after(situation, firing)
            if following not in came:
                came[following] = situation, firing
                open_.append(following)
    return OperatorSequence(None, True)


def holds_in(player: NetPlayer, situation: NetSituation, goal: Octuple) -> bool:
    """Whether a contact, or a template of contacts, holds; or whether an anchor point is free."""
    model = player.space.model
    if goal.second.void:
        kinds = {name: model.kinds(name) for name in model.objects}
        return not any(
            match_quadruple(goal.first, point, kinds[point.instance]) is not None
            for contact in situation.contacts
            for point in (contact.first, contact.second)
        )
    return any(
        next(template_bindings(model, goal, contact), None) is not None
        for contact in situation.contacts
    )


def _trace_back(
    came: dict[NetSituation, tuple[NetSituation, Firing] | None], at: NetSituation
) -> list[Firing]:
    firings = []
    while (before := came[at]) is not None:
        at, firing = before
        firings.append(firing)
    return firings[::-1]


Bindings = Mapping[str, str]
Points = dict[tuple[str, str], tuple[str, str]]


def place_bindings(player: NetPlayer, situation: NetSituation) -> tuple[tuple[str, Bindings], ...]:
    """For each cluster its place, and the names for the variables of its template, as in `O1`
    or `O2.A1`.
    """
    outliner = Outliner(player.space)
    bound_clusters = []
    for tokens in dict.fromkeys(player.clusters(situation.contacts).values()):
        form = player.form(tokens, situation.contacts)
        place = player.place_of.get(form, "?") if form is not None else "?"
        bound_clusters.append((place, dict(_bind_template(player, outliner, tokens, situation))))
    order = {place.name: n for n, place in enumerate(player.net.places)}
    return tuple(
        sorted(
            bound_clusters,
            key=lambda bound_cluster: (
                order.get(bound_cluster[0], -1),
                sorted(bound_cluster[1].items()),
            ),
        )
    )


def _bind_template(
    player: NetPlayer,
    outliner: Outliner,
    tokens: tuple[tuple[int, int], ...],
    situation: NetSituation,
) -> Iterator[tuple[str, str]]:
    at = {token: n for n, token in enumerate(tokens)}
    pairs = sorted(_contact_edges(player, at, situation), key=lambda edge_contact: edge_contact[0])
    cluster = TokenCluster(tuple(kind for kind, _ in tokens), tuple(edge for edge, _ in pairs))
    named = NamedCluster(cluster, player.types)
    objects = {
        sample: name
        for member, (kind, number) in zip(named.members, tokens, strict=True)
        for sample, name in zip(member, player.types[kind].members[number], strict=True)
    }
    anchors: Points = {}
    for n, (_, contact) in enumerate(pairs):
        for sample_point, point in (
            (named.contacts[n].first, contact.first),
            (named.contacts[n].second, contact.second),
        ):
            anchors[sample_point.instance, sample_point.anchor] = (point.instance, point.anchor)
    outline = outliner.outline(cluster)
    uniform = frozenset(outline.margin)
    sample = [
        *(octuple for octuple, _ in needed_contacts(outline, player.space, uniform)),
        *counted_contacts(outline, player.space),
    ]
    ordered = sorted(sample, key=lambda octuple: octuple.second.void)
    for template, shown in zip(normal_form(player.space, sample), ordered, strict=True):
        for name, point in _template_ends(template, shown):
            yield name.instance, objects[point.instance]
            if is_variable_name(name.anchor):
                anchor_point = anchors.get((point.instance, point.anchor))
                yield (
                    f"{name.instance}.{name.anchor}",
                    anchor_point[1] if anchor_point else point.anchor,
                )


def _template_ends(template: Octuple, shown: Octuple) -> Iterator[tuple[Quadruple, Quadruple]]:
    for name, point in ((template.first, shown.first), (template.second, shown.second)):
        if not point.void:
            yield name, point


def _contact_edges(
    player: NetPlayer, at: Mapping[tuple[int, int], int], situation: NetSituation
) -> Iterator[tuple[ContactEdge, Octuple]]:
    for contact in sorted(situation.contacts):
        (key, key_slot), (lock, lock_slot) = player.end(contact.first), player.end(contact.second)
        if key in at and lock in at:
            kind = player.rules.kind(key[0], key_slot, lock[0], lock_slot)
            yield (
                ContactEdge(at[key], key_slot, at[lock], lock_slot, kind.name if kind else ""),
                contact,
            )
