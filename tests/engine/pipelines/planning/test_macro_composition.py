"""Plans composed of MACROPs are valid, no dearer than the planner's by more than a twentieth,
and never needed.
"""

import dataclasses
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.macros import (
    LibraryAnswer,
    LibraryPlanner,
    library_planner,
)
from cellwright.engine.stages.macros.lookup.macro_repertoire import DOUBT_S, pays_off
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.loader import load, with_goals
from cellwright.kb.model.conditions import ALWAYS_TRUE
from cellwright.kb.model.plan_model import Macrop
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library, Stored, Use
from tests.places import BUNDLED as DOMAINS


def bundled(name: str) -> Problem:
    domain, problem = name.split("/")
    found = load(DOMAINS / domain / "problems" / f"{problem}.yaml").problem
    assert found is not None
    return found


def found_in(answered: LibraryAnswer) -> Found:
    assert isinstance(answered.outcome, Found)
    return answered.outcome


ROUGH = SearchLimits(
    room=None, restarts=0
)  # the planner's plan of four probes is too good for parts to compete, else


def answer(problem: Problem, folder: Path, limits: SearchLimits = ROUGH) -> LibraryAnswer:
    with (
        Library(str(folder / "library.db")) as library,
        LibraryPlanner(library, limits) as practice,
    ):
        return practice.plan(problem)


@pytest.mark.slow
def test_four_probes_are_four_instances_of_what_two_taught(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        library_planner, "LONG_SEARCH", 0
    )  # the planner's plan costs the same: any search is long
    problem = bundled("themse/four")
    answered = answer(problem, tmp_path)
    assert answered.origin == "parts"
    assert len(answered.parts) == 4
    assert len({part.macrop for part in answered.parts[1:]}) == 1
    plan = found_in(answered).plan
    assert validate_plan(problem, plan) == []
    assert sorted(n for part in answered.parts for n in part.steps) == [
        step.id for step in plan.steps
    ]
    planned = checked_plan.plan_problem(problem, ROUGH)
    assert isinstance(planned, Found)
    assert plan.cost <= 1.05 * planned.plan.cost


def test_the_whole_is_learned_as_a_macrop_of_macrops(tmp_path: Path) -> None:
    problem = bundled("themse/two")
    first, second = answer(problem, tmp_path), answer(problem, tmp_path)
    assert (second.origin, second.macrop) == ("library", first.macrop)
    assert [part.steps for part in second.parts] == [part.steps for part in first.parts]
    assert found_in(first).plan.steps == found_in(second).plan.steps


places = [
    "slot(drawer, 1)",
    "slot(drawer, 2)",
    "slot(drawer, 3)",
    "slot(drawer, 4)",
    "slot(freezer, 1)",
]
many_goals = st.permutations(places).map(
    lambda order: ", ".join(f"at(probe_{n}, {place})" for n, place in enumerate(order[:3], 1))
)


@pytest.mark.slow
@given(goals=many_goals, other=many_goals)
@settings(max_examples=4, deadline=None, suppress_health_check=list(HealthCheck))
def test_parts_that_disturb_each_other_are_planned_together(
    tmp_path: Path, goals: str, other: str
) -> None:
    (tmp_path / "library.db").unlink(missing_ok=True)
    base = dataclasses.replace(bundled("themse/four"), goal=ALWAYS_TRUE, chains=())
    for wanted in (goals, other):
        problem = with_goals(base.domain, wanted, base)
        plan = found_in(answer(problem, tmp_path)).plan
        assert validate_plan(problem, plan) == []


def test_what_failed_to_pay_is_not_tried_again(tmp_path: Path) -> None:
    problem = bundled("themse/two")
    with (
        Library(str(tmp_path / "library.db")) as library,
        LibraryPlanner(library, ROUGH) as practice,
    ):
        kinds = "| heated/2>cooled/2>stored/1"
        library.note_trial("themse", f" {kinds}", False)
        assert library.trials("themse", f" {kinds}") == (0, 1)
        assert practice.plan(problem).origin == "planner"


def test_a_macrop_that_costs_more_than_it_saves_is_not_offered() -> None:
    macrop = _nothing()
    assert pays_off(Stored(1, macrop, "", 0, 0.5, 0.0))
    assert pays_off(Stored(1, macrop, "", 0, 5.0, 4.0))
    assert not pays_off(Stored(1, macrop, "", 0, 0.5, DOUBT_S + 0.1))
    assert pays_off(Stored(1, macrop, "", 100, 0.5, DOUBT_S + 0.1))


def _nothing() -> Macrop:
    from cellwright.kb.terms import Function

    return Macrop(Function("nothing"), "d", (), (), (), (), (), (), (), (), (), ())


def test_time_spent_in_vain_is_charged(tmp_path: Path) -> None:
    problem = bundled("bulkhead/one_point")
    with Library(str(tmp_path / "library.db")) as library:
        with LibraryPlanner(library) as practice:
            practice.plan(problem)
            practice.plan(problem)
        (first,) = library.all()
        assert first.uses == 1
        assert 0 < first.lookup_s < first.planning_s
        library.note_uses({first.id: Use(0, 1000.0)})
        with LibraryPlanner(library) as practice:
            assert practice.plan(problem).origin == "planner"
