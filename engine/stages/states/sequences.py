"""Sequences of operators by graph search on the net alone, without a planning domain."""

from collections.abc import Sequence
from dataclasses import dataclass

from cellwright.engine.stages.states.firing import Firing, Player, Situation
from cellwright.kb.model.contacts import describes
from cellwright.kb.model.octuples import Octuple, matches

MOST_SITUATIONS = 20_000


@dataclass(frozen=True, slots=True)
class Found:
    """What is to be done in turn; None if nothing leads there. `exhausted`: everything that can be reached was looked at."""

    firings: tuple[Firing, ...] | None
    exhausted: bool


def sequence(player: Player, goals: Sequence[Octuple], most: int = MOST_SITUATIONS) -> Found:
    """The shortest sequence after which every goal holds; a goal is a contact, or a free anchor point.

    The search gives up after `most` situations.
    """
    start = player.start
    came: dict[Situation, tuple[Situation, Firing] | None] = {start: None}
    open_ = [start]
    for situation in open_:
        if all(holds(player, situation, each) for each in goals):
            return Found(tuple(_back(came, situation)), False)
        if len(came) > most:
            return Found(None, False)
        for firing in player.firings(situation):
            following = player.after(situation, firing)
            if following not in came:
                came[following] = situation, firing
                open_.append(following)
    return Found(None, True)


def holds(player: Player, situation: Situation, goal: Octuple) -> bool:
    """Whether a contact, or a template of contacts, holds; or whether an anchor point is free."""
    model = player.space.model
    if goal.second.void:
        kinds = {name: model.kinds(name) for name in model.objects}
        return not any(
            matches(goal.first, point, kinds[point.instance]) is not None
            for each in situation.contacts
            for point in (each.first, each.second)
        )
    return any(next(describes(model, goal, each), None) is not None for each in situation.contacts)


def _back(came: dict[Situation, tuple[Situation, Firing] | None], at: Situation) -> list[Firing]:
    found = []
    while (before := came[at]) is not None:
        at, firing = before
        found.append(firing)
    return found[::-1]
