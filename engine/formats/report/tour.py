"""Tours for people and programs: a table and a JSON entry."""

from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.rows import TextTable
from cellwright.engine.model.tour import ENDLESS, Tour, TourProblem, slack_of, times_of

SHOWN = 40


def entry(tour: Tour, problem: TourProblem) -> dict[str, Any]:
    """A tour, for JSON."""
    found: dict[str, Any] = {
        "problem": problem.name,
        "closed": problem.closed,
        "visits": [problem.visits[each].name for each in tour.order],
        "cost": tour.cost,
        "unit": problem.unit,
        "lower_bound": tour.lower_bound,
        "gap": round(tour.gap, 6) if tour.gap != float("inf") else None,
        "proved": tour.proved,
        "method": tour.method,
        "work": tour.work,
    }
    if any(visit.tool for visit in problem.visits):
        found["tools"] = [problem.visits[each].tool for each in tour.order]
    if problem.timed or any(visit.duration for visit in problem.visits):
        found["times"] = times(tour, problem)
    if tour.poses:
        found["poses"] = list(tour.poses)
    return found


def text(tour: Tour, problem: TourProblem) -> RenderableType:
    """The tour as a list of runs with one tool each, and a summary line."""
    if not tour.order:
        return Text("nothing to visit")
    rows = []
    for tool, names in _runs(tour, problem):
        rest = f", and {len(names) - SHOWN} more (--format json has all)" if len(names) > SHOWN else ""
        shown = ", ".join(names[:SHOWN]) + rest
        rows.append((tool or "-", str(len(names)), shown))
    runs = TextTable(("tool", "visits", "in order"), rows)
    return Group(runs, *_timetable(tour, problem), Text(summary(tour, problem)))


def times(tour: Tour, problem: TourProblem) -> list[dict[str, Any]]:
    """For each visit in order: when the arm arrives, begins and ends, its window, and its slack."""
    made = []
    slacks = slack_of(problem, tour.order)
    for at, (arrives, begins), slack in zip(tour.order, times_of(problem, tour.order), slacks, strict=True):
        visit = problem.visits[at]
        ends = begins + visit.duration
        row: dict[str, Any] = {"visit": visit.name, "arrives": arrives, "begins": begins, "ends": ends}
        if visit.window is not None:
            row["window"] = [visit.window[0], None if visit.window[1] >= ENDLESS else visit.window[1]]
        made.append(row | {"slack": slack if slack < ENDLESS // 2 else None})
    return made


def _timetable(tour: Tour, problem: TourProblem) -> list[RenderableType]:
    """The times of all visits, if there are windows or durations."""
    if not (problem.timed or any(visit.duration for visit in problem.visits)):
        return []
    rows = [
        (
            each["visit"],
            str(each["arrives"]),
            str(each["begins"]),
            str(each["ends"]),
            _window(each.get("window")),
            "-" if each["slack"] is None else str(each["slack"]),
        )
        for each in times(tour, problem)
    ]
    return [TextTable(("visit", "arrives", "begins", "ends", "window", "slack"), rows)]


def _window(ends: list[int | None] | None) -> str:
    return "-" if ends is None else f"{ends[0]}..{'' if ends[1] is None else ends[1]}"


def time_entry(time: int | None, unit: str) -> dict[str, Any]:
    """How long the ways of a tour between visits by the same tool take, for JSON; empty if no travel is declared."""
    return {} if time is None else {"travel_time": time, "time_unit": unit}


def time_text(time: int | None, unit: str) -> list[RenderableType]:
    """The same for people."""
    return [] if time is None else [Text(f"the ways between visits by the same tool take {time} {unit}")]


def summary(tour: Tour, problem: TourProblem) -> str:
    """One line: the number of visits, the cost, and its quality."""
    kind = "closed" if problem.closed else "open"
    good = "proved least" if tour.proved else f"at most {100 * tour.gap:.2f} % above the least"
    bound = "no lower bound"
    if tour.gap != float("inf"):
        bound = f"lower bound {_cost(tour.lower_bound, problem.unit)}: {good}"
    return f"{len(tour.order)} visits, {kind}, cost {_cost(tour.cost, problem.unit)}, {bound}"


def _cost(cost: int, unit: str) -> str:
    """A cost as people say it: millionths of a metre or of a second as metres or seconds."""
    return f"{cost / 1e6:.3f} {unit[1:]}" if unit.startswith("µ") else f"{cost} {unit}".strip()


def _runs(tour: Tour, problem: TourProblem) -> list[tuple[str, list[str]]]:
    runs: list[tuple[str, list[str]]] = []
    for each in tour.order:
        visit = problem.visits[each]
        if not runs or runs[-1][0] != visit.tool:
            runs.append((visit.tool, []))
        runs[-1][1].append(visit.name)
    return runs
