"""Schedules as Gantt charts on the terminal, with what bounds the makespan, and as data."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.text import Text

from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.plan_times import Bottleneck, find_bottleneck
from cellwright.engine.model.shop_scheduling import Hold, Resource, Schedule, Shop, Timetable
from cellwright.engine.model.window_breaches import WindowSpan


def makespan_bounds(makespan_bottleneck: Bottleneck, unit: str) -> str:
    """What bounds a makespan, in words: the resource that never rests or the chain of steps,
    and their parts.
    """
    parts = [
        f"{share.operator} {share.time} {unit} ({count_noun(share.steps, 'step')})"
        for share in makespan_bottleneck.shares
    ]
    parts += (
        [f"waiting and ways between {makespan_bottleneck.waiting} {unit}"]
        if makespan_bottleneck.waiting
        else []
    )
    if not parts:
        return "No step takes any time."
    bound_text = (
        f"{makespan_bottleneck.resource} never rests"
        if makespan_bottleneck.resource
        else "A chain of steps bounds it"
    )
    return f"{bound_text}: {', '.join(parts)}."


def bottleneck_entry(timetable: Timetable) -> dict[str, Any]:
    """What bounds the makespan of a timetable, for programs: a resource that never rests, or a
    chain of steps.
    """
    makespan_bottleneck = find_bottleneck(timetable.plan, timetable.starts)
    return {
        "resource": None
        if makespan_bottleneck.resource is None
        else str(makespan_bottleneck.resource),
        "waiting": makespan_bottleneck.waiting,
        "parts": [
            {"operator": s.operator, "steps": s.steps, "time": s.time}
            for s in makespan_bottleneck.shares
        ],
    }


BAR_STYLES = ("blue", "red", "green", "magenta", "yellow", "cyan", "bright_blue", "bright_red")
SHOP = "of all schedules of this shop"
# What is proved of a makespan, by its scope. A scope that is not here is told as it is.
PROVED_WORDS = {
    SHOP: "the shortest possible",
    "of all plans": "the shortest possible",
    "of all orders of these steps": (
        "shortest for these steps; another choice of steps may be shorter"
    ),
    "of all ways to do these steps, also by other means": (
        "shortest for these steps, also with other arms or machines; "
        "another choice of steps may be shorter"
    ),
    "of all schedules of these objects on their shortest ways, with any machine, arm and place": (
        "shortest for these ways of the objects, with any machine, arm and place; "
        "longer ways may take less time"
    ),
    "of all schedules of the blocks of this plan": (
        "shortest for these steps, each errand in one piece; other steps may be shorter"
    ),
    "of all schedules that keep this order of the steps": (
        "shortest for this order of the steps; another order may be shorter"
    ),
    "of all ways in which the arms pass each other, each with its steps in this order": (
        "shortest for this order of each arm's steps; another order may be shorter"
    ),
}
MAX_WINDOW_ROWS = 6  # rows of one window
MAX_TOLD_WINDOWS = 3  # windows that are told in words below a chart
MIN_BARS_WIDTH = 30  # width in characters of the part with the bars


class BarKind(StrEnum):
    """What a bar means."""

    STAGE = "stage"
    HOLD = "hold"
    CHANGE = "change"
    WINDOW = "window"


@dataclass(frozen=True, slots=True)
class GanttBar:
    """A bar from `start` to `end`.

    `job` is the number of its job, -1 if it has none; `unit` the name of its unit, if known. The
    bar of a window ends when the window does; its later event is at `reached`.
    """

    start: int
    end: int
    label: str
    kind: BarKind
    job: int = -1
    detail: str = ""
    unit: str = ""
    reached: int = 0


@dataclass(frozen=True, slots=True)
class GanttRow:
    """A line of the chart; its bars do not overlap."""

    name: str
    bars: tuple[GanttBar, ...]


def gantt_rows(shop: Shop, schedule: Schedule) -> tuple[GanttRow, ...]:
    """The rows of the chart: jobs in their order, then every used unit of every resource that
    is no job.
    """
    number = {job.name: n for n, job in enumerate(shop.jobs)}
    chart_rows = [
        GanttRow(
            job.name,
            tuple(_stage_bar(shop, schedule, stage.name, number[job.name]) for stage in job.stages),
        )
        for job in shop.jobs
        if len(job.stages) > 1
    ]
    shown = {row.name for row in chart_rows}
    for resource in (
        shop_resource for shop_resource in shop.resources if shop_resource.name not in shown
    ):
        bars = sorted(
            _resource_bars(shop, schedule, resource.name, number),
            key=lambda bar: (bar.start, bar.end),
        )
        chart_rows += (
            _named_units(bars, resource)
            if all(bar.unit for bar in bars)
            else _equal_units(bars, resource)
        )
    return tuple(chart_rows)


def window_rows(spans: Sequence[WindowSpan], makespan: int, unit: str) -> tuple[GanttRow, ...]:
    """Rows for the windows between events, those of one window together: from the earlier event to
    the latest time of the later one.
    """
    chart_rows = list[GanttRow]()
    for window in dict.fromkeys(span.window for span in spans):
        own = [span for span in spans if span.window == window]
        bars = sorted((_window_bar(span, makespan, unit) for span in own), key=lambda b: b.start)
        named = [GanttRow(window.limits, tuple(row)) for row in _unit_bars(bars)]
        chart_rows += named[:MAX_WINDOW_ROWS]
    return tuple(chart_rows)


def _window_bar(span: WindowSpan, makespan: int, unit: str) -> GanttBar:
    event = span.events[0] or span.events[1]
    label = str(event.arguments[0]) if event is not None and event.arguments else ""
    begin, reached = min(span.begin, span.end), max(span.begin, span.end)
    latest = reached if span.slack is None else max(reached, span.end + span.slack)
    end = max(reached, min(latest, makespan))
    return GanttBar(begin, end, label, BarKind.WINDOW, -1, span.text(unit), "", reached)


def tightest_windows(spans: Sequence[WindowSpan], unit: str) -> list[str]:
    """The windows with the least slack, in words; nothing if there are none."""
    bounded = [(span.slack, span) for span in spans if span.slack is not None]
    tight = sorted(bounded, key=lambda entry: entry[0])[:MAX_TOLD_WINDOWS]
    said = [span.text(unit) for _, span in tight]
    return [f"The windows with the least slack: {'; '.join(said)}."] if said else []


def _named_units(bars: Sequence[GanttBar], resource: Resource) -> list[GanttRow]:
    """A row for each unit that is used, in the order of the resource."""
    own = {name: tuple(bar for bar in bars if bar.unit == name) for name in resource.units}
    return [GanttRow(name, unit) for name, unit in own.items() if unit]


def _equal_units(bars: Sequence[GanttBar], resource: Resource) -> list[GanttRow]:
    units = _unit_bars(bars)
    names = _unit_names(resource.name, resource.units, len(units))
    return [GanttRow(name, tuple(unit)) for name, unit in zip(names, units, strict=True)]


def _stage_bar(shop: Shop, schedule: Schedule, name: str, job: int) -> GanttBar:
    start, stage = schedule.starts[name], shop.stages[name]
    owner = shop.owners[name].name
    return GanttBar(
        start, start + stage.duration, _short_stage(name, owner), BarKind.STAGE, job, name
    )


def _short_stage(stage: str, job: str) -> str:
    """The name of a stage without the name of its job, and without its number there if more is
    said.
    """
    own = stage.removeprefix(job).lstrip(" .:") or stage
    return own if own == stage else re.sub(r"^\d+ (?=\S)", "", own)


def _resource_bars(
    shop: Shop, schedule: Schedule, resource: str, number: Mapping[str, int]
) -> Iterator[GanttBar]:
    for stage in shop.stages.values():
        if resource in stage.resources:
            owner = shop.owners[stage.name].name
            start = schedule.starts[stage.name]
            yield GanttBar(
                start, start + stage.duration, owner, BarKind.STAGE, number[owner], stage.name
            )
    for hold in (shop_hold for shop_hold in shop.holds if shop_hold.resource == resource):
        yield _hold_bar(shop, schedule, hold, number)
    for adjustment in schedule.adjustments:
        if shop.device[adjustment.device].operator == resource:
            yield GanttBar(
                adjustment.start,
                adjustment.end,
                adjustment.device,
                BarKind.CHANGE,
                -1,
                f"{adjustment.device}: {adjustment.change.after}",
            )


def _hold_bar(shop: Shop, schedule: Schedule, hold: Hold, number: Mapping[str, int]) -> GanttBar:
    begin = schedule.starts[hold.begin.stage] + hold.begin.offset if hold.begin else 0
    end = schedule.starts[hold.end.stage] + hold.end.offset if hold.end else schedule.makespan
    moment = hold.begin or hold.end
    owner = shop.owners[moment.stage].name if moment else ""
    unit = schedule.units.get(hold, "")
    hold_text = f"{owner} in {unit or hold.resource}"
    return GanttBar(begin, end, owner, BarKind.HOLD, number.get(owner, -1), hold_text, unit)


def _unit_bars(bars: Sequence[GanttBar]) -> list[list[GanttBar]]:
    """The bars of equal units: each bar goes to the first unit that is free."""
    units: list[list[GanttBar]] = []
    for bar in bars:
        free = [unit for unit in units if unit[-1].end <= bar.start]
        if free:
            free[0].append(bar)
        else:
            units.append([bar])
    return units


def _unit_names(resource: str, units: Sequence[str], count: int) -> list[str]:
    if count <= 1:
        return [resource] * count
    return list(units) if len(units) == count else [f"{resource} #{n}" for n in range(1, count + 1)]


@dataclass(frozen=True, slots=True)
class GanttChart:
    """The chart, fitted to the width of the terminal."""

    shop: Shop
    schedule: Schedule
    unit: str = ""
    spans: tuple[WindowSpan, ...] = ()

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> Iterator[RenderableType]:
        lines = (
            *gantt_rows(self.shop, self.schedule),
            *window_rows(self.spans, self.schedule.makespan, self.unit),
        )
        names = min(max((len(row.name) for row in lines), default=0), options.max_width // 3)
        width = max(MIN_BARS_WIDTH, options.max_width - names - 2)
        scale = width / max(1, self.schedule.makespan)
        for row in lines:
            text = Text(f"{row.name[:names]:{names}} ", no_wrap=True, overflow="crop", end="")
            yield Group(text.append_text(_row_line(row, scale, width)), Text())
        yield Text(
            " " * (names + 1) + _time_ticks(self.schedule.makespan, scale, width, self.unit),
            style="dim",
        )


def join_short_bars(bars: Sequence[GanttBar], least: float) -> list[GanttBar]:
    """Bars in the order of time, with those that are too short to be seen joined.

    Neighbours become one bar as long as it stays shorter than `least` units of time. So there are
    at most two bars for each `least` units, however many steps there are.
    """
    groups: list[list[GanttBar]] = []
    for bar in bars:
        if groups and bar.end - groups[-1][0].start < least:
            groups[-1].append(bar)
        else:
            groups.append([bar])
    return [group[0] if len(group) == 1 else _merge_bars(group) for group in groups]


def _merge_bars(bars: Sequence[GanttBar]) -> GanttBar:
    """One bar in the place of several short ones."""
    longest = max(bars, key=lambda bar: bar.end - bar.start)
    detail = f"{len(bars)} bars, from {bars[0].detail} to {bars[-1].detail}"
    return GanttBar(
        bars[0].start, max(bar.end for bar in bars), "", longest.kind, longest.job, detail
    )


def _row_line(row: GanttRow, scale: float, width: int) -> Text:
    """One row of bars. A bar shorter than one character gets a free character if there is one,
    unless bars crowd.
    """
    text, column = Text(), 0
    crowded = len(row.bars) > width // 2
    for bar in join_short_bars(row.bars, 1 / scale) if crowded else row.bars:
        first = max(column, min(width - 1, round(bar.start * scale)))
        last = max(first + 1, min(width, round(bar.end * scale)))
        if crowded and round(bar.end * scale) <= column:
            continue
        if first >= width:
            break
        text.append(" " * (first - column))
        text.append(_bar_characters(bar, last - first), _bar_style(bar))
        column = last
    return text


def _bar_characters(bar: GanttBar, width: int) -> str:
    if bar.kind is BarKind.WINDOW:
        done = round(width * (bar.reached - bar.start) / max(1, bar.end - bar.start))
        line = "─" * done + "·" * (width - done)
        return f"{bar.label} {line[len(bar.label) + 1 :]}" if len(bar.label) < done else line
    fill = {BarKind.STAGE: "█", BarKind.HOLD: "░", BarKind.CHANGE: "▒"}[bar.kind]
    return f"{bar.label} ".ljust(width, fill) if 0 < len(bar.label) < width else fill * width


def _bar_style(bar: GanttBar) -> str:
    return "dim" if bar.job < 0 else BAR_STYLES[bar.job % len(BAR_STYLES)]


def _time_ticks(makespan: int, scale: float, width: int, unit: str) -> str:
    """Round times below the bars, as many as fit."""
    step = 1
    while step * scale < 8:
        step *= 5 if str(step)[0] == "1" else 2
    line = [" "] * width
    last = width - len(unit) - 1
    for time in range(0, makespan + 1, step):
        place, tick_text = round(time * scale), f"|{time}"
        if place + len(tick_text) <= last:
            line[place : place + len(tick_text)] = tick_text
    return f"{''.join(line).rstrip()} {unit}".rstrip()


def schedule_summary(schedule: Schedule, unit: str = "", scope: str = "", floor: int = 0) -> str:
    """Makespan, bound and proof in one line; `scope` says among what it is the least. No plan
    ends before `floor`.
    """
    late = f", weighted tardiness {schedule.tardiness}" if schedule.tardiness else ""
    late += (
        f"; no plan ends before {floor} {unit}".rstrip() if 0 < floor < schedule.makespan else ""
    )
    if schedule.proved:
        proved = PROVED_WORDS.get(scope, f"proved to be the least {scope}".rstrip())
        return f"makespan {schedule.makespan} {unit}{late}, {proved}".replace(" ,", ",")
    bound = f"at least {schedule.lower_bound}, gap {100 * schedule.gap:.1f} %"
    return f"makespan {schedule.makespan} {unit}, {bound}{late}".replace(" ,", ",")


def timetable_chart(timetable: Timetable, unit: str) -> list[RenderableType]:
    """The chart of a timetable, its makespan, and why it has a row for each step where it has."""
    parts: list[RenderableType] = [
        GanttChart(timetable.shop, timetable.schedule, unit, timetable.spans),
        Text(),
        Text(schedule_summary(timetable.schedule, unit, timetable.scope, timetable.floor)),
    ]
    notes = [kept_order(timetable)] if timetable.note else []
    notes += tightest_windows(timetable.spans, unit)
    return [
        *parts,
        *map(
            Text, (makespan_bounds(find_bottleneck(timetable.plan, timetable.starts), unit), *notes)
        ),
    ]


def kept_order(timetable: Timetable) -> str:
    """Why the steps of a timetable have rows of their own and keep the order of the plan where
    they do.
    """
    return f"Scheduled step by step, not in whole errands of an arm: {timetable.note}."


def charted_shop(
    shop: Shop, schedule: Schedule, unit: str = "", scope: str = SHOP, floor: int = 0
) -> list[RenderableType]:
    """The chart of a schedule, and its makespan."""
    return [
        GanttChart(shop, schedule, unit),
        Text(),
        Text(schedule_summary(schedule, unit, scope, floor)),
    ]


def window_entries(timetable: Timetable) -> dict[str, Any]:
    """The windows between events with their slack, for programs; nothing if there are none."""
    entries = [span.entry() for span in timetable.spans]
    return {"windows": entries} if entries else {}


def proof_entry(schedule: Schedule, scope: str = SHOP, floor: int = 0) -> dict[str, Any]:
    """The makespan and what is proved of it, for programs; with `floor` also before when no
    plan ends.
    """
    return {
        **({"all_plans": floor} if floor else {}),
        "makespan": schedule.makespan,
        "lower_bound": schedule.lower_bound,
        "gap": round(schedule.gap, 6),
        "proved": schedule.proved,
        "scope": scope,
    }


def schedule_entry(
    shop: Shop, schedule: Schedule, scope: str = SHOP, staged: bool = True, floor: int = 0
) -> dict[str, Any]:
    """A schedule for programs: totals, stages in the order of their starts if `staged`, and
    changes of devices.
    """
    stages = [
        {
            "job": shop.owners[name].name,
            "stage": name,
            "start": schedule.starts[name],
            "end": schedule.starts[name] + stage.duration,
            "resources": list(stage.resources),
        }
        for name, stage in (shop.stages.items() if staged else ())
    ]
    changes = [
        {
            "device": adjustment.device,
            "from": adjustment.change.before,
            "to": adjustment.change.after,
            "start": adjustment.start,
            "end": adjustment.end,
        }
        for adjustment in sorted(schedule.adjustments, key=lambda adjusted: adjusted.start)
    ]
    return {
        **proof_entry(schedule, scope, floor),
        "tardiness": schedule.tardiness,
        **({"stages": sorted(stages, key=_by_start)} if staged else {}),
        "changes": changes,
    }


def _by_start(stage: Mapping[str, Any]) -> tuple[Any, ...]:
    return stage["start"], stage["end"], stage["stage"]
