"""A sequence in progress: the next visit, and the changes against the kept sequence."""

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.measurements import tour_report
from cellwright.engine.formats.report.measurements import tour_report as tours
from cellwright.engine.model.tour_problem import Tour, TourProblem
from cellwright.kb.store.inspection_store import PlannedVisit, SequencePlan

if TYPE_CHECKING:
    from cellwright.engine.pipelines.planning.decomposition import SharedMeasurements

SEQUENCE_WAYS = {
    "made": "a new sequence",
    "kept": "the kept sequence is unchanged",
    "resequenced": "the rest was sequenced anew",
}


class SequenceProgress(Protocol):
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


def sequence_entry(progress: SequenceProgress) -> dict[str, Any]:
    """A sequence, for JSON. Its costs are those of the rest, from the last visit that is done."""
    tour = progress.tour
    if (shared := shared_of(progress)) is not None:
        return {
            **_rest_entry(progress),
            **tour_report.shares_entry(shared, bound=progress.way != "kept"),
        }
    return {
        **_rest_entry(progress),
        "cost": tour.cost,
        "unit": progress.problem.unit,
        "lower_bound": tour.lower_bound if progress.way != "kept" else None,
    }


def _rest_entry(progress: SequenceProgress) -> dict[str, Any]:
    """What is done, what is left, and what is left out."""
    plan = progress.plan
    return {
        **next_entry(progress),
        "done": [visit.name for visit in plan.done],
        "visits": [visit.name for visit in plan.rest],
        "tools": [visit.tool for visit in plan.rest],
        "lost": list(plan.lost),
        "bad": dict(plan.bad),
        "unkept": progress.unkept,
        "impossible": dict(plan.impossible),
    }


def next_entry(progress: SequenceProgress) -> dict[str, Any]:
    """The next visit and the changes before it. Positions are in metres."""
    visit = progress.next
    arm_visits = {arm: _visit_entry(ahead) for arm, ahead in ahead_of(progress).items()}
    return {
        "problem": progress.plan.problem,
        "way": progress.way,
        "next": None if visit is None else _visit_entry(visit),
        **({"next_of_arms": arm_visits} if arm_visits else {}),
        "left": len(progress.plan.rest),
        "changes": changes_entry(progress),
    }


def _visit_entry(visit: PlannedVisit) -> dict[str, Any]:
    arm = {"arm": visit.arm} if visit.arm else {}
    return {"visit": visit.name, "tool": visit.tool, **arm, "position": list(visit.position)}


def shared_of(progress: SequenceProgress) -> "SharedMeasurements | None":
    """How several arms share the rest; None if one makes all of it."""
    shared: SharedMeasurements | None = getattr(progress, "shared", None)
    return shared


def ahead_of(progress: SequenceProgress) -> Mapping[str, PlannedVisit]:
    """The next visit of each arm that has one left; empty if there is one arm alone."""
    arms = dict.fromkeys(visit.arm for visit in progress.plan.rest if visit.arm)
    return {
        arm: next(visit for visit in progress.plan.rest if visit.arm == arm) for arm in sorted(arms)
    }


def changes_entry(progress: SequenceProgress) -> dict[str, Any]:
    """The changes among the visits that were left before."""
    return {
        "kept": list(progress.kept),
        "reordered": list(progress.reordered),
        "moved": {name: {"from": old, "to": new} for name, (old, new) in progress.moved.items()},
        "added": list(progress.added),
        "dropped": dict(progress.dropped),
        "outdated": list(progress.outdated),
    }


def sequence_text(progress: SequenceProgress) -> RenderableType:
    """The rest as runs with one tool each, the visits that are left out and why, and the
    changes.
    """
    plan = progress.plan
    shown: list[RenderableType] = [Text(line) for line in _change_texts(progress)]
    if (shared := shared_of(progress)) is not None:
        shown.append(tour_report.shares_text(shared))
    elif plan.rest:
        shown.append(tours.tour_text(progress.tour, progress.problem))
    if plan.done:
        where = (
            "each arm goes on at its last one" if shared else "the tour begins at the last of them"
        )
        ahead = f" ({where})" if plan.rest else ""
        shown.append(Text(f"{len(plan.done)} done{ahead}"))
    shown += [Text(f"lost: {name}") for name in plan.lost]
    reasons = Counter({**plan.impossible, **plan.bad}.values())
    shown += [Text(f"{count} left out: {why}") for why, count in sorted(reasons.items())]
    return Group(*shown)


def next_text(progress: SequenceProgress) -> RenderableType:
    """The changes, and one line for the next visit."""
    visit, lines = (
        progress.next,
        _change_texts(progress) if progress.way == "resequenced" or progress.outdated else [],
    )
    ahead = ahead_of(progress) or ({"": visit} if visit else {})
    ahead_text = "; ".join(
        f"{f'{arm}: ' if arm else ''}{ahead_visit.name} with {ahead_visit.tool}"
        for arm, ahead_visit in ahead.items()
    )
    next_line = f"next: {ahead_text}" if ahead_text else "nothing is left to visit"
    return Group(*(Text(line) for line in lines), Text(next_line))


def _change_texts(progress: SequenceProgress) -> list[str]:
    """How the sequence was made, and each change."""
    lines = [SEQUENCE_WAYS[progress.way]]
    if progress.way == "resequenced":
        counts = {
            "kept": len(progress.kept),
            "reordered": len(progress.reordered),
            "moved": len(progress.moved),
            "added": len(progress.added),
            "dropped": len(progress.dropped),
        }
        lines[0] += ": " + ", ".join(
            f"{count} {change_kind}" for change_kind, count in counts.items()
        )
        lines += [f"  > {name}: {old} -> {new}" for name, (old, new) in progress.moved.items()]
        lines += [f"  + {name}" for name in progress.added]
    lines += [f"not all windows can be kept: {progress.unkept}"] if progress.unkept else []
    lines += [f"  - {name}: {why}" for name, why in progress.dropped.items()]
    return lines + [
        f"  ! {name} is done, but the problem has changed it since" for name in progress.outdated
    ]
