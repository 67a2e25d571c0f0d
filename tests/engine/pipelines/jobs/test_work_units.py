"""Units of work: done once, whoever carries them out, and whatever is killed meanwhile."""

import gc
import os
import signal
import socket
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from cellwright.engine.kernels.cancellation import never
from cellwright.engine.pipelines.jobs import (
    ResultLedger,
    WorkCrew,
    WorkKind,
    WorkUnit,
    carried_out,
    crew_of,
)
from cellwright.engine.pipelines.jobs.input_digests import content_digest, require_same
from cellwright.engine.pipelines.jobs.work_units import carry_out_unit
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.garbage_collection import COLLECTION_THRESHOLD, seldom_searched
from cellwright.kb.store.unit_ledger import UnitStore

Job = tuple[str, str]  # what to do, and the folder where it is written down that it was done


def work(job: Job, interrupted: Any) -> str:
    """Do what a job says, and leave a mark."""
    what, folder = job
    (Path(folder) / f"{what}-{time.monotonic_ns()}-{os.getpid()}").touch()
    first = len(list(Path(folder).glob(f"{what}-*"))) == 1
    if what.startswith("die") and (first or what == "die always"):
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "eat":
        bytearray(2**50)
    while what == "wait" and not interrupted():
        time.sleep(0.01)
    return f"unfinished {what}" if what == "wait" else f"done {what}"


def lost(job: Job, why: str) -> str:
    return f"unfinished {job[0]}: {why}"


def finished(result: str) -> bool:
    return not result.startswith("unfinished")


def written(result: str) -> dict[str, Any]:
    return {"said": result}


def read(content: Mapping[str, Any]) -> str:
    return str(content["said"])


def kind(store: Path | None = None) -> WorkKind[Job, str]:
    return WorkKind(
        "test", work, lost, ResultLedger(str(store), finished, written, read) if store else None
    )


def units(folder: Path, *names: str, key: str = "k") -> list[WorkUnit[Job]]:
    (folder / "marks").mkdir(exist_ok=True)
    return [WorkUnit(name, key, (name, str(folder / "marks"))) for name in names]


def results(made: WorkKind[Job, str], asked: list[WorkUnit[Job]], crew: WorkCrew) -> dict[str, str]:
    return {unit.name: said for unit, said in carried_out(made, asked, crew, never)}


def marks(folder: Path, name: str) -> int:
    return len(list((folder / "marks").glob(f"{name}-*")))


def test_what_the_ledger_holds_is_not_done_again_and_is_forgotten_at_the_end(
    tmp_path: Path,
) -> None:
    store, asked = tmp_path / "s.db", units(tmp_path, "a", "b")
    assert carry_out_unit(kind(store), asked[0], never) == "done a"
    assert carry_out_unit(kind(store), asked[0], never) == "done a"
    assert results(kind(store), asked, crew_of(1)) == {"a": "done a", "b": "done b"}
    assert (marks(tmp_path, "a"), marks(tmp_path, "b")) == (1, 1)
    with UnitStore(str(store), "test") as ledger:
        assert ledger.finished({"a": "k", "b": "k"}) == {}
    results(kind(store), asked, crew_of(1))
    assert marks(tmp_path, "a") == 2


def test_what_depends_on_other_input_is_done_again(tmp_path: Path) -> None:
    store = tmp_path / "s.db"
    carry_out_unit(kind(store), units(tmp_path, "a")[0], never)
    carry_out_unit(kind(store), units(tmp_path, "a", key="other")[0], never)
    assert marks(tmp_path, "a") == 2


def test_a_preparation_that_is_cut_off_goes_on(tmp_path: Path) -> None:
    store, asked = tmp_path / "s.db", units(tmp_path, "a", "b", "c")
    cut = (False, False, True)
    with_stop = carried_out(kind(store), asked, crew_of(1), iter((*cut, *[True] * 9)).__next__)
    found = {unit.name: said for unit, said in with_stop}
    assert sum(map(finished, found.values())) in (1, 2)
    assert found["c"] == "unfinished c: interrupted"
    assert set(results(kind(store), asked, crew_of(1)).values()) == {"done a", "done b", "done c"}
    assert sum(marks(tmp_path, each) for each in "abc") == 3


