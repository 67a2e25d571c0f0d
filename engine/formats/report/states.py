"""Nets of contact states for people and programs: tables, and data for JSON."""

from collections.abc import Iterable
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.rows import TextTable
from cellwright.engine.model.task_space import (
    Brought,
    Growth,
    Net,
    Place,
    Region,
    Removed,
    Transfer,
    Transition,
)

SHOWN = 60


def text(net: Net) -> RenderableType:
    """The tables of places, transitions, joints, filters and regions, and a summary."""
    parts: list[RenderableType] = [_places(net.places), _transitions(net.transitions)]
    if net.joints:
        rows = [(name, ", ".join(places) or "in none") for name, places in net.joints.items()]
        parts.append(TextTable(("joint", "can be moved in"), rows))
    if net.removed:
        why = [(filter_, reason, str(n)) for filter_, reason, n in removals(net.removed)]
        parts.append(TextTable(("filter", "removed", "clusters"), why, right=("clusters",)))
    if len(net.regions) > 1:
        parts.append(_regions(net.regions))
    return Group(*(part for each in parts for part in (each, Text(""))), Text(summary(net)))


def template(net: Net) -> str:
    """Each place with its contacts in the normal form."""
    blocks = (
        "\n".join([f"{place.name} {place.say}", *(f"  {each}" for each in place.contacts)])
        for place in net.places
    )
    return "\n\n".join(blocks) + "\n"


def summary(net: Net) -> str:
    """One line: how many places, transitions and states there are."""
    robots = sum(place.robot for place in net.places)
    whole = "" if net.complete else "; the search was stopped, so some may be missing and others unreachable"
    return (
        f"{len(net.places)} places ({robots} with a robot, {len(net.places) - robots} without), "
        f"{len(net.transitions)} transitions, {counted(net.growth)}{whole}"
    )


def counted(growth: Growth) -> str:
    """The number of fully specified global states in words."""
    return f"{'' if growth.exact else 'at most '}{growth.states:,} fully specified contact states"


def removals(removed: Iterable[Removed]) -> list[tuple[str, str, int]]:
    """Filters and reasons, each with the number of clusters that it removed."""
    counts: dict[tuple[str, str], int] = {}
    for each in removed:
        counts[each.filter, each.reason] = counts.get((each.filter, each.reason), 0) + 1
    return [(*key, n) for key, n in sorted(counts.items())]


def _places(places: tuple[Place, ...]) -> RenderableType:
    rows = [
        (place.name, place.say, ", ".join(f"{name} {n}" for name, n in place.capacity))
        for place in places[:SHOWN]
    ]
    if len(places) > SHOWN:
        rows.append(("...", f"and {len(places) - SHOWN} more (--format json has all)", ""))
    return TextTable(("place", "contact state", "capacity"), rows)


def _transitions(transitions: tuple[Transition, ...]) -> RenderableType:
    rows = []
    for each in transitions[:SHOWN]:
        way = f"{' + '.join(each.inputs)} -> {' + '.join(each.outputs)}"
        rows.append((each.name, way, ", ".join(map(str, each.restrictions))))
    if len(transitions) > SHOWN:
        rows.append(("...", f"and {len(transitions) - SHOWN} more (--format json has all)", ""))
    return TextTable(("transition", "leads", "only if"), rows)


def _regions(regions: tuple[Region, ...]) -> RenderableType:
    rows = []
    for n, each in enumerate(regions[:SHOWN], 1):
        kind = "dead end" if each.dead else "final" if not each.exits else f"{each.exits} one-way exits"
        rows.append((str(n), f"{each.states:,}", kind, "; ".join(each.fused)))
    if len(regions) > SHOWN:
        rows.append(("...", "", f"and {len(regions) - SHOWN} more (--format json has all)", ""))
    return TextTable(("region", "states", "", "one-way contacts"), rows, right=("states",))


def brings(part: Brought) -> str:
    """What a part brings to a net, and what filters remove because of it, in a few lines."""
    lines = [
        f"{part.part} brings {part.places} places, {part.transitions} transitions and {part.states:,} contact states"
    ]
    lines += [f"  {filter_} removes: {reason}" for filter_, reason in part.removed]
    return "\n".join(lines)


def brings_entry(part: Brought) -> dict[str, Any]:
    """What a part brings, for JSON."""
    return {
        "part": part.part,
        "places": part.places,
        "transitions": part.transitions,
        "states": part.states,
        "removed": [{"filter": filter_, "reason": reason} for filter_, reason in part.removed],
    }


def content(net: Net) -> dict[str, Any]:
    """The net, for JSON."""
    return {
        "net": net.name,
        "complete": net.complete,
        "states": net.growth.states,
        "exact": net.growth.exact,
        "colours": {name: list(tokens) for name, tokens in net.colours.items()},
        "places": [_place(each) for each in net.places],
        "transitions": [_transition(each) for each in net.transitions],
        "joints": {name: list(places) for name, places in net.joints.items()},
        "removed": [
            {"filter": each.filter, "reason": each.reason, "contacts": list(map(str, each.contacts))}
            for each in net.removed
        ],
        "regions": [
            {"states": each.states, "one_way": list(each.fused), "exits": each.exits, "dead": each.dead}
            for each in net.regions
        ],
    }


def _place(place: Place) -> dict[str, Any]:
    return {
        "name": place.name,
        "say": place.say,
        "robot": place.robot,
        "contacts": list(map(str, place.contacts)),
        "capacity": dict(place.capacity),
        "initial": place.initial,
    }


def _transition(each: Transition) -> dict[str, Any]:
    return {
        "name": each.name,
        "operator": each.operator,
        "makes": each.makes,
        "contact": str(each.contact),
        "inputs": list(each.inputs),
        "outputs": list(each.outputs),
        "transfers": [_transfer(row) for row in each.transfers],
        "only_if": list(map(str, each.restrictions)),
        "reversible": each.reversible,
    }


def _transfer(row: Transfer) -> dict[str, Any]:
    return {"from": row.source, "to": row.target, "type": row.type, "least": row.least, "most": row.most}
