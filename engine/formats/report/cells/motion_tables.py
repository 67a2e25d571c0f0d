"""Tables of many motions: travel times between places, and replayed problem sets."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.text_tables import TextTable
from cellwright.engine.pipelines.motion.problem_sets import ReplayedAnswer
from cellwright.engine.pipelines.motion.travel_times import TravelTable


def travel_entry(travel_times: TravelTable, unit_s: float) -> dict[str, Any]:
    """Travel times for JSON, in s; null where no path was found."""
    times = [[float(t) if np.isfinite(t) else None for t in row] for row in travel_times.times_s]
    return {
        "tool": travel_times.tool,
        "places": list(travel_times.names),
        "times_s": times,
        "least_s": travel_times.least_s.tolist(),
        "planned": travel_times.planned,
        "unreached": travel_times.unreached,
        "facts": travel_times.facts(unit_s),
    }


def travel_table(travel_times: TravelTable) -> RenderableType:
    """Travel times for people, in s."""
    rows = [
        (name, *("" if i == j else _travel_time(t) for j, t in enumerate(row)))
        for i, (name, row) in enumerate(zip(travel_times.names, travel_times.times_s, strict=True))
    ]
    has_time = np.isfinite(travel_times.times_s) & ~np.eye(len(travel_times.names), dtype=bool)
    over = (travel_times.times_s - travel_times.least_s)[has_time]
    bound_note = (
        f"Seconds; at most {over.max(initial=0.0):.2f} s more than the least that any path can "
        "take."
    )
    left_out_lines = [
        Text(f"{name} is left out: {why}") for name, why in travel_times.unreached.items()
    ]
    return Group(
        TextTable(("from", *travel_times.names), rows, right=travel_times.names),
        Text(bound_note),
        *left_out_lines,
    )


def _travel_time(t: float) -> str:
    return f"{t:.2f}" if np.isfinite(t) else "none"


def replay_entry(replayed_problems: Sequence[ReplayedAnswer]) -> dict[str, Any]:
    """Replayed problems for JSON, in the form of a problem set: it can be replayed again."""
    return {
        "problems": [
            {
                "from": replayed_problem.problem.start,
                "to": replayed_problem.problem.goal,
                "answer": replayed_problem.content,
                "duration_s": replayed_problem.duration_s,
                "proved": replayed_problem.proved,
                "looked": replayed_problem.looked,
                "same": replayed_problem.same,
            }
            for replayed_problem in replayed_problems
        ]
    }


def _short_end(end: str) -> str:
    """An end of a problem with four digits of each number; the set and JSON have all of them."""
    return re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.4g}", end)


def replay_table(replayed_problems: Sequence[ReplayedAnswer]) -> RenderableType:
    """Replayed problems for people."""
    rows = [
        (
            str(n + 1),
            replayed_problem.status,
            f"{replayed_problem.duration_s:.2f}" if replayed_problem.status == "found" else "",
            f"{replayed_problem.looked}",
            {None: "", True: "same", False: "CHANGED"}[replayed_problem.same],
            _short_end(replayed_problem.problem.start),
            _short_end(replayed_problem.problem.goal),
        )
        for n, replayed_problem in enumerate(replayed_problems)
    ]
    counts = {
        status: sum(replayed_problem.status == status for replayed_problem in replayed_problems)
        for status in sorted({f.status for f in replayed_problems})
    }
    summary_parts = [", ".join(f"{count} {status}" for status, count in counts.items())]
    summary_parts.append(
        f"{sum(replayed_problem.proved for replayed_problem in replayed_problems)} proved"
    )
    saved = [
        replayed_problem.same
        for replayed_problem in replayed_problems
        if replayed_problem.same is not None
    ]
    summary_parts += [f"{sum(saved)} of {len(saved)} as saved"] if saved else []
    headings = ("", "status", "s", "looked", "", "from", "to")
    return Group(
        TextTable(headings, rows, right=("", "s", "looked")), Text("; ".join(summary_parts))
    )
