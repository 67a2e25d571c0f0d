"""Tours for people and programs: a table, a JSON entry, and a picture coloured by tool."""

from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from engine.formats.report.rows import TextTable
from engine.model.tour import Tour, TourProblem

SHOWN = 40
SIZE, MARGIN = 800.0, 20.0
COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#7f7f7f")


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
    if tour.poses:
        found["poses"] = list(tour.poses)
    return found


def text(tour: Tour, problem: TourProblem) -> RenderableType:
    """The tour as a list of runs with one tool each, and a summary line."""
    if not tour.order:
        return Text("nothing to visit")
    rows = []
    for tool, names in _runs(tour, problem):
        shown = ", ".join(names[:SHOWN]) + (f", and {len(names) - SHOWN} more" if len(names) > SHOWN else "")
        rows.append((tool or "-", str(len(names)), shown))
    return Group(TextTable(("tool", "visits", "in order"), rows), Text(summary(tour, problem)))


def summary(tour: Tour, problem: TourProblem) -> str:
    """One line: the number of visits, the cost, and its quality."""
    kind, unit = "closed" if problem.closed else "open", f" {problem.unit}" if problem.unit else ""
    good = "proved least" if tour.proved else f"at most {100 * tour.gap:.2f} % above the least"
    bound = "no lower bound" if tour.gap == float("inf") else f"lower bound {tour.lower_bound}: {good}"
    return f"{len(tour.order)} visits, {kind}, cost {tour.cost}{unit}, {bound}"


def _runs(tour: Tour, problem: TourProblem) -> list[tuple[str, list[str]]]:
    runs: list[tuple[str, list[str]]] = []
    for each in tour.order:
        visit = problem.visits[each]
        if not runs or runs[-1][0] != visit.tool:
            runs.append((visit.tool, []))
        runs[-1][1].append(visit.name)
    return runs


def svg(tour: Tour, problem: TourProblem) -> str | None:
    """The tour seen from above, one colour for each tool; None if some visit has no position."""
    places = [problem.visits[each].position for each in tour.order]
    if not places or any(place is None for place in places):
        return None
    flat = [(place[0], place[1]) for place in places if place is not None]
    low = [min(place[axis] for place in flat) for axis in (0, 1)]
    span = max(max(place[axis] for place in flat) - low[axis] for axis in (0, 1)) or 1.0
    scale = (SIZE - 2 * MARGIN) / span
    at = [(MARGIN + (x - low[0]) * scale, SIZE - MARGIN - (y - low[1]) * scale) for x, y in flat]
    tools = sorted({visit.tool for visit in problem.visits})
    colour = {tool: COLOURS[index % len(COLOURS)] for index, tool in enumerate(tools)}
    named = [problem.visits[each] for each in tour.order]
    ends = list(zip(at, at[1:] + (at[:1] if problem.closed else []), strict=False))
    lines = [
        f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}" stroke="{colour[visit.tool]}"/>'
        for (a, b), visit in zip(ends, named, strict=False)
    ]
    dots = [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2" fill="{colour[visit.tool]}"><title>{_safe(visit.name)}</title></circle>'
        for (x, y), visit in zip(at, named, strict=True)
    ]
    keys = [
        f'<text x="{MARGIN:.0f}" y="{MARGIN + 16 * index:.0f}" font-size="14" fill="{colour[tool]}">{_safe(tool)}</text>'
        for index, tool in enumerate(tools)
        if tool
    ]
    size = f"{SIZE:.0f}"
    frame = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size} {size}" width="{size}" height="{size}">'
    )
    return "\n".join([frame, *lines, *dots, *keys, "</svg>\n"])


def _safe(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
