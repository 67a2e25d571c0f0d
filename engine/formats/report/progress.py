"""A sequence in progress, for people and programs: the next visit, and the changes against the kept sequence."""

from collections import Counter
from collections.abc import Mapping
from typing import Any, Protocol

from rich.console import Group, RenderableType
from rich.text import Text

from engine.formats.report import tour as tours
from engine.model.tour import Tour, TourProblem
from kb.store.sequences import PlannedVisit, SequencePlan

WAYS = {
    "made": "a new sequence",
    "kept": "the kept sequence is unchanged",
    "resequenced": "the rest was sequenced anew",
}


class Progress(Protocol):
    """A sequence plan, how it was made, and how it differs from the one before."""

    @property
    def plan(self) -> SequencePlan: ...
    @property
    def way(self) -> str: ...
    @property
    def problem(self) -> TourProblem: ...
    @property
    def tour(self) -> Tour: ...
    @property
    def kept(self) -> tuple[str, ...]: ...
    @property
    def reordered(self) -> tuple[str, ...]: ...
    @property
    def moved(self) -> Mapping[str, tuple[str, str]]: ...
    @property
    def added(self) -> tuple[str, ...]: ...
    @property
    def dropped(self) -> Mapping[str, str]: ...
    @property
    def outdated(self) -> tuple[str, ...]: ...
    @property
    def unkept(self) -> str: ...
    @property
    def next(self) -> PlannedVisit | None: ...


def entry(found: Progress) -> dict[str, Any]:
    """A sequence, for JSON. Its costs are those of the rest, from the last visit that is done."""
    plan, tour = found.plan, found.tour
    return {
        **next_entry(found),
        "done": [each.name for each in plan.done],
        "visits": [each.name for each in plan.rest],
        "tools": [each.tool for each in plan.rest],
        "cost": tour.cost,
        "unit": found.problem.unit,
        "lower_bound": tour.lower_bound if found.way != "kept" else None,
        "lost": list(plan.lost),
        "bad": dict(plan.bad),
        "unkept": found.unkept,
        "impossible": dict(plan.impossible),
    }


def next_entry(found: Progress) -> dict[str, Any]:
    """The next visit and the changes before it. Positions are in metres."""
    visit = found.next
    return {
        "problem": found.plan.problem,
        "way": found.way,
        "next": None
        if visit is None
        else {"visit": visit.name, "tool": visit.tool, "position": list(visit.position)},
        "left": len(found.plan.rest),
        "changes": changes_entry(found),
    }


def changes_entry(found: Progress) -> dict[str, Any]:
    """The changes among the visits that were left before."""
    return {
        "kept": list(found.kept),
        "reordered": list(found.reordered),
        "moved": {name: {"from": old, "to": new} for name, (old, new) in found.moved.items()},
        "added": list(found.added),
        "dropped": dict(found.dropped),
        "outdated": list(found.outdated),
    }


def text(found: Progress) -> RenderableType:
    """The rest as runs with one tool each, the visits that are left out and why, and the changes."""
    plan = found.plan
    shown: list[RenderableType] = [Text(line) for line in _said(found)]
    if plan.rest:
        shown.append(tours.text(found.tour, found.problem))
    if plan.done:
        ahead = " (the tour begins at the last of them)" if plan.rest else ""
        shown.append(Text(f"{len(plan.done)} done{ahead}"))
    shown += [Text(f"lost: {name}") for name in plan.lost]
    reasons = Counter({**plan.impossible, **plan.bad}.values())
    shown += [Text(f"{count} left out: {why}") for why, count in sorted(reasons.items())]
    return Group(*shown)


def next_text(found: Progress) -> RenderableType:
    """The changes, and one line for the next visit."""
    visit, lines = found.next, _said(found) if found.way == "resequenced" or found.outdated else []
    here = "nothing is left to visit" if visit is None else f"next: {visit.name} with {visit.tool}"
    return Group(*(Text(line) for line in lines), Text(here))


def _said(found: Progress) -> list[str]:
    """How the sequence was made, and each change."""
    lines = [WAYS[found.way]]
    if found.way == "resequenced":
        counts = {
            "kept": len(found.kept),
            "reordered": len(found.reordered),
            "moved": len(found.moved),
            "added": len(found.added),
            "dropped": len(found.dropped),
        }
        lines[0] += ": " + ", ".join(f"{count} {what}" for what, count in counts.items())
        lines += [f"  > {name}: {old} -> {new}" for name, (old, new) in found.moved.items()]
        lines += [f"  + {name}" for name in found.added]
    lines += [f"not all windows can be kept: {found.unkept}"] if found.unkept else []
    lines += [f"  - {name}: {why}" for name, why in found.dropped.items()]
    return lines + [f"  ! {name} is done, but the problem has changed it since" for name in found.outdated]
