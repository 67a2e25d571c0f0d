"""Orders reach the run that they are for, from another process or thread, with who gave them
and when.
"""

import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from cellwright.engine.model.run_protocol import JournalRecord, OperatorCommand, RecordKind
from cellwright.engine.pipelines.execution import GivenOrder
from cellwright.engine.pipelines.execution.run_socket import (
    OrderChannel,
    going_on,
    socket_address,
    tell_run,
)
from cellwright.kb.diagnostics import InvalidInput


@pytest.fixture(autouse=True)
def own_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with tempfile.TemporaryDirectory() as place:  # with a short name: that of a socket is bounded
        monkeypatch.setenv("XDG_RUNTIME_DIR", place)
        yield


def test_a_folder_with_a_long_name_is_passed_by(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/" + 100 * "x")
    assert len(str(socket_address("a" * 200, "b" * 200))) < 107


def test_two_runs_of_one_name_in_two_stores_go_on_side_by_side(tmp_path: Path) -> None:
    first, second = str(tmp_path / "a.db"), str(tmp_path / "b.db")
    with OrderChannel("monday", first) as one, OrderChannel("monday", second) as two:
        tell_run("monday", "stop", store=second)
        assert ([*one.due(0)], [each.order for each in two.due(0)]) == ([], [OperatorCommand.STOP])
        assert sorted(each["store"] for each in going_on()) == [first, second]
        with pytest.raises(InvalidInput, match="2 runs with the name monday") as refused:
            tell_run("monday", "stop")
        assert first in refused.value.diagnostics[0].hint
    assert going_on() == ()


def test_one_run_of_a_name_needs_no_store_and_the_same_run_is_refused_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cellwright.engine.pipelines.execution.run_socket.ANSWERED_S", 0.01)
    store = str(tmp_path / "a.db")
    with OrderChannel("monday", store) as one:
        tell_run("monday", "skip", "pick(probe_1)", who="Ada")
        with (
            pytest.raises(InvalidInput, match="goes on in another process"),
            OrderChannel("monday", store),
        ):
            pass
        (given,) = one.due(0)
    assert (given.order, given.text, given.origin, given.who) == (
        OperatorCommand.SKIP,
        "pick(probe_1)",
        "socket",
        "Ada",
    )
    assert given.when.endswith("+00:00")
    with pytest.raises(InvalidInput, match="does not go on"):
        tell_run("monday", "stop")


def test_an_order_of_this_process_says_who_and_when() -> None:
    channel = OrderChannel("monday")
    channel.give(GivenOrder(OperatorCommand.STOP))
    (given,) = channel.due(0)
    assert given.who
    assert given.content()["when"]


@pytest.mark.parametrize("run", ["x" * 400, "über/..", "a b", "\u0000"])
def test_the_path_of_a_socket_is_short_and_plain(run: str) -> None:
    assert len(socket_address(run, "s.db").name) < 60
    assert socket_address(run).parent == socket_address("other").parent
    assert socket_address(run, "s.db") != socket_address(run + "x", "s.db")


@pytest.mark.parametrize(
    ("kind", "content", "refused"),
    [
        (
            RecordKind.DECISION,
            {"what": "skip refused", "why": "the plan has no step 99"},
            "the plan has no step 99",
        ),
        (RecordKind.PLAN, {"why": "skip"}, ""),
        (RecordKind.PLAN, {"why": "recovery"}, None),
    ],
)
def test_a_caller_is_told_what_came_of_an_order(
    monkeypatch: pytest.MonkeyPatch, kind: RecordKind, content: dict[str, str], refused: str | None
) -> None:
    monkeypatch.setattr(
        "cellwright.engine.pipelines.execution.run_socket.ANSWERED_S", 0.3 if refused is None else 3
    )
    with OrderChannel("monday") as one, ThreadPoolExecutor(1) as other:
        told = other.submit(tell_run, "monday", "skip", "99")
        while not one.due(0):
            pass
        one.watch(
            JournalRecord(
                1, 0, RecordKind.DECISION, {"what": "skip refused", "why": "of another order"}
            )
        )
        one.watch(JournalRecord(2, 0, RecordKind.ORDER, {"order": "skip", "given": "99"}))
        one.watch(JournalRecord(3, 0, kind, content))
        assert told.result().get("refused") == refused


def test_a_stop_does_not_wait_until_another_order_is_answered() -> None:
    with OrderChannel("monday") as one, ThreadPoolExecutor(1) as other:
        told = other.submit(tell_run, "monday", "add", "process probe_2")
        while not (came := one.due(0)):
            pass
        tell_run("monday", "stop")
        came = [*came, *one.due(0)]
        assert [each.order for each in came] == [OperatorCommand.ADD, OperatorCommand.STOP]
        assert not told.done()
        one.watch(JournalRecord(1, 0, RecordKind.ORDER, {"order": "add"}))
        one.watch(JournalRecord(2, 0, RecordKind.PLAN, {"why": "add"}))
        assert told.result()["refused"] == ""
