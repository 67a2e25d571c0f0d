"""The results of a run as tables: what was measured, and what was done to each object."""

from collections.abc import Iterator, Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from engine.formats.report.execution import duration
from engine.formats.report.rows import TextTable
from engine.model.wording import counted
from kb.model.results import Measured, Results, Treated

VERDICTS = {True: "passed", False: "FAILED", None: "not judged"}


def text(results: Results) -> RenderableType:
    """The results for a terminal."""
    return Group(*_parts(results))


def _parts(results: Results) -> Iterator[RenderableType]:
    if results.measured:
        head = ("measured", "quantity", "value", "nominal", "from", "to", "", "by", "at")
        yield TextTable(head, [_row(each) for each in results.measured])
        yield Text(_counts(results.measured))
    else:
        yield Text("Nothing was measured.")
    if results.history:
        yield Text("")
        yield TextTable(("object", "from", "to", "step", "brought"), list(_histories(results.history)))


def _row(each: Measured) -> tuple[str, ...]:
    limits = tuple(_number(value) for value in (each.nominal, each.lower, each.upper))
    value = f"{_number(each.value)} {each.unit}"
    return (each.of, each.quantity, value, *limits, VERDICTS[each.passed], each.tool, duration(each.at_ms))


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:g}" if abs(value) < 1e5 else f"{value:.0f}"


def _counts(measured: Sequence[Measured]) -> str:
    verdicts = [each.passed for each in measured]
    parts = [
        f"{verdicts.count(True)} passed",
        f"{verdicts.count(False)} failed",
        f"{verdicts.count(None)} not judged",
    ]
    said = ", ".join(part for part in parts if not part.startswith("0 "))
    return f"{counted(len(measured), 'measured value')}: {said}"


def _histories(history: Sequence[Treated]) -> Iterator[tuple[str, ...]]:
    """The history of one object after another; each is named once."""
    last = ""
    for each in sorted(history, key=lambda one: (one.object, one.started_ms)):
        name = each.object if each.object != last else ""
        last = each.object
        yield (name, duration(each.started_ms), duration(each.ended_ms), each.action, ", ".join(each.changes))
