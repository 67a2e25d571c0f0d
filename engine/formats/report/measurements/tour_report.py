"""Tours of visits, and shares of visits of several arms, as tables and as data."""

from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report import rich_parts
from cellwright.engine.formats.report.text_tables import TextTable
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.tour_problem import (
    ENDLESS_WINDOW,
    Tour,
    TourProblem,
    slack_of,
    times_of,
)
from cellwright.engine.pipelines import inspection
from cellwright.engine.pipelines.inspection.tool_tours import TourVisits

if TYPE_CHECKING:
    from cellwright.engine.pipelines.planning.decomposition import SharedMeasurements

MAX_TOUR_ROWS = 40


def tour_entry(tour: Tour, problem: TourProblem) -> dict[str, Any]:
    """A tour, for JSON."""
    tour_data: dict[str, Any] = {
        "problem": problem.name,
        "closed": problem.closed,
        "visits": [problem.visits[visit_index].name for visit_index in tour.order],
        "cost": tour.cost,
        "unit": problem.unit,
        "lower_bound": tour.lower_bound,
        "gap": round(tour.gap, 6) if tour.gap != float("inf") else None,
        "proved": tour.proved,
        "method": tour.method,
        "work": tour.work,
    }
    if any(visit.tool for visit in problem.visits):
        tour_data["tools"] = [problem.visits[visit_index].tool for visit_index in tour.order]
    if problem.timed or any(visit.duration for visit in problem.visits):
        tour_data["times"] = visit_times(tour, problem)
    if tour.poses:
        tour_data["poses"] = list(tour.poses)
    return tour_data


def tour_text(tour: Tour, problem: TourProblem) -> RenderableType:
    """The tour as a list of runs with one tool each, and a summary line."""
    if not tour.order:
        return Text("nothing to visit")
    rows = []
    for tool, names in _tool_runs(tour, problem):
        rest = (
            f", and {len(names) - MAX_TOUR_ROWS} more (--format json has all)"
            if len(names) > MAX_TOUR_ROWS
            else ""
        )
        shown = ", ".join(names[:MAX_TOUR_ROWS]) + rest
        rows.append((tool or "-", str(len(names)), shown))
    runs = TextTable(("tool", "visits", "in order"), rows)
    return Group(runs, *_visit_timetable(tour, problem), Text(tour_summary(tour, problem)))


