"""What the arm has met is shown from the record on that tells of it, until a fact says where it
is.
"""

import pytest

pytest.importorskip("nicegui")

from cellwright.engine.faces.monitor.run_follower import WatchedRun
from cellwright.engine.model.run_protocol import JournalRecord, RecordKind

CRATE = {"at": [0.5, 0.0, 0.2], "rpy": [0.0, 0.0, 0.0], "box": [0.06, 0.06, 0.4]}


def world(number: int, **bodies: dict[str, list[float]] | None) -> JournalRecord:
    content = {"why": "seen", "adds": [], "ends": [], "reached": {}, "bodies": bodies}
    return JournalRecord(number, 0, RecordKind.WORLD, content)


def test_a_body_is_met_until_a_fact_says_where_it_is() -> None:
    run = WatchedRun("r")
    run.take(world(1, crate=CRATE))
    before = run.copied()
    assert run.met == {"crate": CRATE}
    run.take(world(2, crate=None))
    assert run.met == {}
    assert before.met == {"crate": CRATE}


def test_a_step_that_was_stopped_is_known() -> None:
    run = WatchedRun("r")
    for number, text in ((4, "obstructed"), (5, "done")):
        run.take(
            JournalRecord(
                number, 0, RecordKind.REPLY, {"command": number, "text": text, "data": {}}
            )
        )
    assert run.stopped == {4}
