"""Libraries that stay open: what a process plans again and again is found in memory, and the
library is the truth.
"""

import gc
import os
import sqlite3
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from cellwright.engine.model.planning_choices import SequenceChoice
from cellwright.engine.pipelines.planning.library_plans import plan_with_library
from cellwright.engine.pipelines.planning.macros import library_planner as module
from cellwright.engine.pipelines.planning.macros.library_planner import (
    close_libraries,
    open_planner,
)
from cellwright.engine.stages.lifted import cell_domain
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation import operator_semantics
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load, with_goals
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library, Record
from cellwright.kb.store.database import begin_anew, opened_so_far
from cellwright.kb.terms import Function
from tests.engine.pipelines.planning.test_library_planner import POINTS

GOAL = "measured(_, _, meas(m2))"


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    close_libraries()
    yield
    close_libraries()


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("points") / "points.yaml"
    made.write_text(POINTS)
    return made


@pytest.fixture(scope="module")
def problem(file: Path) -> Problem:
    return read(file)


def read(file: Path) -> Problem:
    found = load(file).problem
    assert found is not None
    return with_goals(found.domain, GOAL, found)


def origin(problem: Problem, store: str) -> str:
    with open_planner(store, problem.domain, SearchLimits()) as practice:
        return practice.plan(problem).origin


def kept() -> int:
    return len(module._OPEN.standing)


def test_a_library_stays_open_from_the_second_problem_on(problem: Problem, tmp_path: Path) -> None:
    store = str(tmp_path / "library.db")
    assert (origin(problem, store), kept()) == ("planner", 0)
    assert (origin(problem, store), kept()) == ("library", 1)
    assert (origin(problem, store), kept()) == ("library", 1)