def test_what_cannot_be_read_in_a_ledger_is_done_again(tmp_path: Path) -> None:
    with UnitStore(str(tmp_path / "s.db"), "test") as ledger:
        ledger.keep("a", "k", {"said": "done a"})
        with ledger._engine.begin() as connection:
            connection.exec_driver_sql("UPDATE units SET document = '[1'")
        assert ledger.finished({"a": "k"}) == {}


def test_a_killed_process_costs_no_unit_and_a_deadly_unit_no_other(tmp_path: Path) -> None:
    asked = units(tmp_path, "a", "die once", "die always", "b", "eat")
    found = results(kind(tmp_path / "s.db"), asked, crew_of(2))
    assert [found[each] for each in ("a", "b", "die once")] == ["done a", "done b", "done die once"]
    assert "died again and again" in found["die always"]
    assert found["eat"] == "unfinished eat: out of memory"


def test_processes_stop_when_they_are_told_to(tmp_path: Path) -> None:
    asked, until = units(tmp_path, "a", "wait", "wait too"), time.monotonic() + 60

    def interrupted() -> bool:
        return marks(tmp_path, "wait") > 0 or time.monotonic() > until

    found = {u.name: said for u, said in carried_out(kind(), asked, crew_of(2), interrupted)}
    assert found["wait"].startswith("unfinished wait")
    assert len(found) == 3


def test_a_digest_tells_of_the_problem_its_cell_and_what_is_asked(tmp_path: Path) -> None:
    (tmp_path / "problems").mkdir()
    domain, problem = tmp_path / "domain.yaml", tmp_path / "problems" / "one.yaml"
    domain.write_text("domain: mine\n", "utf-8")
    problem.write_text("problem: one\ndomain: mine\n", "utf-8")
    first = content_digest(problem)
    assert content_digest(problem) == first != content_digest(problem, 1)
    (tmp_path / "problems" / "two.yaml").write_text("problem: two\ndomain: mine\n", "utf-8")
    assert content_digest(problem) == first
    (tmp_path / "cell.yaml").write_text("cell: {}\n", "utf-8")
    assert content_digest(problem) != first
    with pytest.raises(InvalidInput, match="other files"):
        require_same(problem, first)


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("foo bar", "not the address"),
        ("http://h:1", "not the address"),
        ("h:0", "not the address"),
        ("h:99999999", "not the address"),
        (":8786", "not the address"),
        ("127.0.0.1:1", "no cluster answers: connection refused"),
    ],
)
def test_an_address_without_a_cluster_is_told_at_once(address: str, said: str) -> None:
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    began = time.monotonic()
    with pytest.raises(InvalidInput, match=said):
        crew_of(1, address)
    assert time.monotonic() - began < 10


def test_what_listens_without_being_a_scheduler_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    monkeypatch.setattr("cellwright.engine.pipelines.jobs.dask_cluster.ANSWERED_S", 0.2)
    deaf = socket.create_server(("127.0.0.1", 0))
    with deaf, pytest.raises(InvalidInput, match="no scheduler of Dask"):
        crew_of(0, f"127.0.0.1:{deaf.getsockname()[1]}")


def test_a_missing_extra_is_told_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cellwright.engine.pipelines.jobs.dask_cluster.find_spec", lambda _: None)
    with pytest.raises(InvalidInput, match=r"cellwright\[cluster\]"):
        crew_of(1, "127.0.0.1:1")


def tell_threshold(_job: Job, _interrupted: Any) -> str:
    return f"{gc.get_threshold()[0]} {gc.get_freeze_count() > 0}"


def test_processes_look_for_cycles_as_rarely_as_the_command_does(tmp_path: Path) -> None:
    telling = WorkKind("test", tell_threshold, lost)
    asked = units(tmp_path, "a", "b")
    assert results(telling, asked, crew_of(2)) == {
        "a": f"{COLLECTION_THRESHOLD} True",
        "b": f"{COLLECTION_THRESHOLD} True",
    }


def test_inside_another_program_cycles_are_sought_rarely_for_a_while() -> None:
    before = gc.get_threshold()
    try:
        gc.set_threshold(700, 10, 10)
        with seldom_searched():
            assert gc.get_threshold()[0] == COLLECTION_THRESHOLD
        assert gc.get_threshold() == (700, 10, 10)
    finally:
        gc.set_threshold(*before)
