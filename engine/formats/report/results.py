"""The results of a run as tables: what was measured, and what was done to each object."""

from collections.abc import Collection, Iterator, Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.execution import clock
from cellwright.engine.formats.report.rows import TextTable
from cellwright.engine.model.wording import counted
from cellwright.kb.model.results import Measured, Results, Treated

VERDICTS = {True: "passed", False: "FAILED", None: "not judged"}
MEASURED = ("measured", "quantity", "value", "nominal", "from", "to", "", "by", "at")
HISTORY = ("object", "from", "to", "step", "brought")
RIGHT = ("from", "to", "at")
FEW = 40  # steps of histories that are shown in any case
SEVERAL = 8  # names that are listed


def text(results: Results, subjects: Collection[str] | None = None) -> RenderableType:
    """The results for a terminal: what was measured, and the histories of some objects; of all without `subjects`.

    Histories of other objects are shown as well if they are short.
    """
    return Group(*_parts(results, subjects))


def _parts(results: Results, subjects: Collection[str] | None) -> Iterator[RenderableType]:
    if results.measured:
        yield TextTable(MEASURED, [_row(each) for each in results.measured], RIGHT)
        yield Text(_counts(results.measured))
    else:
        yield Text("Nothing was measured.")
    whole = subjects is None or len(results.history) <= FEW
    shown = [each for each in results.history if whole or each.object in (subjects or ())]
    if shown:
        yield Text("")
        yield TextTable(HISTORY, list(_histories(shown)), RIGHT)
    if more := {each.object for each in results.history} - {each.object for each in shown}:
        yield Text(f"--history also shows what was done to {_some(sorted(more))}")


def _some(names: Sequence[str]) -> str:
    """Names, or how many there are."""
    return ", ".join(names) if len(names) <= SEVERAL else f"{len(names)} objects"


def _row(each: Measured) -> tuple[str, ...]:
    limits = tuple(_number(value) for value in (each.nominal, each.lower, each.upper))
    value = f"{_number(each.value)} {each.unit}"
    return (each.of, each.quantity, value, *limits, VERDICTS[each.passed], each.tool, clock(each.at_ms))


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
        yield (name, clock(each.started_ms), clock(each.ended_ms), each.action, ", ".join(each.changes))
