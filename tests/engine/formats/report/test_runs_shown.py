"""Runs in plain lines and as a live display: both follow from the records of the journal."""

import io

from rich.console import Console

from cellwright.engine.formats.report.runs.run_display import RunDisplay, share_lines
from cellwright.engine.formats.report.runs.run_report import narrate_record
from cellwright.engine.model.run_protocol import JournalRecord, RecordKind

PLAN = {
    "why": "first", "forecast_ms": 20_000, "goals": [],
    "steps": [
        {"id": 1, "step": "pick(a)", "stream": "arm", "start_ms": 0, "lasts_ms": 8_000},
        {"id": 2, "step": "heat(a)", "stream": "furnace", "start_ms": 8_000, "lasts_ms": 12_000},
    ],
}  # fmt: skip
COMMAND = {"command_kind": "step", "lasts_ms": 8_000}
RECORDS = [
    JournalRecord(1, 0, RecordKind.PLAN, PLAN),
    JournalRecord(2, 0, RecordKind.COMMAND, {**COMMAND, "command": 1, "stream": "arm", "action": "pick(a)", "step": 1}),
    JournalRecord(3, 9_000, RecordKind.REPLY, {"command": 1, "text": "done"}),
    JournalRecord(4, 9_000, RecordKind.DONE,
           {"step": 1, "command": 1, "action": "pick(a)", "started_ms": 0, "adds": ["held(a)"], "ends": ["free"]}),
    JournalRecord(5, 9_000, RecordKind.COMMAND, {**COMMAND, "command": 2, "stream": "furnace", "action": "heat(a)", "step": 2}),
]  # fmt: skip
FAILED = [
    JournalRecord(6, 15_000, RecordKind.REPLY, {"command": 2, "text": "cold"}),
    JournalRecord(7, 15_000, RecordKind.EXCEPTION, {"exception": "too_cold", "step": 2, "action": "heat(a)", "reply": "cold"}),
    JournalRecord(8, 16_000, RecordKind.FINDING, {"action": "read_power", "outcome": "none"}),
    JournalRecord(9, 17_000, RecordKind.DIAGNOSIS, {"causes": [["power_off", 0.97], ["broken", 0.001]], "cured": "switch_on"}),
    JournalRecord(10, 17_000, RecordKind.END, {"outcome": "reached", "why": ""}),
]  # fmt: skip


def shown(
    records: list[JournalRecord], width: int = 80, passed_ms: float = 0.0, height: int = 60
) -> str:
    display = RunDisplay("monday-1", passed_ms=lambda: passed_ms)
    for record in records:
        display.take(record)
    out = io.StringIO()
    Console(file=out, width=width, height=height, color_system=None).print(display)
    return out.getvalue()


def test_the_display_shows_current_steps_chart_changes_and_log() -> None:
    text = shown(RECORDS)
    assert "monday-1: running, 9 s of about 20 s" in text
    assert "1 step done, 2 in the plan" in text
    current = text.partition("current step")[2]
    assert "furnace" in current
    assert "heat(a)" in current
    assert "pick(a)" not in text
    assert "+ held(a)" in text
    assert "- free" in text
    assert "Planned and scheduled: 2 steps on 2 devices" in text


def test_the_line_at_now_moves_between_records() -> None:
    first, later = shown(RECORDS), shown(RECORDS, passed_ms=6_000)
    at = [
        next(line for line in text.splitlines() if "| now" in line).index("|", 5)
        for text in (first, later)
    ]
    assert at[0] < at[1]
    assert "15 s of about 20 s" in later


def test_a_step_that_failed_is_seen_in_the_chart_and_its_cause_in_the_log() -> None:
    text = shown(RECORDS + FAILED)
    assert "XXX" in text
    assert "EXCEPTION too_cold: heat(a): cold" in text
    assert "diagnosed: power_off (97 %); put right by switch_on" in text


def test_the_display_fits_any_terminal() -> None:
    for width in (30, 50, 200):
        assert all(len(line) <= width for line in shown(RECORDS + FAILED, width).splitlines())


def test_a_low_terminal_keeps_the_keys_the_steps_and_the_end_of_the_log() -> None:
    for height in (18, 20, 24):
        lines = shown(RECORDS + FAILED, 80, height=height).splitlines()
        assert len(lines) < height
        assert "s stop" in lines[-1]
        assert "all goals are reached" in lines[-2]


def test_pausing_twice_goes_on_also_before_the_run_has_heard_it() -> None:
    display = RunDisplay("monday-1")
    assert [display.toggled(), display.toggled(), display.toggled()] == [
        "interrupt",
        "continue",
        "interrupt",
    ]
    display.take(JournalRecord(1, 0, RecordKind.PHASE, {"phase": "paused", "why": ""}))
    assert display.toggled() == "continue"


def test_lines_are_shared_in_turn() -> None:
    assert share_lines(5, (8, 1, 6)) == [2, 1, 2]
    assert share_lines(99, (8, 1, 6)) == [8, 1, 6]
    assert share_lines(-1, (8, 1, 6)) == [0, 0, 0]


def test_every_line_that_is_told_is_short_and_plain() -> None:
    lines = [line for record in RECORDS + FAILED for line in narrate_record(record)]
    assert lines[-1] == "17 s: all goals are reached"
    assert all("\n" not in line for line in lines)


def test_the_display_shows_when_the_next_steps_begin_as_far_as_that_can_be_said() -> None:
    lasts = [8_000, 12_000, 900_000, 5_000]
    steps = [
        {"id": n, "step": f"step_{n}", "stream": "arm", "after": [n - 1] if n > 1 else [], "lasts_ms": each,
         "start_ms": sum(lasts[: n - 1])}
        for n, each in enumerate(lasts, 1)
    ]  # fmt: skip
    text = shown(
        [JournalRecord(1, 0, RecordKind.PLAN, {**PLAN, "steps": steps})], width=100
    ).partition("next step")[2]
    lines = {
        each: next(line for line in text.splitlines() if each in line)
        for each in ("step_1", "step_3", "step_4")
    }
    assert "0 s" in lines["step_1"]
    assert "s sooner or later" in lines["step_3"]
    assert "later" in lines["step_4"]
    assert "sooner" not in lines["step_4"]
