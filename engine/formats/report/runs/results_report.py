"""Results of a run as tables: what was measured, and what was done to each object."""

from collections.abc import Collection, Iterator, Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.runs.run_report import clock_time
from cellwright.engine.formats.report.text_tables import TextTable
from cellwright.engine.model.noun_wording import count_noun
from cellwright.kb.model.measured_results import Measured, Results, Treated

VERDICT_WORDS = {True: "passed", False: "FAILED", None: "not judged"}
MEASURED_HEAD = ("measured", "quantity", "value", "nominal", "from", "to", "", "by", "at")
HISTORY_HEAD = ("object", "from", "to", "step", "brought")
NUMBER_COLUMNS = ("from", "to", "at")
MIN_SHOWN_STEPS = 40  # steps of histories that are shown in any case
SEVERAL = 8  # names that are listed


def results_text(results: Results, subjects: Collection[str] | None = None) -> RenderableType:
    """The results for a terminal: what was measured, and the histories of some objects; of all
    without `subjects`.

    Histories of other objects are shown as well if they are short.
    """
    return Group(*_result_parts(results, subjects))


def _result_parts(results: Results, subjects: Collection[str] | None) -> Iterator[RenderableType]:
    if results.measured:
        yield TextTable(
            MEASURED_HEAD,
            [_measured_row(measured_value) for measured_value in results.measured],
            NUMBER_COLUMNS,
        )
        yield Text(_verdict_counts(results.measured))
    else:
        yield Text("Nothing was measured.")
    whole = subjects is None or len(results.history) <= MIN_SHOWN_STEPS
    shown = [
        treatment for treatment in results.history if whole or treatment.object in (subjects or ())
    ]
    if shown:
        yield Text("")
        yield TextTable(HISTORY_HEAD, list(_history_rows(shown)), NUMBER_COLUMNS)
    if more := {treatment.object for treatment in results.history} - {
        treatment.object for treatment in shown
    }:
        yield Text(f"--history also shows what was done to {_names_or_count(sorted(more))}")


def _names_or_count(names: Sequence[str]) -> str:
    """Names, or how many there are."""
    return ", ".join(names) if len(names) <= SEVERAL else f"{len(names)} objects"


def _measured_row(measured_value: Measured) -> tuple[str, ...]:
    limits = tuple(
        _measured_number(value)
        for value in (measured_value.nominal, measured_value.lower, measured_value.upper)
    )
    value = f"{_measured_number(measured_value.value)} {measured_value.unit}"
    return (
        measured_value.of,
        measured_value.quantity,
        value,
        *limits,
        VERDICT_WORDS[measured_value.passed],
        measured_value.tool,
        clock_time(measured_value.at_ms),
    )


def _measured_number(value: float | None) -> str:
    return "" if value is None else f"{value:g}" if abs(value) < 1e5 else f"{value:.0f}"


def _verdict_counts(measured: Sequence[Measured]) -> str:
    verdicts = [measured_value.passed for measured_value in measured]
    parts = [
        f"{verdicts.count(True)} passed",
        f"{verdicts.count(False)} failed",
        f"{verdicts.count(None)} not judged",
    ]
    counts_text = ", ".join(part for part in parts if not part.startswith("0 "))
    return f"{count_noun(len(measured), 'measured value')}: {counts_text}"


def _history_rows(history: Sequence[Treated]) -> Iterator[tuple[str, ...]]:
    """The history of one object after another; each is named once."""
    last = ""
    for treatment in sorted(
        history, key=lambda history_record: (history_record.object, history_record.started_ms)
    ):
        name = treatment.object if treatment.object != last else ""
        last = treatment.object
        yield (
            name,
            clock_time(treatment.started_ms),
            clock_time(treatment.ended_ms),
            treatment.action,
            ", ".join(treatment.changes),
        )
