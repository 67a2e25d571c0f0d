"""Whatever a controller sends, a run ends right or stops safely, and each thing is noted once."""

import json
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis.strategies import integers

from benchmarks.controllers import Lines, Manners, Server, at_reply
from cellwright.engine.model.outcome import Outcome
from cellwright.engine.model.run_protocol import (
    CommandKind,
    DriverCommand,
    Fate,
    Finish,
    JournalRecord,
    Message,
    RecordKind,
    Reply,
    Report,
    TroubleKind,
)
from cellwright.engine.pipelines.execution import RunRequest, begin_run
from cellwright.engine.pipelines.execution.controllers import ControllerDriver
from cellwright.engine.pipelines.execution.controllers.link import Patience
from cellwright.engine.pipelines.execution.controllers.protocol import (
    MAX_TIME_MS,
    MalformedLine,
    read_line,
    read_ready,
)
from cellwright.engine.pipelines.execution.controllers.remote_driver import PendingCommands
from cellwright.engine.pipelines.execution.operator_orders import TimedOrders
from cellwright.engine.pipelines.execution.run_start import name_run
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load
from cellwright.kb.model.planning_problem import Problem

CAPPING = Path(__file__).parents[3] / "domains" / "capping"
HURRY = Patience(5, 2, 0.2, 1.5)
Run = Callable[[Manners], tuple[Finish, list[JournalRecord]]]


@pytest.fixture(scope="module")
def planned() -> tuple[Problem, Outcome]:
    problem = load(CAPPING / "problems" / "no_caps.yaml").problem
    assert problem is not None
    return problem, checked_plan.plan_problem(problem)


def started(
    problem: Problem, outcome: Outcome, server: Server, store: str, monkeypatch: pytest.MonkeyPatch
) -> tuple[Finish, list[JournalRecord]]:
    target = str(CAPPING / "problems" / "no_caps.yaml")
    wanted = name_run(RunRequest(target, store=store, run="tried"), problem)
    driver = ControllerDriver(server.place, HURRY, "tried")
    monkeypatch.setattr(sys.modules[name_run.__module__], "make_driver", lambda *_: driver)
    records: list[JournalRecord] = []
    ending = begin_run(wanted, problem, TimedOrders(), [records.append], SearchLimits(), outcome)
    assert isinstance(ending, Finish)
    return ending, records


@pytest.fixture
def run(
    planned: tuple[Problem, Outcome], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Run]:
    servers: list[Server] = []

    def runs(manners: Manners) -> tuple[Finish, list[JournalRecord]]:
        problem, outcome = planned
        servers.append(Server(problem, manners))
        return started(problem, outcome, servers[0], str(tmp_path / "runs.db"), monkeypatch)

    yield runs
    for server in servers:
        server.close()


def troubles(records: list[JournalRecord]) -> list[str]:
    return [record.content["trouble"] for record in records if record.kind is RecordKind.TROUBLE]


def changed(**changes: Any) -> Callable[[bytes], Lines]:
    """A line with other values, and then the right one."""
    return lambda text: [json.dumps({**json.loads(text), **changes}).encode() + b"\n", text]


def out_of_bounds(text: bytes) -> Lines:
    """Lines with something that cannot be, and then the right one."""
    changes: list[dict[str, Any]] = [
        {"at_ms": float("nan")},
        {"at_ms": 10**15},
        {"at_ms": -1},
        {"number": True},
        {"number": 10**12},
        {"text": "x" * 20_000},
        {"data": {"a": [{"b": float("inf")}]}},
    ]
    lines = [changed(**change)(text)[0] for change in changes]
    lines += [b'{"type":"reply","data":{"a":1e999}}\n']
    lines += [
        b'{"type":"reply","data":[' + b"[]," * 200_000 + b"0]}\n",
        b"z" * (17 * 2**20) + b"\n",
    ]
    return [*lines, text]


def test_what_is_out_of_bounds_is_noted_and_changes_nothing(run: Run) -> None:
    ending, records = run(at_reply(3, out_of_bounds))
    assert ending.outcome == "reached"
    assert set(troubles(records)) == {"garbage"}
    assert 7 <= len(troubles(records)) <= 10


def test_a_reply_from_before_its_command_has_the_time_at_which_it_came(run: Run) -> None:
    ending, records = run(at_reply(3, lambda text: changed(at_ms=0)(text)[:1]))
    assert (ending.outcome, troubles(records)) == ("reached", ["clock"])


