"""The order of visits that a plan follows, and the time of each operator, as text and data."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.measurements import tool_groups, tour_report
from cellwright.engine.formats.report.text_tables import TextTable
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning.decomposition import Itinerary
from cellwright.engine.pipelines.planning.plan_objective import Run
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.terms import Function as Name
from cellwright.kb.terms import natural_key

MAX_LISTED_MEASUREMENTS = 12  # measurements of one reason that are named


@dataclass
class OperatorShare:
    """What the steps of one operator take together, in the domain's unit of time."""

    steps: int = 0
    duration: int = 0
    longest: int = field(default=0)


def by_operator(plan: Plan) -> Mapping[str, OperatorShare]:
    """The steps by operator, those that take most time first."""
    share_by_operator: dict[str, OperatorShare] = {}
    for step in plan.steps:
        own = share_by_operator.setdefault(step.operator.name, OperatorShare())
        own.steps += 1
        own.duration += step.duration
        own.longest = max(own.longest, step.duration)
    return dict(
        sorted(
            share_by_operator.items(),
            key=lambda operator_share: (-operator_share[1].duration, operator_share[0]),
        )
    )


def itinerary_entry(run: Run) -> dict[str, Any]:
    """The sequence and the times, for JSON."""
    itinerary = run.itinerary
    if itinerary is None:
        return {}
    sequence_data = (
        tour_report.shares_entry(itinerary.shared)
        if itinerary.shared
        else tour_report.tour_entry(itinerary.tour, itinerary.problem)
    )
    sequence_data |= counted_entry(itinerary)
    sequence_data |= {"kept": itinerary.kept, "altered": itinerary.altered}
    groups = tool_groups.tool_groups_entry(itinerary.partition)
    groups["impossible"] |= itinerary.unasked
    content: dict[str, Any] = {"sequence": {**sequence_data, "partition": groups}}
    if isinstance(run.outcome, Found):
        content["times"] = {
            name: {"steps": own.steps, "duration": own.duration, "longest": own.longest}
            for name, own in by_operator(run.outcome.plan).items()
        }
    return content


def itinerary_text(run: Run, unit: str) -> RenderableType:
    """The sequence in a line, what is left out and why, and where the time goes."""
    itinerary = run.itinerary
    if itinerary is None:
        return Text()
    kept_note = (
        ", as kept"
        if itinerary.kept
        else ", its runs put so that changes of tools and stations take least time"
        if itinerary.altered
        else ""
    )
    report_parts: list[RenderableType] = [
        tour_report.shares_text(itinerary.shared)
        if itinerary.shared
        else Text(f"In the order of the sequence{kept_note}: {_summary(itinerary)}")
    ]
    report_parts += (
        [Text(f"Not all windows can be kept: {itinerary.unkept}.")] if itinerary.unkept else []
    )
    report_parts += [
        Text(line)
        for line in (
            *_left_out(itinerary.partition.impossible),
            *_unasked_measurements(itinerary.unasked),
        )
    ]
    if isinstance(run.outcome, Found) and run.timetable is not None:
        report_parts.insert(0, _operator_times(run.outcome.plan, unit))
    return Group(*report_parts)


def counted_entry(way: Itinerary) -> dict[str, Any]:
    """What the plan takes with all changes, for JSON: in the place of the length of its ways,
    which comes under `ways`.
    """
    ways = {"ways": {"cost": way.tour.cost, "unit": way.problem.unit}}
    if way.counted is None:
        return {**ways, "lower_bound": None, "gap": None, "proved": False} if way.altered else {}
    counted = way.counted
    gap = {"gap": round(counted.gap, 6) if counted.least else None, "proved": counted.proved}
    return {
        **ways,
        "cost": counted.takes,
        "unit": counted.unit,
        "lower_bound": counted.least,
        **gap,
    }


def _summary(way: Itinerary) -> str:
    """One line about the tour: what it takes with all changes where that was counted, else the
    length of its ways.
    """
    counted = way.counted
    if counted is None and way.altered:
        ways = tour_report.length(way.tour.cost, way.problem.unit)
        least = tour_report.length(way.tour.lower_bound, way.problem.unit)
        return (
            f"{len(way.visits)} visits, open, {ways} of ways (the least without changes are "
            f"{least})"
        )
    if counted is None:
        return tour_report.tour_summary(way.tour, way.problem)
    good = (
        "proved least" if counted.proved else f"at most {100 * counted.gap:.2f} % above the least"
    )
    what = "its plan takes" if counted.unit else "its plan costs"
    takes, least = (f"{each} {counted.unit}".strip() for each in (counted.takes, counted.least))
    return (
        f"{len(way.visits)} visits, open, {what} {takes} with all changes, lower bound {least}: "
        f"{good}"
    )


def _operator_times(plan: Plan, unit: str) -> RenderableType:
    own = by_operator(plan)
    total = sum(operator_share.duration for operator_share in own.values()) or 1
    rows = [
        (
            name,
            str(operator_share.steps),
            str(operator_share.duration),
            str(operator_share.longest),
            f"{100 * operator_share.duration / total:.0f} %",
        )
        for name, operator_share in own.items()
    ]
    heads = ("time goes to", "steps", f"lasts ({unit})", "longest", "share")
    return TextTable(heads, rows, right=heads[1:])


def _unasked_measurements(reasons: Mapping[str, str]) -> list[str]:
    """A line that counts the measurements that cannot be made and that no goal asks for; none
    if there are none.
    """
    counts = Counter(reasons.values()).most_common()
    reasons_text = "; ".join(f"{why} ({count})" for why, count in counts)
    number = count_noun(len(reasons), "measurement")
    return [f"No goal asks for {number} that cannot be made: {reasons_text}"] if counts else []


def _left_out(reasons: Mapping[str, str]) -> list[str]:
    """A line for each reason why measurements cannot be made."""
    by_reason: dict[str, list[str]] = {}
    for name in sorted(reasons, key=lambda name: natural_key(Name(name))):
        by_reason.setdefault(reasons[name], []).append(name)
    return [
        f"Not in the sequence: {', '.join(names[:MAX_LISTED_MEASUREMENTS])}"
        + (
            f" and {len(names) - MAX_LISTED_MEASUREMENTS} more (--format json has all)"
            if len(names) > MAX_LISTED_MEASUREMENTS
            else ""
        )
        + f": {why}"
        for why, names in by_reason.items()
    ]
