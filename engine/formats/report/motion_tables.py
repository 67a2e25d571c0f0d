"""Tables about many motions: travel times between places, and replayed problem sets."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.rows import TextTable
from cellwright.engine.pipelines.motion.problems import Replayed
from cellwright.engine.pipelines.motion.table import Table


def travel_entry(found: Table, unit_s: float) -> dict[str, Any]:
    """Travel times for JSON, in s; null where no path was found."""
    times = [[float(t) if np.isfinite(t) else None for t in row] for row in found.times_s]
    return {
        "tool": found.tool,
        "places": list(found.names),
        "times_s": times,
        "least_s": found.least_s.tolist(),
        "planned": found.planned,
        "unreached": found.unreached,
        "facts": found.facts(unit_s),
    }


def travel(found: Table) -> RenderableType:
    """Travel times for people, in s."""
    rows = [
        (name, *("" if i == j else _time(t) for j, t in enumerate(row)))
        for i, (name, row) in enumerate(zip(found.names, found.times_s, strict=True))
    ]
    known = np.isfinite(found.times_s) & ~np.eye(len(found.names), dtype=bool)
    over = (found.times_s - found.least_s)[known]
    said = f"Seconds; at most {over.max(initial=0.0):.2f} s more than the least that any path can take."
    left = [Text(f"{name} is left out: {why}") for name, why in found.unreached.items()]
    return Group(TextTable(("from", *found.names), rows, right=found.names), Text(said), *left)


def _time(t: float) -> str:
    return f"{t:.2f}" if np.isfinite(t) else "none"


def replay_entry(found: Sequence[Replayed]) -> dict[str, Any]:
    """Replayed problems for JSON, in the form of a problem set: it can be replayed again."""
    return {
        "problems": [
            {
                "from": each.problem.start,
                "to": each.problem.goal,
                "answer": each.content,
                "duration_s": each.duration_s,
                "proved": each.proved,
                "looked": each.looked,
                "same": each.same,
            }
            for each in found
        ]
    }


def _short(end: str) -> str:
    """An end of a problem with four digits of each number; the set and JSON have all of them."""
    return re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.4g}", end)


def replay(found: Sequence[Replayed]) -> RenderableType:
    """Replayed problems for people."""
    rows = [
        (
            str(n + 1),
            each.status,
            f"{each.duration_s:.2f}" if each.status == "found" else "",
            f"{each.looked}",
            {None: "", True: "same", False: "CHANGED"}[each.same],
            _short(each.problem.start),
            _short(each.problem.goal),
        )
        for n, each in enumerate(found)
    ]
    counts = {
        status: sum(each.status == status for each in found) for status in sorted({f.status for f in found})
    }
    told = [", ".join(f"{count} {status}" for status, count in counts.items())]
    told.append(f"{sum(each.proved for each in found)} proved")
    saved = [each.same for each in found if each.same is not None]
    told += [f"{sum(saved)} of {len(saved)} as saved"] if saved else []
    headings = ("", "status", "s", "looked", "", "from", "to")
    return Group(TextTable(headings, rows, right=("", "s", "looked")), Text("; ".join(told)))