def test_what_stays_is_read_ahead_and_found_without_reading_the_library(
    problem: Problem, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = str(tmp_path / "library.db")
    for _ in range(2):
        origin(problem, store)
    for each in ("macrop", "outlines", "_read"):
        monkeypatch.delattr(Library, each)
    assert origin(read(file), store) == "library"  # the domain was read again, and is the same


def test_each_use_is_written_when_its_turn_ends(problem: Problem, tmp_path: Path) -> None:
    store = str(tmp_path / "library.db")
    for uses in range(4):
        origin(problem, store)
        with Library(store) as other:
            assert other.figures().uses == uses


def test_what_others_have_removed_is_not_found(problem: Problem, tmp_path: Path) -> None:
    store = str(tmp_path / "library.db")
    for _ in range(3):
        origin(problem, store)
    with Library(store) as other:
        other.forget([each.id for each in other.all()])
    assert origin(problem, store) == "planner"
    assert origin(problem, store) == "library"


def test_what_is_removed_during_a_turn_is_missed_by_the_next(
    problem: Problem, tmp_path: Path
) -> None:
    store = str(tmp_path / "library.db")
    for _ in range(2):
        origin(problem, store)
    with open_planner(store, problem.domain, SearchLimits()) as practice, Library(store) as other:
        practice.plan(problem)
        other.forget([each.id for each in other.all()])
    assert origin(problem, store) == "planner"


def test_what_is_learned_in_a_turn_and_removed_after_it_is_missed(
    problem: Problem, tmp_path: Path
) -> None:
    store = str(tmp_path / "library.db")
    other = with_goals(
        problem.domain, "measured(_, _, meas(m3)), measured(_, _, meas(m2))", problem
    )
    assert [origin(each, store) for each in (problem, problem, other, other)] == [
        "planner",
        "library",
    ] * 2
    with Library(store) as library:
        library.forget([max(each.id for each in library.all())])
    assert [origin(each, store) for each in (other, problem)] == ["planner", "library"]


def test_a_turn_asks_once_whether_all_is_still_there(
    problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, asked = str(tmp_path / "library.db"), []
    for _ in range(2):
        origin(problem, store)
    whole = Library.holdings
    monkeypatch.setattr(Library, "holdings", lambda *own: asked.append(own[1:]) or whole(*own))
    assert origin(problem, store) == "library"
    assert len(asked) == 1


def test_the_facts_of_a_cell_are_evaluated_once(
    problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = str(tmp_path / "library.db")
    for _ in range(2):
        origin(problem, store)
    for each in (cell_domain, operator_semantics):
        monkeypatch.delattr(each, "evaluate_statics")
    other = with_goals(problem.domain, "measured(_, _, meas(m3))", problem)
    assert [origin(each, store) for each in (problem, other)] == ["library"] * 2


def test_another_version_of_the_file_of_the_cell_is_evaluated_anew(
    problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, seen = str(tmp_path / "library.db"), []
    for size in (1, 1, 1, 2):
        monkeypatch.setattr(
            module, "version_of_cell", lambda _, size=size: (tmp_path / "cell.yaml", 0, size)
        )
        origin(problem, store)
        seen += [each.cells for each in module._OPEN.standing]
    assert seen[0] is seen[1]
    assert seen[2] is not seen[1]


def test_who_comes_next_waits_for_no_search_for_cycles(problem: Problem, tmp_path: Path) -> None:
    store, before = str(tmp_path / "library.db"), gc.get_threshold()
    gc.set_threshold(1_000_000)
    try:
        for _ in range(2):
            origin(problem, store)
        assert gc.get_count()[0] < 1_000  # objects that the next search has to go through
    finally:
        gc.set_threshold(*before)


def test_a_number_that_another_macrop_got_is_not_taken_for_the_first(
    problem: Problem, tmp_path: Path
) -> None:
    store = str(tmp_path / "library.db")
    for _ in range(3):
        origin(problem, store)
    with Library(store) as other:
        (first,) = other.all()
        other.forget([first.id])
        record = Record(replace(first.macrop, name=Function("another")), first.signature, 1.0, ())
        assert other.add([record]) == [first.id]
    assert module._take_open(store, problem.domain) is None


def test_another_file_of_the_same_name_is_another_library(problem: Problem, tmp_path: Path) -> None:
    store = str(tmp_path / "library.db")
    for _ in range(3):
        origin(problem, store)
    for each in tmp_path.glob("library.db*"):
        each.unlink()
    assert origin(problem, store) == "planner"
    with sqlite3.connect(store) as raw:
        assert raw.execute("SELECT count(*) FROM macrops").fetchone() == (1,)


def test_after_an_error_the_library_is_opened_anew(problem: Problem, tmp_path: Path) -> None:
    store = str(tmp_path / "library.db")
    for _ in range(2):
        origin(problem, store)
    with pytest.raises(InvalidInput), open_planner(store, problem.domain, SearchLimits()):
        raise InvalidInput([])
    assert kept() == 0
    assert (origin(problem, store), kept()) == ("library", 1)


def test_a_macrop_that_cannot_be_read_spoils_no_answer_to_another_problem(
    problem: Problem, tmp_path: Path
) -> None:
    store = str(tmp_path / "library.db")
    other = with_goals(
        problem.domain, "measured(_, _, meas(m3)), measured(_, _, meas(m2))", problem
    )
    assert [origin(each, store) for each in (problem, other)] == ["planner", "planner"]
    close_libraries()
    with sqlite3.connect(store) as raw:
        raw.execute("UPDATE macrops SET document = '?' WHERE id = (SELECT max(id) FROM macrops)")
    assert [(origin(problem, store), kept()) for _ in range(3)] == [("library", 0)] * 3


def test_few_libraries_stay_open(
    problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MAX_OPEN_LIBRARIES", 2)
    for name in ("a", "b", "c"):
        for _ in range(2):
            with open_planner(str(tmp_path / name), problem.domain, SearchLimits()):
                pass
    assert [each.store for each in module._OPEN.standing] == [
        str(tmp_path / "b"),
        str(tmp_path / "c"),
    ]


def test_a_large_library_and_one_that_is_much_read_do_not_stay(
    problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = str(tmp_path / "library.db")
    monkeypatch.setattr(module, "MAX_OUTLINES", 0)
    assert [(origin(problem, store), kept()) for _ in range(2)] == [("planner", 0), ("library", 0)]
    monkeypatch.setattr(module, "MAX_OUTLINES", 1)
    monkeypatch.setattr(module, "MAX_READ_AHEAD", 0)
    assert [(origin(problem, store), kept()) for _ in range(2)] == [("library", 1), ("library", 0)]


def test_a_forked_process_uses_no_connection_of_its_parent(
    problem: Problem, tmp_path: Path
) -> None:
    store = str(tmp_path / "library.db")
    for _ in range(2):
        origin(problem, store)
    child = os.fork()
    if child == 0:
        gc.collect()
        os._exit(kept())
    assert os.waitpid(child, 0)[1] == 0
    assert (origin(problem, store), kept()) == ("library", 1)


def test_a_library_that_stays_open_counts_as_opened_by_the_next_command(
    problem: Problem, tmp_path: Path
) -> None:
    store = str(tmp_path / "library.db")
    for _ in range(2):
        origin(problem, store)
    begin_anew()
    origin(problem, store)
    assert opened_so_far() == (store,)


def test_a_program_that_plans_again_is_answered_as_a_command_is(
    problem: Problem, tmp_path: Path
) -> None:
    store = str(tmp_path / "library.db")
    answers = [
        plan_with_library(problem, SearchLimits(), None, SequenceChoice.FREE, store, False, stays)
        for stays in (True,) * 3 + (False,)
    ]
    assert [source["source"]["origin"] for _, source in answers] == ["planner", *["library"] * 3]
    assert answers[2][0].outcome.plan == answers[3][0].outcome.plan  # type: ignore[union-attr]
