"""A sequence in progress, for people and programs: the next visit, and the changes against the kept sequence."""

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report import shares
from cellwright.engine.formats.report import tour as tours
from cellwright.engine.model.tour import Tour, TourProblem
from cellwright.kb.store.sequences import PlannedVisit, SequencePlan

if TYPE_CHECKING:
    from cellwright.engine.pipelines.parts import Shared

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
    tour = found.tour
    if (shared := shared_of(found)) is not None:
        return {**_rest(found), **shares.entry(shared, bound=found.way != "kept")}
    return {
        **_rest(found),
        "cost": tour.cost,
        "unit": found.problem.unit,
        "lower_bound": tour.lower_bound if found.way != "kept" else None,
    }


def _rest(found: Progress) -> dict[str, Any]:
    """What is done, what is left, and what is left out."""
    plan = found.plan
    return {
        **next_entry(found),
        "done": [each.name for each in plan.done],
        "visits": [each.name for each in plan.rest],
        "tools": [each.tool for each in plan.rest],
        "lost": list(plan.lost),
        "bad": dict(plan.bad),
        "unkept": found.unkept,
        "impossible": dict(plan.impossible),
    }


def next_entry(found: Progress) -> dict[str, Any]:
    """The next visit and the changes before it. Positions are in metres."""
    visit = found.next
    each = {arm: _visit(ahead) for arm, ahead in ahead_of(found).items()}
    return {
        "problem": found.plan.problem,
        "way": found.way,
        "next": None if visit is None else _visit(visit),
        **({"next_of_arms": each} if each else {}),
        "left": len(found.plan.rest),
        "changes": changes_entry(found),
    }


def _visit(visit: PlannedVisit) -> dict[str, Any]:
    arm = {"arm": visit.arm} if visit.arm else {}
    return {"visit": visit.name, "tool": visit.tool, **arm, "position": list(visit.position)}


def shared_of(found: Progress) -> "Shared | None":
    """How several arms share the rest; None if one makes all of it."""
    shared: Shared | None = getattr(found, "shared", None)
    return shared


def ahead_of(found: Progress) -> Mapping[str, PlannedVisit]:
    """The next visit of each arm that has one left; empty if there is one arm alone."""
    arms = dict.fromkeys(each.arm for each in found.plan.rest if each.arm)
    return {arm: next(each for each in found.plan.rest if each.arm == arm) for arm in sorted(arms)}


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
    if (shared := shared_of(found)) is not None:
        shown.append(shares.text(shared))
    elif plan.rest:
        shown.append(tours.text(found.tour, found.problem))
    if plan.done:
        where = "each arm goes on at its last one" if shared else "the tour begins at the last of them"
        ahead = f" ({where})" if plan.rest else ""
        shown.append(Text(f"{len(plan.done)} done{ahead}"))
    shown += [Text(f"lost: {name}") for name in plan.lost]
    reasons = Counter({**plan.impossible, **plan.bad}.values())
    shown += [Text(f"{count} left out: {why}") for why, count in sorted(reasons.items())]
    return Group(*shown)


def next_text(found: Progress) -> RenderableType:
    """The changes, and one line for the next visit."""
    visit, lines = found.next, _said(found) if found.way == "resequenced" or found.outdated else []
    ahead = ahead_of(found) or ({"": visit} if visit else {})
    said = "; ".join(
        f"{f'{arm}: ' if arm else ''}{each.name} with {each.tool}" for arm, each in ahead.items()
    )
    here = f"next: {said}" if said else "nothing is left to visit"
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