def test_unknown_keys_of_replies_are_ignored_also_a_number_of_a_question(run: Run) -> None:
    ids = iter(range(1, 10_000))

    def with_id(_: int, lines: Lines) -> Lines:
        return [
            json.dumps({**json.loads(text), "id": next(ids)}).encode() + b"\n"
            if b'"reply"' in text
            else text
            for text in lines
        ]

    ending, records = run(with_id)
    assert (ending.outcome, troubles(records)) == ("reached", [])


def test_what_comes_again_is_counted(run: Run) -> None:
    ending, records = run(at_reply(3, lambda text: [*[b"garbage\n"] * 500, text]))
    assert ending.outcome == "reached"
    texts = [r.content["text"] for r in records if r.kind is RecordKind.TROUBLE]
    assert [text.partition(";")[0] for text in texts] == [
        "a line that is no JSON: garbage",
        "499 more like these",
    ]


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (b"garbage\n", "lines that say nothing"),
        (b'{"type": "reply", "number": 77, "text": "done"}\n', "lines that say nothing"),
    ],
)
def test_a_stream_without_end_stops_the_run(run: Run, line: bytes, why: str) -> None:
    ending, records = run(at_reply(3, lambda text: [*[line] * 10_500, text]))
    assert ending.outcome == "stopped"
    assert why in ending.why
    assert len(troubles(records)) < 10


@pytest.mark.parametrize("step_ms", [0, 1])
def test_a_virtual_clock_that_gets_nowhere_ends_the_run(run: Run, step_ms: int) -> None:
    asked: list[int] = []

    def stuck(_: int, lines: Lines) -> Lines:
        content = json.loads(lines[-1]) if lines else {}
        if content.get("type") != "advanced":
            return lines
        asked.append(1)
        return [json.dumps({**content, "now_ms": step_ms * len(asked)}).encode() + b"\n"]

    ending, _ = run(stuck)
    assert (ending.outcome, "its clock gets nowhere" in ending.why) == ("stopped", True)
    assert len(asked) < 200


def test_a_controller_that_hangs_up_again_and_again_is_given_up(run: Run) -> None:
    ending, records = run(lambda heard, lines: lines if heard < 6 or heard % 2 else None)
    assert ending.outcome == "stopped"
    assert troubles(records)[-1] == "lost"


@pytest.mark.parametrize(
    "changes",
    [
        {"tick_ms": 0},
        {"tick_ms": 10**9},
        {"tick_ms": True},
        {"now_ms": -1},
        {"now_ms": MAX_TIME_MS + 1},
        {"lookahead": {"default": 0}},
        {"lookahead": {"default": True}},
        {"lookahead": {str(n): 1 for n in range(10_001)}},
        {"version": True},
        {"clock": "sundial"},
    ],
)
def test_a_controller_says_of_itself_what_can_be(changes: dict[str, Any]) -> None:
    ready = {"type": "ready", "version": 1, "now_ms": 0, "clock": "real", "tick_ms": 50}
    assert read_ready(ready).tick_ms == 50
    with pytest.raises(MalformedLine):
        read_ready({**ready, **changes})


@given(integers(-(2**70), 2**70))
def test_a_time_is_taken_if_it_is_within_bounds(time_ms: int) -> None:
    ready = {"version": 1, "clock": "virtual", "now_ms": time_ms}
    if 0 <= time_ms <= MAX_TIME_MS:
        assert read_ready(ready).now_ms == time_ms
    else:
        with pytest.raises(MalformedLine):
            read_ready(ready)


@pytest.mark.parametrize("number", ["NaN", "-Infinity", "1e999", "9" * 41])
def test_a_number_in_a_line_is_finite_and_short(number: str) -> None:
    with pytest.raises(MalformedLine):
        read_line(b'{"type": "reply", "data": {"a": [%s]}}' % number.encode())


def step(number: int, kind: CommandKind = CommandKind.STEP, **more: Any) -> DriverCommand:
    return DriverCommand(number, kind, "arm", f"s{number}", **more)


def replies(messages: list[Message]) -> list[int]:
    return [message.number for message in messages if isinstance(message, Reply)]


