"""Controllers in other processes: whatever one does, each command ends, or the loss is told in
time.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchmarks.controllers import Lines, Manners, Server, at_reply
from cellwright.engine.model.outcome import Outcome
from cellwright.engine.model.run_protocol import (
    CommandKind,
    DriverCommand,
    Fate,
    JournalRecord,
    RecordKind,
    Reply,
    Trouble,
)
from cellwright.engine.pipelines.execution import RunRequest, begin_run
from cellwright.engine.pipelines.execution.controllers import ControllerDriver
from cellwright.engine.pipelines.execution.controllers.conformance import check_conformance
from cellwright.engine.pipelines.execution.controllers.link import ControllerAddress, Patience
from cellwright.engine.pipelines.execution.controllers.reference_controller import ServedCell
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, first_plan
from cellwright.engine.pipelines.execution.operator_orders import TimedOrders
from cellwright.engine.pipelines.execution.run_start import name_run
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.ports import DriverSetup
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load
from cellwright.kb.model.planning_problem import Problem

CELL = Path(__file__).parents[3] / "domains" / "capping" / "problems" / "no_caps.yaml"
HURRY = Patience(5, 2, 0.2, 1.5)


@pytest.fixture(scope="module")
def planned() -> tuple[Problem, Outcome]:
    problem = load(CELL).problem
    assert problem is not None
    return problem, checked_plan.plan_problem(problem)


@pytest.fixture
def problem(planned: tuple[Problem, Outcome]) -> Problem:
    return planned[0]


@pytest.fixture
def run(
    planned: tuple[Problem, Outcome], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[Manners], tuple[str, list[JournalRecord]]]]:
    """Run the plan with a controller of some manners: how it ended, and the journal."""
    servers: list[Server] = []

    def runs(manners: Manners) -> tuple[str, list[JournalRecord]]:
        problem, outcome = planned
        servers.append(Server(problem, manners))
        wanted = RunRequest(str(CELL), store=str(tmp_path / "runs.db"), run="tried")
        wanted = name_run(wanted, problem)
        made = ControllerDriver(servers[0].place, HURRY, "tried")
        monkeypatch.setattr(sys.modules[name_run.__module__], "make_driver", lambda *_: made)
        records: list[JournalRecord] = []
        ending = begin_run(
            wanted, problem, TimedOrders(), [records.append], SearchLimits(), outcome
        )
        return ending.outcome, records  # type: ignore[union-attr]

    yield runs
    for each in servers:
        each.close()


def told(records: list[JournalRecord], kind: RecordKind, key: str) -> list[str]:
    return [record.content[key] for record in records if record.kind is kind]


def test_a_controller_that_behaves_reaches_the_goals(
    run: Callable[[Manners], tuple[str, list[JournalRecord]]],
) -> None:
    outcome, records = run(lambda _, lines: lines)
    assert outcome == "reached"
    assert told(records, RecordKind.TROUBLE, "trouble") == []


@pytest.mark.parametrize(
    ("instead", "trouble"),
    [
        (lambda line: [line, line], "repeated"),
        (lambda line: [b'{"type": "reply", "number": 999, "text": "done"}\n', line], "strange"),
        (lambda line: [b"\xff\xfe{{{\n", line], "garbage"),
        (lambda line: [b'{"type": "reply", "number": 4}\n', line], "garbage"),
        (lambda line: [b'{"type": "dance"}\n', line], "garbage"),
        (lambda line: [b"[" * 100_000 + b"\n", line], "garbage"),
    ],
)
def test_nonsense_beside_a_reply_is_told_and_changes_nothing(
    run: Callable[[Manners], tuple[str, list[JournalRecord]]],
    instead: Callable[[bytes], Lines],
    trouble: str,
) -> None:
    outcome, records = run(at_reply(4, instead))
    assert outcome == "reached"
    assert told(records, RecordKind.TROUBLE, "trouble") == [trouble]


@pytest.mark.parametrize("instead", [lambda _: [], lambda _: [b"garbage\n"]])
def test_a_command_without_a_reply_is_an_exception_at_its_timeout(
    run: Callable[[Manners], tuple[str, list[JournalRecord]]], instead: Callable[[bytes], Lines]
) -> None:
    _, records = run(at_reply(3, instead))
    given_up = next(each for each in records if each.kind is RecordKind.EXCEPTION)
    assert (given_up.content["command"], given_up.content["reply"]) == (3, "timeout")
    sent = next(
        each for each in records if each.kind is RecordKind.COMMAND and each.content["command"] == 3
    )
    quiet = next(
        each
        for each in records
        if each.kind is RecordKind.PHASE and each.content["phase"] == "quiescing"
    )
    assert quiet.at_ms <= sent.at_ms + sent.content["timeout_ms"] + 1000


@pytest.mark.parametrize("instead", [lambda _: [], lambda _: [b"garbage\n"]])
def test_a_lost_reply_is_found_out_by_asking_the_controller(
    run: Callable[[Manners], tuple[str, list[JournalRecord]]], instead: Callable[[bytes], Lines]
) -> None:
    outcome, records = run(at_reply(3, instead))
    assert outcome == "reached"
    (made,) = [each.content for each in records if each.kind is RecordKind.DIAGNOSIS]
    assert made["causes"] == [["the reply was lost", 1.0]]
    done = [each.content["action"] for each in records if each.kind is RecordKind.DONE]
    assert len(done) == len({*done})


def test_a_controller_that_hangs_is_lost_in_time(
    run: Callable[[Manners], tuple[str, list[JournalRecord]]],
) -> None:
    begun = time.monotonic()
    outcome, records = run(lambda heard, lines: lines if heard < 8 else [])
    assert outcome == "stopped"
    assert told(records, RecordKind.TROUBLE, "trouble")[-1] == "lost"
    assert time.monotonic() - begun < 20


def test_a_connection_that_breaks_is_made_again_and_nothing_is_done_twice(
    run: Callable[[Manners], tuple[str, list[JournalRecord]]],
) -> None:
    outcome, records = run(lambda heard, lines: lines if heard not in (6, 11, 12) else None)
    assert outcome == "reached"
    done = told(records, RecordKind.DONE, "command")
    assert len(done) == len({*done})


def _command(number: int, problem: Problem) -> DriverCommand:
    found = first_plan(problem)
    assert isinstance(found, ReadyPlan)
    steps = sorted(
        found.compiled.program.activities.values(), key=lambda each: (each.start_ms, each.id)
    )
    a = steps[number - 1]
    return DriverCommand(
        number,
        CommandKind.STEP,
        a.stream,
        a.action,
        a.says,
        a.expects,
        (),
        a.lasts_ms,
        a.timeout_ms,
    )


def test_a_reply_after_the_timeout_is_late(problem: Problem) -> None:
    def late(_: int, lines: Lines) -> Lines:
        return [each.replace(b'"at_ms": 60000', b'"at_ms": 9999999') for each in lines]

    server = Server(problem, late)
    driver = ControllerDriver(server.place, HURRY, "late")
    driver.send([_command(1, problem)])
    came = driver.receive(None)
    driver.close()
    server.close()
    assert [each.kind.value for each in came if isinstance(each, Trouble)] == ["late"]


def test_bulk_data_comes_in_parts_before_the_reply(problem: Problem) -> None:
    part = (
        json.dumps(
            {"type": "part", "number": 1, "name": "depth_map", "text": "AAAA" * 100_000}
        ).encode()
        + b"\n"
    )
    server = Server(problem, at_reply(1, lambda line: [part, part, line]))
    driver = ControllerDriver(server.place, HURRY, "bulk")
    driver.send([_command(1, problem)])
    (reply,) = driver.receive(None)
    driver.close()
    server.close()
    assert isinstance(reply, Reply)
    assert reply.data["depth_map"] == "AAAA" * 200_000


def test_a_command_sent_again_under_its_number_is_carried_out_once(
    problem: Problem, tmp_path: Path
) -> None:
    log = tmp_path / "cell.log"
    server = Server(problem, log=str(log))
    for _ in range(2):
        driver = ControllerDriver(server.place, HURRY, "again")
        driver.send([_command(1, problem)])
        driver.receive(None)
        assert [each.fate for each in driver.report([1, 2])] == [Fate.ENDED, Fate.UNKNOWN]
        driver.close()
    server.close()
    assert sum('"ended": 1' in line for line in log.read_text().splitlines()) == 1


def test_a_real_clock_goes_on_and_replies_come_by_themselves(problem: Problem) -> None:
    from cellwright.engine.pipelines.execution.controllers import reference_controller

    cell = ServedCell(DriverSetup(problem, "", 0, 0.0005))
    simulator = cell.serve("real")
    simulator.send([_command(1, problem)])
    time.sleep(0.1)
    assert [each.number for each in cell.elapsed()] == [1]
    assert reference_controller.BEAT_S < 1


def test_the_reference_controller_conforms(problem: Problem) -> None:
    server = Server(problem)
    options = {"address": f"127.0.0.1:{server.place.port}", "heartbeat": "1"}
    found = check_conformance(
        DriverSetup(problem, "conformance", options=options),
        [_command(n, problem) for n in (1, 2, 3)],
    )
    server.close()
    assert [each for each in found if each.wrong] == []
    assert len(found) == 12


def test_conformance_names_what_a_controller_does_wrong(problem: Problem) -> None:
    server = Server(problem, at_reply(2, lambda _: []))
    options = {"address": f"127.0.0.1:{server.place.port}"}
    found = check_conformance(
        DriverSetup(problem, "conformance", options=options),
        [_command(n, problem) for n in (1, 2, 3)],
    )
    server.close()
    assert any("replies once" in each.point and each.wrong == "no reply came" for each in found)


@pytest.mark.parametrize(
    "options",
    [{}, {"address": "nowhere"}, {"address": "a:99999"}, {"command": "a", "address": "b:1"}, {"speed": "9"},
     {"command": "a", "answer": "soon"}, {"command": "a", "heartbeat": "nan"}],
)  # fmt: skip
def test_options_that_name_no_controller_are_refused(
    problem: Problem, options: dict[str, str]
) -> None:
    from cellwright.engine.pipelines.execution.controllers import external_controller

    with pytest.raises(InvalidInput):
        external_controller(DriverSetup(problem, "none", options=options))


def test_a_controller_that_is_not_there_is_told() -> None:
    with pytest.raises(InvalidInput, match="K425"):
        ControllerDriver(ControllerAddress("this-program-does-not-exist"), HURRY, "none")
