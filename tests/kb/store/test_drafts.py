"""Changes that wait in a draft are written with the note of their unit, all or none; a
preparation killed at any commit leaves no other store.
"""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from macrops import macrop
from sqlalchemy import Connection, Engine, event

from benchmarks.store_content import knowledge
from cellwright.engine.pipelines.jobs import crew_of
from cellwright.engine.pipelines.precompute import prepare_problems
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.store import Library, Record, Use
from cellwright.kb.store.database import open_transaction
from cellwright.kb.store.macrop_library import LibraryDraft
from cellwright.kb.store.unit_ledger import UnitStore
from cellwright.kb.store.usage_counts import Utility

THEMSE = Path(__file__).parents[3] / "domains" / "themse"


class Crash(BaseException):
    """Stands for a kill: nothing handles it."""


@contextmanager
def at_commit(act: Callable[[int], None]) -> Iterator[None]:
    """Call a function with the number of each commit of a transaction that writes, before it."""
    count = [0]

    def heard(connection: Connection) -> None:
        if connection.get_execution_options().get("writes"):
            count[0] += 1
            act(count[0])

    event.listen(Engine, "commit", heard)
    try:
        yield
    finally:
        event.remove(Engine, "commit", heard)


def problems(folder: Path, *names: str) -> list[Path]:
    """Copies of one problem, so that each but the first is looked up."""
    text = (THEMSE / "problems" / "lid_on_stand.yaml").read_text("utf-8")
    for name in names:
        own = text.replace("problem: lid_on_stand", f"problem: {name}")
        own = own.replace("domain: themse", f"domain: {THEMSE / 'domain.yaml'}")
        (folder / f"{name}.yaml").write_text(own, "utf-8")
    return [folder / f"{name}.yaml" for name in names]


def prepared(paths: list[Path], store: str) -> int:
    """Prepare problems; how many commits there were."""
    count = [0]
    with at_commit(lambda number: count.__setitem__(0, number)):
        found = prepare_problems(paths, store, SearchLimits(100_000), crew_of(1))
    assert all(each.status == "found" for each in found.problems)
    return count[0]


@pytest.mark.slow
def test_a_crash_at_any_commit_leaves_the_store_of_an_undisturbed_preparation(
    target: str, tmp_path: Path
) -> None:
    paths = problems(tmp_path, "first", "second")
    Library(str(tmp_path / "calm.db")).close()
    commits = prepared(paths, str(tmp_path / "calm.db"))
    wanted = knowledge(str(tmp_path / "calm.db"))
    assert wanted["trials"]
    assert sum(uses for _, uses in wanted["counted"]) > 0
    Library(target).close()
    for crash in range(1, commits + 1):
        emptied_rows(target)

        def fall(number: int, moment: int = crash) -> None:
            if number == moment:
                raise Crash

        with at_commit(fall), pytest.raises(Crash):
            prepare_problems(paths, target, SearchLimits(100_000), crew_of(1))
        prepared(paths, target)
        assert knowledge(target) == wanted, f"crash at commit {crash} of {commits}"


def emptied_rows(target: str) -> None:
    """Remove what a library holds."""
    with (
        Library(target) as library,
        open_transaction(library._engine, target, writes=True) as connection,
    ):
        for table in (
            "outlines",
            "usage",
            "utility",
            "trials",
            "macrops",
            "shared",
            "units",
            "sequences",
        ):
            connection.exec_driver_sql(f"DELETE FROM {table}")


@pytest.mark.slow
def test_a_killed_preparation_leaves_the_store_of_an_undisturbed_one(tmp_path: Path) -> None:
    paths, store = problems(tmp_path, "first", "second"), str(tmp_path / "killed.db")
    prepared(paths, str(tmp_path / "calm.db"))
    Library(store).close()
    child = os.fork()
    if child == 0:
        with at_commit(
            lambda number: os.kill(os.getpid(), signal.SIGKILL) if number == 2 else None
        ):
            prepare_problems(paths, store, SearchLimits(100_000), crew_of(1))
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    prepared(paths, store)
    assert knowledge(store) == knowledge(str(tmp_path / "calm.db"))


def noted(draft: LibraryDraft) -> Callable[[], dict[str, Any]]:
    return lambda: {"numbers": sorted(draft.numbers.values())}


def test_a_draft_is_seen_by_its_owner_alone_until_it_is_written(target: str) -> None:
    record = Record(macrop("own"), "goals")
    with (
        Library(target) as library,
        LibraryDraft(target) as draft,
        UnitStore(target, "test") as ledger,
    ):
        (number,) = draft.add([record])
        assert number is not None
        assert draft.add([record]) == [None]
        draft.note_uses({number: Use(2, 0.5)})
        draft.note_trial("d", "s", success=True)
        draft.note_utilities({(number, "forward"): Utility(trials=1)})
        assert [each.uses for each in draft.serving(record.macrop.domain, "goals")] == [2]
        assert draft.trials("d", "s") == (1, 0)
        assert (library.all(), library.trials("d", "s"), draft.settled(number)) == (
            [],
            (0, 0),
            None,
        )
        assert ledger.settle("a", "k", draft, noted(draft))
        (stored,) = library.all()
        assert (stored.uses, stored.id) == (2, draft.settled(number))
        assert library.trials("d", "s") == (1, 0)
        assert library.utilities() == {(stored.id, "forward"): Utility(trials=1)}
        assert ledger.finished({"a": "k"}) == {"a": {"numbers": [stored.id]}}


def test_a_unit_that_two_have_carried_out_is_written_once(target: str) -> None:
    with Library(target) as library, UnitStore(target, "test") as ledger:
        for expected in (True, False):
            with LibraryDraft(target) as draft:
                draft.note_trial("d", "s", success=False)
                assert ledger.settle("a", "k", draft, noted(draft)) is expected
        assert library.trials("d", "s") == (0, 1)


def test_what_another_has_stored_meanwhile_is_counted_for_it(target: str) -> None:
    with (
        Library(target) as library,
        LibraryDraft(target) as draft,
        UnitStore(target, "test") as ledger,
    ):
        (own,) = draft.add([Record(macrop("own"), "goals")])
        assert own is not None
        draft.note_uses({own: Use(1, 0.0)})
        (number,) = library.add([Record(macrop("own"), "goals")])
        assert ledger.settle("a", "k", draft, noted(draft))
        assert draft.settled(own) == number
        assert [each.uses for each in library.all()] == [1]


def test_nothing_is_written_if_the_note_fails(target: str) -> None:
    def failing() -> dict[str, Any]:
        raise Crash

    with (
        Library(target) as library,
        LibraryDraft(target) as draft,
        UnitStore(target, "test") as ledger,
    ):
        draft.add([Record(macrop("own"), "goals")])
        draft.note_trial("d", "s", success=True)
        with pytest.raises(Crash):
            ledger.settle("a", "k", draft, failing)
        assert (library.all(), library.trials("d", "s")) == ([], (0, 0))
