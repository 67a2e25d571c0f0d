"""Results for a terminal: what was measured, what was done to what is processed, and how to see
the rest.
"""

import io

from rich.console import Console, RenderableType

from cellwright.engine.formats.report.runs.results_report import MIN_SHOWN_STEPS, results_text
from cellwright.kb.model.measured_results import Measured, Results, Treated

VALUE = Measured(
    "m1", "thickness", 4993.0, "um", 5000.0, 4900.0, 5100.0, "us_probe", at_ms=1_707_400
)
LONG = tuple(
    Treated("drawer", f"open({n})", 1000 * n, 1000 * n + 500) for n in range(MIN_SHOWN_STEPS)
)
HEATED = Treated("probe_1", "heat(probe_1, 900)", 28_000, 928_000, ("heated(probe_1, 900)",))


def printed(made: RenderableType) -> str:
    console = Console(width=80, file=io.StringIO())
    console.print(made)
    file = console.file
    assert isinstance(file, io.StringIO)
    return file.getvalue()


def test_times_of_day_long_runs_are_read_at_a_glance() -> None:
    assert "0:28:27" in printed(results_text(Results("run", measured=(VALUE,))))


def test_histories_of_what_is_processed_are_shown_and_the_others_are_told() -> None:
    said = printed(results_text(Results("run", history=(*LONG, HEATED)), ("probe_1",)))
    assert "heat(probe_1, 900)" in said
    assert "open(3)" not in said
    assert "--history also shows what was done to drawer" in said


def test_all_histories_are_shown_if_asked_for_or_if_they_are_short() -> None:
    assert "open(3)" in printed(results_text(Results("run", history=(*LONG, HEATED))))
    short = printed(results_text(Results("run", history=LONG[:5]), ("probe_1",)))
    assert "open(3)" in short
    assert "--history" not in short
