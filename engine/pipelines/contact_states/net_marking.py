"""The marking of a net during a run: which contacts hold, as the planning facts tell."""

import re
from collections.abc import Collection, Iterator, Mapping
from functools import lru_cache

from cellwright.engine.pipelines.contact_states import contact_model_of, net_space
from cellwright.engine.pipelines.contact_states.net_operators import atom_with_terms
from cellwright.engine.stages.states.contact_net import net_of
from cellwright.engine.stages.states.net_player import NetPlayer, NetSituation
from cellwright.kb.model.contact_model import (
    ContactModel,
    Octuple,
    class_of,
    is_variable_name,
    named_in,
    template_bindings,
)

MAX_KEPT_PLAYERS = 4  # that are kept
# for each place, the objects of each cluster in it
Marking = Mapping[str, tuple[tuple[str, ...], ...]]


@lru_cache(MAX_KEPT_PLAYERS)
def player_of(target: str) -> NetPlayer:
    """The net of the cell that a target names, in play.

    Raises `InvalidInput` if it has no contact model.
    """
    model, _ = contact_model_of(target)
    space = net_space(model)
    return NetPlayer(space, net_of(space))


def marking_of_facts(player: NetPlayer, facts: Collection[str]) -> Marking:
    """Who is in which place when these facts hold; the place `?` has what no place is known for."""
    model = player.space.model
    contacts_held = frozenset(
        contact for contact in _possible_contacts(player) if _contact_holds(model, contact, facts)
    )
    return player.marking(
        NetSituation(
            frozenset(
                contact for contact in contacts_held if _is_supported(model, contact, contacts_held)
            )
        )
    )


def _possible_contacts(player: NetPlayer) -> Iterator[Octuple]:
    """All contacts of two objects that some contact class describes, each with its key first."""
    model = player.space.model
    names = sorted(player.token)
    points = [model.point(name, anchor) for name in names for anchor in _anchors_of(model, name)]
    for key in points:
        for lock in points:
            contact = Octuple(key, lock)
            if key.instance != lock.instance and class_of(
                contact, model.contact_classes, model.classes
            ):
                yield contact


def _anchors_of(model: ContactModel, name: str) -> Collection[str]:
    return model.classes[model.objects[name]].anchors


def _contact_holds(model: ContactModel, contact: Octuple, facts: Collection[str]) -> bool:
    """Whether facts say that a contact holds: all that it stands for, or for a grip, that one
    object is at the other.
    """
    meant = False
    for meaning in model.meanings:
        for bound in template_bindings(model, meaning.contact, contact):
            meant = True
            if meaning.made and all(
                atom_with_terms(atom, dict(bound)) in facts for atom in meaning.made
            ):
                return True
    kind = class_of(contact, model.contact_classes, model.classes)
    return (
        not meant and kind is not None and kind.controllable and _is_gripped(model, contact, facts)
    )


def _is_gripped(model: ContactModel, contact: Octuple, facts: Collection[str]) -> bool:
    """Whether a fact that holds when an object is taken from somewhere says that it is at the
    robot of this contact.
    """
    robot, taken = contact.first.instance, contact.second.instance
    for meaning in model.meanings:
        variables = [
            point.instance
            for point in named_in(meaning.contact)
            if is_variable_name(point.instance)
        ]
        for broken_fact in (
            atom_with_terms(broken, {name: taken})
            for name in variables
            for broken in meaning.broken
        ):
            if broken_fact in facts and {robot, taken} <= {*re.findall(r"\w+", broken_fact)}:
                return True
    return False


def _is_supported(
    model: ContactModel, contact: Octuple, contacts_held: Collection[Octuple]
) -> bool:
    """Whether what a contact stands over holds, too."""
    kind = class_of(contact, model.contact_classes, model.classes)
    if kind is None or not kind.over:
        return True
    pair = contact.first.instance, contact.second.instance
    return any(
        (contact_held.first.instance, contact_held.second.instance) == pair
        and (under := class_of(contact_held, model.contact_classes, model.classes)) is not None
        and under.name == kind.over
        for contact_held in contacts_held
    )
