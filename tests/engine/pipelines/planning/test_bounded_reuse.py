"""A reused plan is hardly dearer than a fresh one, and goals whose lookups do not pay are not
looked up.
"""

from pathlib import Path
from random import Random
from typing import Any

import pytest

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.library_plans import plan_with_library
from cellwright.engine.pipelines.planning.macros import LibraryAnswer, LibraryPlanner
from cellwright.engine.pipelines.planning.macros.library_planner import RATIO
from cellwright.engine.pipelines.planning.macros.lookup_trials import LookupTrials
from cellwright.engine.pipelines.planning.plan_objective import SequenceChoice
from cellwright.engine.stages.macros.lookup.macro_repertoire import Repertoire
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library
from cellwright.kb.store.lookup_counts import GRACE, UNPAID, unpaid_kinds
from tests.road_maps import road_map, road_problem


def cost(answered: LibraryAnswer) -> int:
    assert isinstance(answered.outcome, Found)
    return answered.outcome.plan.cost


def fresh_cost(problem: Problem) -> int:
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    return outcome.plan.cost


@pytest.mark.parametrize("seed", range(3))
def test_no_answer_is_much_dearer_than_a_fresh_plan(tmp_path: Path, seed: int) -> None:
    draw = Random(seed)
    roads = road_map(draw, 8)
    with Library(str(tmp_path / "library.db")) as library, LibraryPlanner(library) as practice:
        for number in range(8):
            if number % 3 == 2:
                for pair in draw.sample(sorted(roads), 4):
                    roads[pair] = draw.randint(1, 20)
                roads[draw.choice([(0, 4), (1, 6), (2, 5)])] = 1
            start, end = draw.sample(range(8), 2)
            problem = road_problem(tmp_path, roads, start, f"at(v0, p{end})")
            answered = practice.plan(problem)
            assert isinstance(answered.outcome, Found)
            assert validate_plan(problem, answered.outcome.plan) == []
            assert cost(answered) <= RATIO * fresh_cost(problem)


def test_where_a_reused_plan_is_dear_the_planner_answers_and_its_plan_is_learned(
    tmp_path: Path,
) -> None:
    roads = {(0, 1): 9, (1, 2): 9, (2, 3): 9}
    with Library(str(tmp_path / "library.db")) as library, LibraryPlanner(library) as practice:
        first = practice.plan(road_problem(tmp_path, roads, 0, "at(v0, p3)"))
        assert (first.origin, cost(first)) == ("planner", 27)
        shortcut = road_problem(tmp_path, {**roads, (0, 3): 2}, 0, "at(v0, p3)")
        second = practice.plan(shortcut)
        assert (second.origin, cost(second)) == ("planner", 2)
        assert second.macrop is not None
        third = practice.plan(
            road_problem(tmp_path, {**roads, (0, 3): 1, (3, 0): 1}, 0, "at(v0, p3)")
        )
        assert cost(third) == 1


def test_lookups_of_small_problems_end_after_a_few(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lookups: list[object] = []
    find = Repertoire.find
    monkeypatch.setattr(
        Repertoire, "find", lambda own, asked: (lookups.append(asked), find(own, asked))[1]
    )
    roads = road_map(Random(1), 8)
    with Library(str(tmp_path / "library.db")) as library, LibraryPlanner(library) as practice:
        for number in range(2 * GRACE + 8):
            start, end = number % 8, (3 * number + 5) % 8
            if start != end:
                answered = practice.plan(road_problem(tmp_path, roads, start, f"at(v0, p{end})"))
        assert len(lookups) <= GRACE + 3
        assert "not paid" in answered.reason


def test_trials_of_lookups_are_kept_and_success_brings_lookups_back(tmp_path: Path) -> None:
    target = str(tmp_path / "library.db")
    with Library(target) as library:
        trials = LookupTrials(library, "roads")
        for _ in range(GRACE + 1):
            assert trials.pays("at/2")
            trials.note_lookup("at/2", pays=False)
    with Library(target) as library:
        trials = LookupTrials(library, "roads")
        assert not trials.pays("at/2")
        assert trials.pays("seen/1")
        assert unpaid_kinds(target, "roads") == {"at/2"}
        trials.note_lookup("at/2", pays=True)
        assert trials.pays("at/2")
    assert unpaid_kinds(target, "roads") == set()


def test_a_store_that_is_no_library_tells_nothing(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("this is no database" * 100)
    for store in ("text", "missing.db", "."):
        assert unpaid_kinds(str(tmp_path / store), "roads") == set()
    assert unpaid_kinds("postgresql://somewhere/library", "roads") == set()


def test_a_command_plans_without_the_library_where_lookups_have_not_paid(tmp_path: Path) -> None:
    problem = road_problem(tmp_path, road_map(Random(2), 6), 0, "at(v0, p3)")
    store = str(tmp_path / "library.db")

    def source() -> dict[str, Any]:
        run, found = plan_with_library(
            problem, SearchLimits(), None, SequenceChoice.SEQUENCE, store, folded=False
        )
        assert isinstance(run.outcome, Found)
        assert run.outcome.plan.cost == fresh_cost(problem)
        return dict(found["source"])

    assert source()["origin"] == "planner"
    assert source()["origin"] == "library"
    with Library(store) as library:
        for _ in range(GRACE + 2):
            LookupTrials(library, "roads").note_lookup("at/2", pays=False)
    assert source() == {"origin": "planner", "macrop": None, "name": "", "reason": UNPAID}


def test_plans_of_a_cost_are_trusted_until_one_of_them_was_dear(tmp_path: Path) -> None:
    with Library(str(tmp_path / "library.db")) as library:
        trials = LookupTrials(library, "roads")
        assert not trials.is_trusted("at/2", 5)
        trials.note_quality("at/2", 5, good=True)
        assert trials.is_trusted("at/2", 5)
        assert not trials.is_trusted("at/2", 6)
        trials.note_quality("at/2", 5, good=False)
        assert not trials.is_trusted("at/2", 5)
