"""How goals stand that are facts: the monitor reads that from what holds."""

import pytest

pytest.importorskip("nicegui")

from cellwright.engine.faces.monitor.run_follower import GoalIndex, WatchedRun
from cellwright.engine.model.run_protocol import JournalRecord, RecordKind

GOALS = [
    "measured(_, _, meas(m1))",
    "measured(_, _, meas(m10))",
    "at(bolt, bin)",
    "at(_, shelf)",
    "not lit",
    "lit",
]


def test_a_fact_meets_the_goals_that_it_is_an_instance_of() -> None:
    index = GoalIndex.of([*GOALS, "heated(probe_1, 900) of 1:probe_1", ""])
    assert index.met_by("measured(t3, slra, meas(m1))") == ["measured(_, _, meas(m1))"]
    assert index.met_by("measured(t3, slra, meas(m2))") == []
    assert index.met_by("at(bolt, shelf)") == ["at(_, shelf)"]
    assert index.met_by("lit") == ["lit"]
    assert index.met_by("measured(m1)") == []


def test_goals_are_reached_as_long_as_some_fact_meets_them() -> None:
    run = WatchedRun("r")
    run.planned({"goals": GOALS, "given_up": [["at(bolt, bin)", "the bin is lost"]]}, record(1))

    def stands(goal: str, *, ends: tuple[str, ...] = (), adds: tuple[str, ...] = ()) -> str:
        run.become({"ends": ends, "adds": adds}, record(2))
        return run.goals[goal]

    assert stands("measured(_, _, meas(m1))", adds=("measured(t3, slra, meas(m1))",)) == "reached"
    assert stands("measured(_, _, meas(m10))") == "open"
    assert stands("at(_, shelf)", adds=("at(bolt, shelf)", "at(nut, shelf)")) == "reached"
    assert stands("at(_, shelf)", ends=("at(bolt, shelf)",)) == "reached"
    assert stands("at(_, shelf)", ends=("at(nut, shelf)",)) == "open"
    assert stands("at(bolt, bin)", adds=("at(bolt, bin)",)) == "the bin is lost"


def record(number: int) -> JournalRecord:
    return JournalRecord(number, 0, RecordKind.WORLD, {})
