"""Measurements that several arms share, for people and programs."""

from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.rows import TextTable
from cellwright.engine.model.wording import counted

if TYPE_CHECKING:
    from cellwright.engine.pipelines.parts import Shared

SHOWN = 12  # measurements of one arm that are named


def entry(found: "Shared", bound: bool = True) -> dict[str, Any]:
    """The shares, for JSON, with the `bound` if it is known. Times are in the unit that is given: a unit of time, or micrometres where nobody knows how fast arms are."""
    return {
        "arms": {
            arm: {
                "visits": list(own),
                "tools": [found.tools[name] for name in own],
                "busy": found.lasts(found.shares.busy[arm]),
                "each": found.measuring[arm],
            }
            for arm, own in found.shares.orders.items()
        },
        "common": found.shares.common,
        "makespan": found.lasts(found.shares.makespan),
        "lower_bound": found.lasts(found.shares.lower_bound) if bound else None,
        "unit": found.unit,
        "waits": [list(pair) for pair in found.waits],
    }


def text(found: "Shared", listed: bool = True) -> RenderableType:
    """A table of the arms with their measurements in order, if they are to be `listed`, and a summary."""
    shares = found.shares
    rows = []
    for arm, own in shares.orders.items():
        rest = f", and {len(own) - SHOWN} more (--format json has all)" if len(own) > SHOWN else ""
        busy = f"{found.lasts(shares.busy[arm])}"
        rows.append((arm, str(len(own)), busy, ", ".join(own[:SHOWN]) + rest if own else "-"))
    heads = ("arm", "measurements", f"busy ({found.unit})", "in order")
    table = TextTable(heads, rows, right=heads[1:3])
    said = [summary(found)]
    if found.waits:
        pairs = "; ".join(f"{second} waits for {first}" for first, second in found.waits[:SHOWN])
        more = f"; {len(found.waits) - SHOWN} more" if len(found.waits) > SHOWN else ""
        said.append(f"Of different arms, {pairs}{more}.")
    return Group(*([table] if listed else []), *map(Text, said))


def summary(found: "Shared") -> str:
    """What the shares take, and what no way to share them is below."""
    shares, unit = found.shares, found.unit
    count = counted(sum(map(len, shares.orders.values())), "measurement")
    most, bound = found.lasts(shares.makespan), found.lasts(shares.lower_bound)
    gap = (
        "proved to be the least" if most <= bound else f"no way to share them takes less than {bound} {unit}"
    )
    gap = f", {gap}" if bound else ""
    common = (
        f"{shares.common} of them within reach of more than one"
        if shares.common
        else "each within reach of one"
    )
    waiting = ", without waiting for each other" if found.waits else ""
    if len(shares.orders) == 1:
        return f"{next(iter(shares.orders))} makes {count}: {most} {unit} by the times of the tour{gap}"
    return f"{len(shares.orders)} arms share {count}, {common}: {most} {unit} by the times of the tours{waiting}{gap}"
