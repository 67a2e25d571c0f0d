"""The sequence that a plan follows, and where its time goes: by operator, for people and programs."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report import inspection, shares, tour
from cellwright.engine.formats.report.rows import TextTable
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.wording import counted
from cellwright.engine.pipelines.objective import Run
from cellwright.kb.model.plan import Plan
from cellwright.kb.terms import Function as Name
from cellwright.kb.terms import natural_key

LISTED = 12  # measurements of one reason that are named


@dataclass
class Share:
    """What the steps of one operator take together, in the domain's unit of time."""

    steps: int = 0
    duration: int = 0
    longest: int = field(default=0)


def by_operator(plan: Plan) -> Mapping[str, Share]:
    """The steps by operator, those that take most time first."""
    found: dict[str, Share] = {}
    for step in plan.steps:
        own = found.setdefault(step.operator.name, Share())
        own.steps += 1
        own.duration += step.duration
        own.longest = max(own.longest, step.duration)
    return dict(sorted(found.items(), key=lambda each: (-each[1].duration, each[0])))


def entry(run: Run) -> dict[str, Any]:
    """The sequence and the times, for JSON."""
    way = run.itinerary
    if way is None:
        return {}
    found = shares.entry(way.shared) if way.shared else tour.entry(way.tour, way.problem)
    found |= {"kept": way.kept, "altered": way.altered}
    groups = inspection.entry(way.partition)
    groups["impossible"] |= way.unasked
    content: dict[str, Any] = {"sequence": {**found, "partition": groups}}
    if isinstance(run.outcome, Found):
        content["times"] = {
            name: {"steps": own.steps, "duration": own.duration, "longest": own.longest}
            for name, own in by_operator(run.outcome.plan).items()
        }
    return content


def text(run: Run, unit: str) -> RenderableType:
    """The sequence in a line, what is left out and why, and where the time goes."""
    way = run.itinerary
    if way is None:
        return Text()
    kept = (
        ", as kept"
        if way.kept
        else ", its runs put so that changes of tools and stations take least time"
        if way.altered
        else ""
    )
    said: list[RenderableType] = [
        shares.text(way.shared)
        if way.shared
        else Text(f"In the order of the sequence{kept}: {tour.summary(way.tour, way.problem)}")
    ]
    said += [Text(f"Not all windows can be kept: {way.unkept}.")] if way.unkept else []
    said += [Text(line) for line in (*_left_out(way.partition.impossible), *_unasked(way.unasked))]
    if isinstance(run.outcome, Found) and run.timetable is not None:
        said.insert(0, _times(run.outcome.plan, unit))
    return Group(*said)


def _times(plan: Plan, unit: str) -> RenderableType:
    own = by_operator(plan)
    total = sum(each.duration for each in own.values()) or 1
    rows = [
        (name, str(each.steps), str(each.duration), str(each.longest), f"{100 * each.duration / total:.0f} %")
        for name, each in own.items()
    ]
    heads = ("time goes to", "steps", f"lasts ({unit})", "longest", "share")
    return TextTable(heads, rows, right=heads[1:])


def _unasked(reasons: Mapping[str, str]) -> list[str]:
    """A line that counts the measurements that cannot be made and that no goal asks for; none if there are none."""
    counts = Counter(reasons.values()).most_common()
    told = "; ".join(f"{why} ({count})" for why, count in counts)
    number = counted(len(reasons), "measurement")
    return [f"No goal asks for {number} that cannot be made: {told}"] if counts else []


def _left_out(reasons: Mapping[str, str]) -> list[str]:
    """A line for each reason why measurements cannot be made."""
    by_reason: dict[str, list[str]] = {}
    for name in sorted(reasons, key=lambda name: natural_key(Name(name))):
        by_reason.setdefault(reasons[name], []).append(name)
    return [
        f"Not in the sequence: {', '.join(names[:LISTED])}"
        + (f" and {len(names) - LISTED} more (--format json has all)" if len(names) > LISTED else "")
        + f": {why}"
        for why, names in by_reason.items()
    ]
