"""A run that is followed stands, at each of its records, as its records tell."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from cellwright.engine.faces.monitor.run_charts import gantt_chart, run_chart
from cellwright.engine.faces.monitor.run_follower import (
    RECORDS_BETWEEN_STATES,
    RunFollower,
    WatchedRun,
    first_difference,
    journal_record,
)
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.journal import Journal, JournalLine

PLAN = {
    "why": "first", "forecast_ms": 20_000, "goals": ["hot(a)", "cold(b)"], "given_up": [["cold(b)", "no "
    "ice"]],
    "steps": [
        {"id": 1, "step": "pick(a)", "stream": "arm", "start_ms": 0, "lasts_ms": 8_000},
        {"id": 2, "step": "heat(a)", "stream": "oven "
        "<b>", "start_ms": 8_000, "lasts_ms": 12_000, "after": [1]},
    ],
}  # fmt: skip
STEP = {"command_kind": "step", "lasts_ms": 8_000}
ASK = {
    "command": 3,
    "command_kind": "ask",
    "stream": "person",
    "action": "?",
    "asks": True,
    "lasts_ms": 0,
}
LINES = [
    JournalLine(1, 0, "run", {}),
    JournalLine(2, 0, "plan", PLAN),
    JournalLine(3, 0, "command", {**STEP, "command": 1, "stream": "arm", "action": "pick(a)", "step": 1}),
    JournalLine(4, 9_000, "reply", {"command": 1, "text": "done"}),
    JournalLine(5, 9_000, "done", {"step": 1, "command": 1, "action": "pick(a)", "started_ms": 0, "adds": ["held(a)"], "ends": ["free"]}),
    JournalLine(6, 9_000, "result", {"command": 1, "action": "pick(a)", "result": "", "of": "a", "quantity": "mass", "value": 3.0}),
    JournalLine(7, 9_100, "command", ASK),
    JournalLine(8, 9_200, "exception", {"exception": "cold", "step": 2, "action": "heat(a)", "reply": "cold", "command": 2}),
    JournalLine(9, 9_300, "goal", {"goal": "hot(a)"}),
]  # fmt: skip


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    with Journal(str(tmp_path / "runs.db")) as made:
        made.begin("monday", "2026-11-22", {})
        yield made


def test_a_run_stands_as_its_records_tell(journal: Journal) -> None:
    journal.append("monday", LINES)
    follower = RunFollower(journal.target, "monday", ["free", "at(a, table)"])
    assert follower.refresh() == len(LINES)
    run = follower.latest
    assert run.holds == {"at(a, table)": 0, "held(a)": 5}
    assert run.goals == {"hot(a)": "reached", "cold(b)": "no ice"}
    assert list(run.questions) == [3]
    assert [each["value"] for each in run.results] == [3.0]
    assert {number: bar.standing for number, bar in run.bars.items()} == {1: "done", 2: "failed"}
    assert follower.exceptions() == [8]


def test_a_run_that_was_approved_is_running_once_it_is_told_to_do_something(
    journal: Journal,
) -> None:
    ready = JournalLine(3, 0, "phase", {"phase": "ready", "why": "waits for approval"})
    approved = JournalLine(4, 0, "order", {"order": "approve", "given": "", "origin": "socket"})
    journal.append("monday", [*LINES[:2], ready, approved])
    follower = RunFollower(journal.target, "monday")
    follower.refresh()
    assert follower.latest.phase == "ready"
    journal.append("monday", [JournalLine(5, 0, "command", LINES[2].content)])
    follower.refresh()
    assert follower.latest.phase == "running"


def test_going_back_gives_what_was_then(journal: Journal) -> None:
    many = [
        JournalLine(10 + n, 10_000 + n, "done", {
            "step": 1, "command": 1, "action": "pick(a)", "started_ms": 0, "adds": [f"n({n})"], "ends": [f"n({n - 1})"],
        })
        for n in range(2 * RECORDS_BETWEEN_STATES)
    ]  # fmt: skip
    journal.append("monday", [*LINES, *many])
    follower = RunFollower(journal.target, "monday")
    follower.refresh()
    for number in (
        0,
        1,
        9,
        RECORDS_BETWEEN_STATES - 1,
        RECORDS_BETWEEN_STATES,
        RECORDS_BETWEEN_STATES + 1,
        2 * RECORDS_BETWEEN_STATES,
        len(follower.records),
    ):
        plain = WatchedRun("monday")
        for record in follower.records[:number]:
            plain.take(record)
        assert follower.at(number) == plain


def test_what_comes_later_is_read_and_nothing_twice(journal: Journal) -> None:
    follower = RunFollower(journal.target, "monday")
    counts = []
    for line in LINES:
        journal.append("monday", [line])
        counts.append(follower.refresh())
    assert counts == [1] * len(LINES)
    assert follower.refresh() == 0


def test_an_unknown_run_is_told_with_the_name_that_was_meant(journal: Journal) -> None:
    with pytest.raises(InvalidInput) as refused:
        RunFollower(journal.target, "mondy")
    assert refused.value.diagnostics[0].code == "K421"
    assert "monday" in str(refused.value.diagnostics[0].hint)


def test_the_first_difference_of_two_runs_is_found() -> None:
    records = [journal_record(line) for line in LINES]
    other = [
        *records[:4],
        journal_record(JournalLine(5, 9_500, "done", {**LINES[4].content, "adds": []})),
        *records[5:],
    ]
    later = [
        journal_record(JournalLine(line.number, line.at_ms + 70, line.kind, line.content))
        for line in LINES
    ]
    assert first_difference(records, later) == 0
    assert first_difference(records, other) == 5
    assert first_difference(records, records[:6]) == 7


def test_pictures_show_steps_with_signs_and_escape_names(journal: Journal) -> None:
    journal.append("monday", LINES)
    follower = RunFollower(journal.target, "monday")
    follower.refresh()
    drawn = gantt_chart(follower.latest, 9_300, "pick(a)")
    assert "oven &lt;b&gt;" in drawn
    assert "<b>" not in drawn
    assert "✓" in drawn
    assert "✗" in drawn
    assert "now 9.3 s" in drawn
    assert drawn.count('class="bar chosen"') == 1


def test_a_run_chart_marks_what_failed_by_its_shape() -> None:
    values = [
        {"value": v, "lower": 1.0, "nominal": 2.0, "upper": 3.0, "passed": v <= 3.0}
        for v in (2.0, 4.0)
    ]
    drawn = run_chart(values)
    assert drawn.count("<circle") == 1
    assert drawn.count("<rect") == 1
