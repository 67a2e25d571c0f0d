"""Nets of contact states as tables, and as data for JSON."""

from collections.abc import Iterable
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.text_tables import TextTable
from cellwright.engine.model.task_space import (
    ContactNet,
    NetPlace,
    ObjectShare,
    Removed,
    StateGrowth,
    StateRegion,
    Transfer,
    Transition,
)

MAX_NET_ROWS = 60


def net_text(net: ContactNet) -> RenderableType:
    """The tables of places, transitions, joints, filters and regions, and a summary."""
    parts: list[RenderableType] = [_place_table(net.places), _transition_table(net.transitions)]
    if net.joints:
        rows = [(name, ", ".join(places) or "in none") for name, places in net.joints.items()]
        parts.append(TextTable(("joint", "can be moved in"), rows))
    if net.removed:
        why = [(filter_, reason, str(n)) for filter_, reason, n in removal_counts(net.removed)]
        parts.append(TextTable(("filter", "removed", "clusters"), why, right=("clusters",)))
    if len(net.regions) > 1:
        parts.append(_region_table(net.regions))
    return Group(
        *(part for table_part in parts for part in (table_part, Text(""))), Text(net_summary(net))
    )


def place_templates(net: ContactNet) -> str:
    """Each place with its contacts in the normal form."""
    blocks = (
        "\n".join([f"{place.name} {place.say}", *(f"  {contact}" for contact in place.contacts)])
        for place in net.places
    )
    return "\n\n".join(blocks) + "\n"


def net_summary(net: ContactNet) -> str:
    """One line: how many places, transitions and states there are."""
    robots = sum(place.robot for place in net.places)
    whole = (
        ""
        if net.complete
        else "; the search was stopped, so some may be missing and others unreachable"
    )
    return (
        f"{len(net.places)} places ({robots} with a robot, {len(net.places) - robots} without), "
        f"{len(net.transitions)} transitions, {state_count_text(net.growth)}{whole}"
    )


def state_count_text(growth: StateGrowth) -> str:
    """The number of fully specified global states in words."""
    return f"{'' if growth.exact else 'at most '}{growth.states:,} fully specified contact states"


def removal_counts(removed: Iterable[Removed]) -> list[tuple[str, str, int]]:
    """Filters and reasons, each with the number of clusters that it removed."""
    counts: dict[tuple[str, str], int] = {}
    for removal in removed:
        counts[removal.filter, removal.reason] = counts.get((removal.filter, removal.reason), 0) + 1
    return [(*key, n) for key, n in sorted(counts.items())]


def _place_table(places: tuple[NetPlace, ...]) -> RenderableType:
    rows = [
        (place.name, place.say, ", ".join(f"{name} {n}" for name, n in place.capacity))
        for place in places[:MAX_NET_ROWS]
    ]
    if len(places) > MAX_NET_ROWS:
        rows.append(("...", f"and {len(places) - MAX_NET_ROWS} more (--format json has all)", ""))
    return TextTable(("place", "contact state", "capacity"), rows)


def _transition_table(transitions: tuple[Transition, ...]) -> RenderableType:
    rows = []
    for transition in transitions[:MAX_NET_ROWS]:
        arc_text = f"{' + '.join(transition.inputs)} -> {' + '.join(transition.outputs)}"
        rows.append((transition.name, arc_text, ", ".join(map(str, transition.restrictions))))
    if len(transitions) > MAX_NET_ROWS:
        rows.append(
            ("...", f"and {len(transitions) - MAX_NET_ROWS} more (--format json has all)", "")
        )
    return TextTable(("transition", "leads", "only if"), rows)


def _region_table(regions: tuple[StateRegion, ...]) -> RenderableType:
    rows = []
    for n, region in enumerate(regions[:MAX_NET_ROWS], 1):
        kind = (
            "dead end"
            if region.dead
            else "final"
            if not region.exits
            else f"{region.exits} one-way exits"
        )
        rows.append((str(n), f"{region.states:,}", kind, "; ".join(region.fused)))
    if len(regions) > MAX_NET_ROWS:
        rows.append(
            ("...", "", f"and {len(regions) - MAX_NET_ROWS} more (--format json has all)", "")
        )
    return TextTable(("region", "states", "", "one-way contacts"), rows, right=("states",))


def brought_text(part: ObjectShare) -> str:
    """What a part brings to a net, and what filters remove because of it, in a few lines."""
    lines = [
        f"{part.part} brings {part.places} places, {part.transitions} transitions and "
        f"{part.states:,} contact states"
    ]
    lines += [f"  {filter_} removes: {reason}" for filter_, reason in part.removed]
    return "\n".join(lines)


def brings_entry(part: ObjectShare) -> dict[str, Any]:
    """What a part brings, for JSON."""
    return {
        "part": part.part,
        "places": part.places,
        "transitions": part.transitions,
        "states": part.states,
        "removed": [{"filter": filter_, "reason": reason} for filter_, reason in part.removed],
    }


def net_content(net: ContactNet) -> dict[str, Any]:
    """The net, for JSON."""
    return {
        "net": net.name,
        "complete": net.complete,
        "states": net.growth.states,
        "exact": net.growth.exact,
        "colours": {name: list(tokens) for name, tokens in net.colours.items()},
        "places": [_place_entry(place) for place in net.places],
        "transitions": [_transition_entry(transition) for transition in net.transitions],
        "joints": {name: list(places) for name, places in net.joints.items()},
        "removed": [
            {
                "filter": removal.filter,
                "reason": removal.reason,
                "contacts": list(map(str, removal.contacts)),
            }
            for removal in net.removed
        ],
        "regions": [
            {
                "states": region.states,
                "one_way": list(region.fused),
                "exits": region.exits,
                "dead": region.dead,
            }
            for region in net.regions
        ],
    }


def _place_entry(place: NetPlace) -> dict[str, Any]:
    return {
        "name": place.name,
        "say": place.say,
        "robot": place.robot,
        "contacts": list(map(str, place.contacts)),
        "capacity": dict(place.capacity),
        "initial": place.initial,
    }


def _transition_entry(transition: Transition) -> dict[str, Any]:
    return {
        "name": transition.name,
        "operator": transition.operator,
        "makes": transition.makes,
        "contact": str(transition.contact),
        "inputs": list(transition.inputs),
        "outputs": list(transition.outputs),
        "transfers": [_transfer_entry(row) for row in transition.transfers],
        "only_if": list(map(str, transition.restrictions)),
        "reversible": transition.reversible,
    }


def _transfer_entry(row: Transfer) -> dict[str, Any]:
    return {
        "from": row.source,
        "to": row.target,
        "type": row.type,
        "least": row.least,
        "most": row.most,
    }
