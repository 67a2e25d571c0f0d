"""Orders reach the run that they are for, from another process or thread, with who gave them and when."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from engine.model.execution import Order
from engine.pipelines.execution import Given
from engine.pipelines.execution.channel import Channel, address, going_on, tell
from kb.diagnostics import InvalidInput


@pytest.fixture(autouse=True)
def own_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with tempfile.TemporaryDirectory() as place:  # with a short name: that of a socket is bounded
        monkeypatch.setenv("XDG_RUNTIME_DIR", place)
        yield


def test_a_folder_with_a_long_name_is_passed_by(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/" + 100 * "x")
    assert len(str(address("a" * 200, "b" * 200))) < 107


def test_two_runs_of_one_name_in_two_stores_go_on_side_by_side(tmp_path: Path) -> None:
    first, second = str(tmp_path / "a.db"), str(tmp_path / "b.db")
    with Channel("monday", first) as one, Channel("monday", second) as two:
        tell("monday", "stop", store=second)
        assert ([*one.due(0)], [each.order for each in two.due(0)]) == ([], [Order.STOP])
        assert sorted(each["store"] for each in going_on()) == [first, second]
        with pytest.raises(InvalidInput, match="2 runs with the name monday") as refused:
            tell("monday", "stop")
        assert first in refused.value.diagnostics[0].hint
    assert going_on() == ()


def test_one_run_of_a_name_needs_no_store_and_the_same_run_is_refused_twice(tmp_path: Path) -> None:
    store = str(tmp_path / "a.db")
    with Channel("monday", store) as one:
        tell("monday", "skip", "pick(probe_1)", who="Ada")
        with pytest.raises(InvalidInput, match="goes on in another process"), Channel("monday", store):
            pass
        (given,) = one.due(0)
    assert (given.order, given.text, given.origin, given.who) == (
        Order.SKIP,
        "pick(probe_1)",
        "socket",
        "Ada",
    )
    assert given.when.endswith("+00:00")
    with pytest.raises(InvalidInput, match="does not go on"):
        tell("monday", "stop")


def test_an_order_of_this_process_says_who_and_when() -> None:
    channel = Channel("monday")
    channel.give(Given(Order.STOP))
    (given,) = channel.due(0)
    assert given.who
    assert given.content()["when"]


@pytest.mark.parametrize("run", ["x" * 400, "über/..", "a b", "\u0000"])
def test_the_path_of_a_socket_is_short_and_plain(run: str) -> None:
    assert len(address(run, "s.db").name) < 60
    assert address(run).parent == address("other").parent
    assert address(run, "s.db") != address(run + "x", "s.db")
