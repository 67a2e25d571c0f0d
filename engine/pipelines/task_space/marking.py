"""The marking of a cell's net while a run goes on: which contacts hold, as the facts of the planning domain tell."""

import re
from collections.abc import Collection, Iterator, Mapping
from functools import lru_cache

from cellwright.engine.pipelines.task_space import model_of, space_of
from cellwright.engine.pipelines.task_space.operators import written
from cellwright.engine.stages.states.firing import Player, Situation
from cellwright.engine.stages.states.nets import net_of
from cellwright.kb.model.contacts import ContactModel, class_of, describes
from cellwright.kb.model.octuples import Octuple, named_in, variable

PLAYERS = 4  # that are kept
Marking = Mapping[str, tuple[tuple[str, ...], ...]]  # for each place, the objects of each cluster in it


@lru_cache(PLAYERS)
def player_of(target: str) -> Player:
    """The net of the cell that a target names, in play. Raises `InvalidInput` if it has no contact model."""
    model, _ = model_of(target)
    space = space_of(model)
    return Player(space, net_of(space))


def marking(player: Player, facts: Collection[str]) -> Marking:
    """Who is in which place when these facts hold; the place `?` has what no place is known for."""
    model = player.space.model
    held = frozenset(each for each in _possible(player) if _holds(model, each, facts))
    return player.marking(Situation(frozenset(each for each in held if _supported(model, each, held))))


def _possible(player: Player) -> Iterator[Octuple]:
    """All contacts of two objects that some contact class describes, each with its key first."""
    model = player.space.model
    names = sorted(player.token)
    points = [model.point(name, anchor) for name in names for anchor in _anchors(model, name)]
    for key in points:
        for lock in points:
            found = Octuple(key, lock)
            if key.instance != lock.instance and class_of(found, model.contact_classes, model.classes):
                yield found


def _anchors(model: ContactModel, name: str) -> Collection[str]:
    return model.classes[model.objects[name]].anchors


def _holds(model: ContactModel, contact: Octuple, facts: Collection[str]) -> bool:
    """Whether facts say that a contact holds: all that it stands for, or for a grip, that one object is at the other."""
    meant = False
    for meaning in model.meanings:
        for bound in describes(model, meaning.contact, contact):
            meant = True
            if meaning.made and all(written(each, dict(bound)) in facts for each in meaning.made):
                return True
    kind = class_of(contact, model.contact_classes, model.classes)
    return not meant and kind is not None and kind.controllable and _gripped(model, contact, facts)


def _gripped(model: ContactModel, contact: Octuple, facts: Collection[str]) -> bool:
    """Whether a fact that holds when an object is taken from somewhere says that it is at the robot of this contact."""
    robot, taken = contact.first.instance, contact.second.instance
    for meaning in model.meanings:
        variables = [each.instance for each in named_in(meaning.contact) if variable(each.instance)]
        for said in (written(each, {name: taken}) for name in variables for each in meaning.broken):
            if said in facts and {robot, taken} <= {*re.findall(r"\w+", said)}:
                return True
    return False


def _supported(model: ContactModel, contact: Octuple, held: Collection[Octuple]) -> bool:
    """Whether what a contact stands over holds, too."""
    kind = class_of(contact, model.contact_classes, model.classes)
    if kind is None or not kind.over:
        return True
    pair = contact.first.instance, contact.second.instance
    return any(
        (each.first.instance, each.second.instance) == pair
        and (under := class_of(each, model.contact_classes, model.classes)) is not None
        and under.name == kind.over
        for each in held
    )
