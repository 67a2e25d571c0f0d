"""The marking of a running plan: each place binds the variables of its template to the objects and anchor points there."""

from collections.abc import Iterator, Mapping

from cellwright.engine.model.task_space import Cluster, Edge
from cellwright.engine.stages.states.clusters import Named
from cellwright.engine.stages.states.firing import Player, Situation
from cellwright.engine.stages.states.outlines import Outliner, counted, needed
from cellwright.engine.stages.states.places import normal
from cellwright.kb.model.octuples import Octuple, Quadruple, variable

Bindings = Mapping[str, str]
Points = dict[tuple[str, str], tuple[str, str]]


def bindings(player: Player, situation: Situation) -> tuple[tuple[str, Bindings], ...]:
    """For each cluster its place, and the names for the variables of its template, as in `O1` or `O2.A1`."""
    outliner = Outliner(player.space)
    found = []
    for tokens in dict.fromkeys(player.clusters(situation.contacts).values()):
        form = player.form(tokens, situation.contacts)
        place = player.place_of.get(form, "?") if form is not None else "?"
        found.append((place, dict(_bound(player, outliner, tokens, situation))))
    order = {place.name: n for n, place in enumerate(player.net.places)}
    return tuple(sorted(found, key=lambda each: (order.get(each[0], -1), sorted(each[1].items()))))


def _bound(
    player: Player, outliner: Outliner, tokens: tuple[tuple[int, int], ...], situation: Situation
) -> Iterator[tuple[str, str]]:
    at = {token: n for n, token in enumerate(tokens)}
    pairs = sorted(_edges(player, at, situation), key=lambda each: each[0])
    cluster = Cluster(tuple(kind for kind, _ in tokens), tuple(edge for edge, _ in pairs))
    named = Named(cluster, player.types)
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
    sample = [*(each for each, _ in needed(outline, player.space, uniform)), *counted(outline, player.space)]
    ordered = sorted(sample, key=lambda each: each.second.void)
    for template, shown in zip(normal(player.space, sample), ordered, strict=True):
        for name, point in _ends(template, shown):
            yield name.instance, objects[point.instance]
            if variable(name.anchor):
                found = anchors.get((point.instance, point.anchor))
                yield f"{name.instance}.{name.anchor}", found[1] if found else point.anchor


def _ends(template: Octuple, shown: Octuple) -> Iterator[tuple[Quadruple, Quadruple]]:
    for name, point in ((template.first, shown.first), (template.second, shown.second)):
        if not point.void:
            yield name, point


def _edges(
    player: Player, at: Mapping[tuple[int, int], int], situation: Situation
) -> Iterator[tuple[Edge, Octuple]]:
    for each in sorted(situation.contacts):
        (key, key_slot), (lock, lock_slot) = player.end(each.first), player.end(each.second)
        if key in at and lock in at:
            kind = player.rules.kind(key[0], key_slot, lock[0], lock_slot)
            yield Edge(at[key], key_slot, at[lock], lock_slot, kind.name if kind else ""), each