def visit_times(tour: Tour, problem: TourProblem) -> list[dict[str, Any]]:
    """For each visit in order: when the arm arrives, begins and ends, its window, and its slack."""
    time_entries = []
    slacks = slack_of(problem, tour.order)
    for at, (arrives, begins), slack in zip(
        tour.order, times_of(problem, tour.order), slacks, strict=True
    ):
        visit = problem.visits[at]
        ends = begins + visit.duration
        row: dict[str, Any] = {
            "visit": visit.name,
            "arrives": arrives,
            "begins": begins,
            "ends": ends,
        }
        if visit.window is not None:
            row["window"] = [
                visit.window[0],
                None if visit.window[1] >= ENDLESS_WINDOW else visit.window[1],
            ]
        time_entries.append(row | {"slack": slack if slack < ENDLESS_WINDOW // 2 else None})
    return time_entries


def _visit_timetable(tour: Tour, problem: TourProblem) -> list[RenderableType]:
    """The times of all visits, if there are windows or durations."""
    if not (problem.timed or any(visit.duration for visit in problem.visits)):
        return []
    rows = [
        (
            visit_time["visit"],
            str(visit_time["arrives"]),
            str(visit_time["begins"]),
            str(visit_time["ends"]),
            _window_text(visit_time.get("window")),
            "-" if visit_time["slack"] is None else str(visit_time["slack"]),
        )
        for visit_time in visit_times(tour, problem)
    ]
    return [TextTable(("visit", "arrives", "begins", "ends", "window", "slack"), rows)]


def _window_text(ends: list[int | None] | None) -> str:
    return "-" if ends is None else f"{ends[0]}..{'' if ends[1] is None else ends[1]}"


def time_entry(time: int | None, unit: str) -> dict[str, Any]:
    """How long the ways of a tour between visits by the same tool take, for JSON; empty if no
    travel is declared.
    """
    return {} if time is None else {"travel_time": time, "time_unit": unit}


def time_text(time: int | None, unit: str) -> list[RenderableType]:
    """The same for people."""
    return (
        []
        if time is None
        else [Text(f"the ways between visits by the same tool take {time} {unit}")]
    )


def tour_summary(tour: Tour, problem: TourProblem) -> str:
    """One line: the number of visits, the cost, and its quality."""
    kind = "closed" if problem.closed else "open"
    good = "the least possible" if tour.proved else f"at most {100 * tour.gap:.2f} % above it"
    bound = "no lower bound"
    if tour.gap != float("inf"):
        bound = f"lower bound {length(tour.lower_bound, problem.unit)}: {good}"
    return f"{len(tour.order)} visits, {kind}, cost {length(tour.cost, problem.unit)}, {bound}"


def length(cost: int, unit: str) -> str:
    """A cost as people say it: millionths of a metre or of a second as metres or seconds."""
    return f"{cost / 1e6:.3f} {unit[1:]}" if unit.startswith("µ") else f"{cost} {unit}".strip()


def _tool_runs(tour: Tour, problem: TourProblem) -> list[tuple[str, list[str]]]:
    runs: list[tuple[str, list[str]]] = []
    for visit_index in tour.order:
        visit = problem.visits[visit_index]
        if not runs or runs[-1][0] != visit.tool:
            runs.append((visit.tool, []))
        runs[-1][1].append(visit.name)
    return runs


def visits_tour_content(answer: Tour, tour_visits: TourVisits) -> dict[str, Any]:
    """The tour through these visits as data."""
    from cellwright.engine.formats.report.measurements import tool_groups

    tour_data = tour_entry(answer, tour_visits.tours)
    if tour_visits.parts is not None:
        tour_data["partition"] = tool_groups.tool_groups_entry(tour_visits.parts)
    if tour_visits.problem is not None:
        tour_data |= time_entry(
            _visits_time(answer, tour_visits), tour_visits.problem.domain.time_unit
        )
    return tour_data


def visits_tour_text(answer: Tour, tour_visits: TourVisits) -> "RenderableType":
    """The tour through these visits as people read it."""
    from cellwright.engine.formats.report.measurements import tool_groups

    shown = [tour_text(answer, tour_visits.tours)]
    if tour_visits.parts is not None:
        shown.insert(0, tool_groups.tool_groups_text(tour_visits.parts))
    if tour_visits.problem is not None:
        shown += time_text(_visits_time(answer, tour_visits), tour_visits.problem.domain.time_unit)
    return rich_parts.Group(*shown)


def _visits_time(answer: Tour, tour_visits: TourVisits) -> int | None:
    return (
        None
        if tour_visits.problem is None
        else inspection.time_between(tour_visits.problem, tour_visits.tours, answer.order)
    )


MAX_SHARE_VISITS = 12  # measurements of one arm that are named


def shares_entry(arm_shares: "SharedMeasurements", bound: bool = True) -> dict[str, Any]:
    """The shares, for JSON, with the `bound` if it is known.

    Times are in the unit that is given: a unit of time, or micrometres where nobody knows how fast
    arms are.
    """
    return {
        "arms": {
            arm: {
                "visits": list(own),
                "tools": [arm_shares.tools[name] for name in own],
                "busy": arm_shares.lasts(arm_shares.shares.busy[arm]),
                "each": arm_shares.measuring[arm],
            }
            for arm, own in arm_shares.shares.orders.items()
        },
        "common": arm_shares.shares.common,
        "makespan": arm_shares.lasts(arm_shares.shares.makespan),
        "lower_bound": arm_shares.lasts(arm_shares.shares.lower_bound) if bound else None,
        "unit": arm_shares.unit,
        "waits": [list(pair) for pair in arm_shares.waits],
    }


def shares_text(arm_shares: "SharedMeasurements", listed: bool = True) -> RenderableType:
    """A table of the arms with their measurements in order, if they are to be `listed`, and a
    summary.
    """
    shares = arm_shares.shares
    rows = []
    for arm, own in shares.orders.items():
        rest = (
            f", and {len(own) - MAX_SHARE_VISITS} more (--format json has all)"
            if len(own) > MAX_SHARE_VISITS
            else ""
        )
        busy = f"{arm_shares.lasts(shares.busy[arm])}"
        rows.append(
            (arm, str(len(own)), busy, ", ".join(own[:MAX_SHARE_VISITS]) + rest if own else "-")
        )
    heads = ("arm", "measurements", f"busy ({arm_shares.unit})", "in order")
    table = TextTable(heads, rows, right=heads[1:3])
    summary_lines = [shares_summary(arm_shares)]
    if arm_shares.waits:
        pairs = "; ".join(
            f"{second} waits for {first}" for first, second in arm_shares.waits[:MAX_SHARE_VISITS]
        )
        more = (
            f"; {len(arm_shares.waits) - MAX_SHARE_VISITS} more"
            if len(arm_shares.waits) > MAX_SHARE_VISITS
            else ""
        )
        summary_lines.append(f"Of different arms, {pairs}{more}.")
    return Group(*([table] if listed else []), *map(Text, summary_lines))


def shares_summary(arm_shares: "SharedMeasurements") -> str:
    """What the shares take, and what no way to share them is below."""
    shares, unit = arm_shares.shares, arm_shares.unit
    count = count_noun(sum(map(len, shares.orders.values())), "measurement")
    most, bound = arm_shares.lasts(shares.makespan), arm_shares.lasts(shares.lower_bound)
    gap = (
        "the least possible"
        if most <= bound
        else f"no way to share them takes less than {bound} {unit}"
    )
    gap = f", {gap}" if bound else ""
    common = (
        f"{shares.common} of them within reach of more than one"
        if shares.common
        else "each within reach of one"
    )
    waiting = ", without waiting for each other" if arm_shares.waits else ""
    if len(shares.orders) == 1:
        return (
            f"{next(iter(shares.orders))} makes {count}: {most} {unit} by the times of the "
            f"tour{gap}"
        )
    return (
        f"{len(shares.orders)} arms share {count}, {common}: {most} {unit} by the times of the "
        f"tours{waiting}{gap}"
    )
