"""What belongs to a choice is found in every view, and what commands print is shown as a
terminal would.
"""

from pathlib import Path

import pytest

from cellwright.engine.faces.monitor.chosen_item import names_any, related_texts, steps_of, told_of
from cellwright.engine.faces.monitor.run_charts import belief_chart
from cellwright.engine.faces.monitor.run_follower import WatchedRun
from cellwright.engine.faces.monitor.shared_state import SharedState, terminal_text
from cellwright.engine.model.run_protocol import JournalRecord, RecordKind

PLAN = {
    "why": "first", "forecast_ms": 9, "goals": ["hot(a)"], "given_up": [], "order": [1, 2],
    "steps": [
        {"id": 1, "step": "pick(a)", "stream": "arm", "adds": ["held(a)"], "ends": ["free"]},
        {"id": 2, "step": "heat(a)", "stream": "oven", "after": [1], "events": ["hot(a)"]},
    ],
}  # fmt: skip


@pytest.fixture
def run() -> WatchedRun:
    made = WatchedRun("monday", holds={"free": 0})
    made.take(JournalRecord(1, 0, RecordKind.PLAN, PLAN))
    return made


def test_a_step_brings_its_facts_along_and_a_fact_its_steps(run: WatchedRun) -> None:
    assert related_texts(run, "pick(a)") == {"pick(a)", "held(a)", "free"}
    assert related_texts(run, "held(a)") == {"held(a)", "pick(a)"}
    assert related_texts(run, "") == frozenset()
    assert steps_of(run, "a") == {"pick(a)", "heat(a)"}
    assert steps_of(run, "hot(a)") == {"heat(a)"}


def test_a_name_is_found_as_a_whole_word_only() -> None:
    assert names_any(["probe_1"], ["pick(probe_1, slot)"])
    assert not names_any(["probe_1"], ["pick(probe_12, slot)"])
    assert not names_any(["a"], ["heat(ab)"])


def test_a_choice_is_told(run: WatchedRun) -> None:
    assert "waits for: pick(a)" in told_of(run, "heat(a)")
    assert told_of(run, "pick(a)")[0] == "step 1, planned, begins 0 s"
    assert "brings: hot(a)" in told_of(run, "heat(a)")
    assert "held at the start" in told_of(run, "free")
    assert told_of(run, "") == []


@pytest.mark.parametrize(
    ("raw", "seen"),
    [
        ("planning 1/3\rplanning 2/3", "planning 2/3"),
        ("one\r\ntwo\r\n", "one\ntwo"),
        ("\x1b[2Kplanning \x1b[31m3/3\x1b[0m\r", "planning 3/3"),
        ("\x1b]0;title\x07<b>", "0;title<b>"),
    ],
)
def test_a_progress_bar_is_shown_as_it_was_written_last(raw: str, seen: str) -> None:
    assert terminal_text(raw) == seen


@pytest.mark.parametrize("words", ["", "run themse/one", "results", "sh -c ls", "plan; ls"])
def test_only_long_work_is_begun(tmp_path: Path, words: str) -> None:
    shared = SharedState(str(tmp_path / "runs.db"))
    assert shared.order("k", {"order": "work", "text": words})[0] == 400
    assert not shared.jobs


@pytest.mark.slow
def test_a_run_starts_with_what_is_asked_for_and_nothing_that_begins_with_a_dash_is_an_option(
    tmp_path: Path,
) -> None:
    shared = SharedState(str(tmp_path / "runs.db"))
    status, told = shared.order("a", {"order": "start", "target": "--help"})
    assert status == 409
    assert "--help" in told["said"]
    status, told = shared.order(
        "b", {"order": "start", "run": "x; ls", "target": "themse/one", "approve": "yes"}
    )
    assert (status, told["open"]) == (200, "/run/x%3B%20ls")
    assert shared.order("c", {"order": "stop", "run": "x; ls"})[0] == 200


def test_beliefs_are_drawn_test_by_test_and_escaped() -> None:
    findings = [
        {"action": "look(<b>)", "belief": [["<i>", 0.25], ["worn", 0.75]]},
        {"exception": "cold", "causes": [["worn", 1.0]]},
    ]
    drawn = belief_chart(findings)
    assert "<i>" not in drawn
    assert drawn.count("100 %") == 2  # on the bar and in its title
