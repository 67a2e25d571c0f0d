"""From a journal that cannot be proved whole, nothing is asked of a driver and nothing is sent."""

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from cellwright.engine.model.run_protocol import OperatorCommand
from cellwright.engine.pipelines.execution import (
    GivenOrder,
    RunRequest,
    TimedOrders,
    begin_run,
    name_run,
    results_of,
    resume_run,
)
from cellwright.kb.diagnostics import InvalidInput
from tests.engine.pipelines.execution.executed_cells import BEGIN, planned


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The journal of a run that was stopped on its way."""
    store = tmp_path_factory.mktemp("stopped") / "j.db"
    problem, _ = planned("themse/one")
    wanted = name_run(RunRequest("themse/one", store=str(store), run="r"), problem)
    ending = begin_run(wanted, problem, TimedOrders([(20_000, GivenOrder(OperatorCommand.STOP))]))
    assert ending.outcome == "stopped"
    return store


def damages(store: Path) -> list[str]:
    """One statement for each field of the first line of each kind, and gaps and cuts."""
    with closing(sqlite3.connect(store)) as connection:
        firsts = connection.execute("SELECT min(number) FROM journal GROUP BY kind").fetchall()
        (last,) = connection.execute("SELECT max(number) FROM journal").fetchone()
    edits = [
        f"UPDATE journal SET {field} = {value} WHERE number = {number}"
        for (number,) in firsts
        for field, value in (
            ("at_ms", "at_ms + 1"),
            ("at_ms", "-5"),
            ("kind", "'nosuch'"),
            ("content", "'{}'"),
            ("content", "replace(content, '1', '2') || ' '"),
            ("number", "number + 1000"),
        )
    ]
    gaps = [f"DELETE FROM journal WHERE number = {number}" for number in range(1, last + 1, 7)]
    cuts = [f"DELETE FROM journal WHERE number > {number}" for number in range(0, last, 9)]
    return [*edits, *gaps, *cuts]


def test_nothing_is_sent_for_any_of_them(
    stopped: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("a driver was made")

    monkeypatch.setattr(BEGIN, "make_driver", never)
    statements = damages(stopped)
    assert len(statements) > 30
    for statement in statements:
        store = str(shutil.copy(stopped, tmp_path / "j.db"))
        with closing(sqlite3.connect(store)) as connection, connection:
            connection.execute(statement)
        with pytest.raises(InvalidInput) as told:
            resume_run(store, "r", TimedOrders())
        assert told.value.diagnostics[0].code == "K422", statement
        with pytest.raises(InvalidInput, match="K422"):
            results_of(store, "r")


def test_what_is_whole_goes_on(stopped: Path, tmp_path: Path) -> None:
    store = str(shutil.copy(stopped, tmp_path / "j.db"))
    assert resume_run(store, "r", TimedOrders()).outcome == "reached"
    assert results_of(store, "r")
