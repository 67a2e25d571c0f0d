"""The net in play: which individuals are in which place, which transitions can fire, and what follows.

A situation is a set of contacts with all names, and the settings of the joints. A transition fires for one contact: the
clusters that it changes leave their places whole, and what becomes of them goes to the places after (Matthiesen, section 4).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import networkx as nx

from cellwright.engine.model.task_space import Cluster, Edge, Net, Space, Step, Transition
from cellwright.engine.stages.states.clusters import form_of
from cellwright.engine.stages.states.rules import Rules
from cellwright.engine.stages.states.tokens import moved_by_hand
from cellwright.kb.model.contacts import ConditionKind
from cellwright.kb.model.octuples import Octuple, Quadruple


@dataclass(frozen=True, slots=True)
class Situation:
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


class Player:
    """Plays the net of a space."""

    def __init__(self, space: Space, net: Net) -> None:
        self.space, self.net, self.types = space, net, space.types
        self.rules = Rules(space.model, space.types)
        self.token = {
            name: (kind, number, position)
            for kind, each in enumerate(space.types)
            for number, member in enumerate(each.members)
            for position, name in enumerate(member)
        }
        self.place_of = {form: place.name for place in net.places for form in place.forms}

    @cached_property
    def start(self) -> Situation:
        """The situation at the start."""
        known = (
            each
            for each in self.space.model.initial
            if {each.first.instance, each.second.instance} <= self.token.keys()
        )
        joints = self.space.model.permanent.values()
        return Situation(frozenset(known), tuple((j.name, j.starts) for j in joints if j.settings))

    @cached_property
    def _known(self) -> dict[object, int]:
        return {form_of(form.cluster, self.types)[0]: n for n, form in enumerate(self.space.forms)}

    @cached_property
    def _transitions(self) -> dict[tuple[object, ...], Transition]:
        return {_key(step): each for each in self.net.transitions for step in each.steps}

    def end(self, point: Quadruple) -> tuple[tuple[int, int], int]:
        """The token (type, number) of an anchor point, and its slot."""
        kind, number, position = self.token[point.instance]
        slots = enumerate(self.types[kind].slots)
        slot = next(n for n, each in slots if each.position == position and point.anchor in each.anchors)
        return (kind, number), slot

    def clusters(self, contacts: frozenset[Octuple]) -> dict[tuple[int, int], tuple[tuple[int, int], ...]]:
        """The cluster of each token, as all its tokens."""
        graph: nx.Graph[tuple[int, int]] = nx.Graph()
        graph.add_nodes_from((k, n) for k, each in enumerate(self.types) for n in range(len(each.members)))
        graph.add_edges_from((self.end(c.first)[0], self.end(c.second)[0]) for c in contacts)
        found: dict[tuple[int, int], tuple[tuple[int, int], ...]] = {}
        for part in nx.connected_components(graph):
            members = tuple(sorted(part))
            found |= dict.fromkeys(members, members)
        return found

    def form(self, tokens: Sequence[tuple[int, int]], contacts: frozenset[Octuple]) -> int | None:
        """The form of a cluster; None if it was not generated."""
        at = {token: n for n, token in enumerate(tokens)}
        edges = []
        for each in sorted(contacts):
            (key, key_slot), (lock, lock_slot) = self.end(each.first), self.end(each.second)
            if key in at and lock in at:
                kind = self.rules.kind(key[0], key_slot, lock[0], lock_slot)
                edges.append(Edge(at[key], key_slot, at[lock], lock_slot, kind.name if kind else ""))
        cluster = Cluster(tuple(kind for kind, _ in tokens), tuple(sorted(edges)))
        return self._known.get(form_of(cluster, self.types)[0])

    def marking(self, situation: Situation) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Who is in which place: for each place, the objects of each cluster in it, the robot first."""
        found: dict[str, list[tuple[str, ...]]] = {}
        for tokens in dict.fromkeys(self.clusters(situation.contacts).values()):
            form = self.form(tokens, situation.contacts)
            name = self.place_of[form] if form is not None else "?"
            objects = tuple(each for kind, n in tokens for each in self.types[kind].members[n])
            found.setdefault(name, []).append(objects)
        order = [place.name for place in self.net.places]
        return {name: tuple(found[name]) for name in order if name in found}

    def firings(self, situation: Situation) -> Iterator[Firing]:
        """Everything that can be done in a situation: transitions in the order of their contacts, then joints."""
        clusters = self.clusters(situation.contacts)
        for contact in sorted(situation.contacts):
            yield from self._firing(situation, clusters, contact, False)
        taken = {point for each in situation.contacts for point in (each.first, each.second)}
        free = [each for each in self._points if each not in taken]
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
            for each in self.types
            for member in each.members
            for slot in each.slots
            for anchor in slot.anchors
        ]

    def _firing(
        self,
        situation: Situation,
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
                for part in {each[token] for token in tokens}
                for form in [self.form(part, held)]
            )
            for each, held in ((clusters, situation.contacts), (changed, after))
        ]
        kind = self.rules.kind(key[0], key_slot, lock[0], lock_slot)
        assert kind is not None, "only contacts of a contact class are asked about"
        ends = (key[0], key_slot), (lock[0], lock_slot)
        found = self._transitions.get((tuple(sides[0]), tuple(sides[1]), makes, kind.name, ends))
        if found is not None and self._allowed(situation, found):
            yield Firing(found.name, contact)

    def _allowed(self, situation: Situation, transition: Transition) -> bool:
        """Whether the joints are where the transition needs them. Sensors and clocks are looked at when a plan runs."""
        settings = dict(situation.settings)
        return all(
            settings.get(each.subject, each.value) == each.value
            for each in transition.restrictions
            if each.kind is ConditionKind.JOINT
        )

    def _joints(self, situation: Situation) -> Iterator[Firing]:
        driven = {
            name for kind in self.types for m in kind.members for n, name in enumerate(m) if n in kind.driven
        }
        held = [{each.first.instance, each.second.instance} for each in situation.contacts]
        for joint, handles in moved_by_hand(self.space.model).items():
            able = not handles or any(pair & driven and pair & set(handles) for pair in held)
            for setting in self.space.model.permanent[joint].settings if able else ():
                if (joint, setting) not in situation.settings:
                    yield Firing(f"{joint} to {setting}", None, joint, setting)

    def fire(self, situation: Situation, firing: Firing) -> Situation:
        """The situation after. Raises `ValueError` for what cannot be done."""
        if firing not in self.firings(situation):
            raise ValueError(f"{firing} cannot fire here")
        return self.after(situation, firing)

    @staticmethod
    def after(situation: Situation, firing: Firing) -> Situation:
        """The situation after what is known to be possible."""
        if firing.contact is not None:
            return replace(situation, contacts=situation.contacts ^ {firing.contact})
        settings = tuple(
            (name, firing.setting if name == firing.joint else value) for name, value in situation.settings
        )
        return replace(situation, settings=settings)


def _key(step: Step) -> tuple[object, ...]:
    return (step.inputs, step.outputs, step.makes, step.kind, step.ends)