def test_a_reply_from_behind_a_wait_counts_when_the_wait_is_over() -> None:
    pending = PendingCommands(lambda _: 4, virtual=True)
    pending.fresh([step(1), step(2, CommandKind.WAIT), step(3)], 0)
    pending.replied(Reply(1, "done", 1), 1)
    pending.replied(Reply(2, "waiting", 1), 1)
    pending.replied(Reply(3, "done", 2), 2)
    first = pending.given()
    assert replies(first) == [1, 2]
    assert [m.kind for m in first if not isinstance(m, Reply)] == [TroubleKind.STRANGE]
    pending.fresh([step(4, CommandKind.CONTINUE, about=2)], 3)
    assert replies(pending.given()) == [3]


def test_replies_that_waited_are_given_when_the_queue_is_dropped() -> None:
    pending = PendingCommands(lambda _: 4, virtual=True)
    pending.fresh([step(1), step(2)], 0)
    pending.replied(Reply(2, "done", 1), 1)
    assert replies(pending.given()) == []
    pending.release_all()
    assert replies(pending.given()) == [2]


def test_a_command_of_which_nobody_knows_the_end_has_a_reply_of_its_own() -> None:
    assert Report(3, Fate.UNSURE).answer(9) == Reply(3, "outcome_unknown", 9)
    assert Report(3, Fate.RUNNING).answer(9) is None


def forgetful(_: int, lines: Lines) -> Lines | None:
    """It hangs up in place of the third reply, and knows then only that the command began."""
    contents = [json.loads(text) for text in lines]
    if any(c["type"] == "reply" and c["number"] == 3 for c in contents):
        return None
    for content in contents:
        for report in content.get("reports", ()):
            if report["number"] == 3:
                report |= {"fate": "unsure"}
                report.pop("reply", None)
    return [json.dumps(content).encode() + b"\n" for content in contents]


def test_a_step_of_which_nobody_knows_the_end_is_neither_done_nor_taken_again(run: Run) -> None:
    ending, records = run(forgetful)
    assert ending.outcome == "stopped"
    assert "outcome_unknown" in ending.why
    (action,) = [
        r.content["action"]
        for r in records
        if r.kind is RecordKind.COMMAND and r.content["command"] == 3
    ]
    sent = [r.content["action"] for r in records if r.kind is RecordKind.COMMAND]
    assert sent.count(action) == 1
    assert action not in [r.content["action"] for r in records if r.kind is RecordKind.DONE]


def test_the_fault_base_says_how_to_look_when_nobody_knows_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    domain = tmp_path / "capping"
    shutil.copytree(CAPPING, domain)
    faults = domain / "faults.yaml"
    faults.write_text(
        faults.read_text("utf-8").replace(
            "exceptions:\n",
            "exceptions:\n  not_sure:\n    say: nobody knows whether the step was done\n"
            "    reply: outcome_unknown\n    causes: {splinter: 1, no_air: 1}\n",
            1,
        ),
        "utf-8",
    )
    problem = load(domain / "problems" / "no_caps.yaml").problem
    assert problem is not None
    server = Server(problem, forgetful)
    outcome = checked_plan.plan_problem(problem)
    _, records = started(problem, outcome, server, str(tmp_path / "runs.db"), monkeypatch)
    server.close()
    (first, *_) = [r.content for r in records if r.kind is RecordKind.EXCEPTION]
    assert (first["exception"], first["known"]) == ("not_sure", True)
    assert any(r.kind is RecordKind.FINDING for r in records)


def test_a_controller_whose_greeting_cannot_be_used_is_told_to_halt(
    planned: tuple[Problem, Outcome],
) -> None:
    heard: list[str] = []

    def odd(_: int, lines: Lines) -> Lines:
        heard.extend(json.loads(text)["type"] for text in lines)
        return [text.replace(b'"now_ms": 0', b'"now_ms": -7') for text in lines]

    server = Server(planned[0], odd)
    with pytest.raises(InvalidInput, match="K425"):
        ControllerDriver(server.place, HURRY, "odd")
    server.close()
    assert heard == ["ready", "halted"]


def test_a_greeting_that_cannot_be_read_is_not_waited_for_as_for_a_controller_that_begins(
    planned: tuple[Problem, Outcome],
) -> None:
    server = Server(planned[0], lambda _, lines: [b"nonsense\n"] * len(lines))
    patience = Patience(begin_s=3_600, answer_s=0.2, heartbeat_s=1, reconnect_s=0)
    with pytest.raises(InvalidInput, match="K425"):
        ControllerDriver(server.place, patience, "odd")
    server.close()
