"""Lookup first, planning else, learning after: whatever a library answers passes the
independent checker.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning.macros import LibraryAnswer, LibraryPlanner
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.stages.lifted.cell_domain import Situation
from cellwright.engine.stages.macros.lookup import macro_lookup
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load, with_goals
from cellwright.kb.model.conditions import ALWAYS_TRUE
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library
from cellwright.kb.terms import Function, Number, sort_naturally
from tests.places import BUNDLED as DOMAINS

POINTS = """
problem: points
domain: bulkhead
objects: {measurement: [m1..6]}
statics:
  - needs(m1, thickness), needs(m2, thickness), needs(m3, thickness), needs(m4, profile), needs(m5, profile)
  - needs(m6, profile)
initial:
  - at(t3_746, in_contact_point(meas(m1))), holding(t3_746, us_probe)
goals:
  - measured(_, _, meas(m2))
"""

point = st.integers(1, 6).map("measured(_, _, meas(m{}))".format)
bulkhead_goal = st.one_of(
    point,
    st.lists(point, min_size=2, max_size=3, unique=True).map(", ".join),
    st.integers(1, 6).map("at(t3_746, approach_point(meas(m{})))".format),
    st.sampled_from(["us_probe", "slra"]).map("holding(t3_746, {})".format),
    st.sampled_from(["us_probe", "slra"]).map("location({}, t3_746, in_rack)".format),
)
probe = st.integers(1, 4)
themse_goal = st.one_of(
    st.builds(
        "inside(probe_{}, {})".format, probe, st.sampled_from(["furnace", "freezer", "drawer"])
    ),
    st.builds("at(probe_{}, mars_gripper)".format, probe),
    st.builds(
        "position({})".format, st.sampled_from(["flap, open", "drawer, open", "bayonet, locked"])
    ),
    st.just("at(lid, stand)"),
)


@pytest.fixture(scope="module")
def points(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    file = tmp_path_factory.mktemp("points") / "points.yaml"
    file.write_text(POINTS)
    problem = load(file).problem
    assert problem is not None
    return problem


@pytest.fixture(scope="module")
def probes() -> Problem:
    problem = load(DOMAINS / "themse" / "problems" / "four.yaml").problem
    assert problem is not None
    return dataclasses.replace(problem, goal=ALWAYS_TRUE, chains=())


def asked(problem: Problem, goals: str) -> Problem:
    return with_goals(problem.domain, goals, problem)


def plan_of(answered: LibraryAnswer) -> Found:
    assert isinstance(answered.outcome, Found)
    return answered.outcome


def assert_valid(problem: Problem, here: Situation, answered: LibraryAnswer) -> None:
    before = problem.replace(sort_naturally(here.facts))
    assert validate_plan(before, plan_of(answered).plan) == []


def work_through(problem: Problem, goals: list[str], folder: Path) -> list[str]:
    """Serve goals one after another, each from where the last one ended; the origins of the
    plans.
    """
    file = folder / "library.db"
    file.unlink(missing_ok=True)
    origins = []
    with (
        Library(str(file)) as library,
        LibraryPlanner(library, SearchLimits(expansions=20_000)) as practice,
    ):
        here = practice.situation(problem)
        for goal in goals:
            wanted = asked(problem, goal)
            answered = practice.plan(wanted, here)
            assert_valid(wanted, here, answered)
            assert answered.after is not None
            origins.append(answered.origin)
            here = answered.after
    return origins


SETTINGS = settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))


@pytest.mark.slow
@given(goals=st.lists(bulkhead_goal, min_size=4, max_size=8))
@SETTINGS
def test_every_plan_in_a_day_of_measuring_is_valid(
    points: Problem, tmp_path: Path, goals: list[str]
) -> None:
    work_through(points, goals, tmp_path)


@pytest.mark.slow
@given(goals=st.lists(themse_goal, min_size=4, max_size=7))
@SETTINGS
def test_every_plan_in_a_day_at_the_rack_is_valid(
    probes: Problem, tmp_path: Path, goals: list[str]
) -> None:
    work_through(probes, goals, tmp_path)


def test_what_was_planned_once_is_looked_up_for_other_objects(
    points: Problem, tmp_path: Path
) -> None:
    goals = [f"measured(_, _, meas(m{n}))" for n in (2, 3, 1)]
    assert work_through(points, goals, tmp_path) == ["planner", "library", "library"]


def test_a_goal_that_holds_needs_no_plan(points: Problem, tmp_path: Path) -> None:
    assert work_through(points, ["holding(t3_746, us_probe)"], tmp_path) == ["state"]


def test_another_process_serves_what_one_has_learned(points: Problem, tmp_path: Path) -> None:
    target = str(tmp_path / "library.db")
    with Library(target) as one, Library(target) as other, LibraryPlanner(other) as reader:
        first = asked(points, "measured(_, _, meas(m2))")
        assert (
            reader.plan(asked(points, "at(t3_746, approach_point(meas(m2)))")).origin == "planner"
        )
        with LibraryPlanner(one) as writer:
            learned = writer.plan(first)
        found = reader.plan(first)
        assert (learned.origin, found.origin, found.macrop) == (
            "planner",
            "library",
            learned.macrop,
        )
    with Library(target) as library:
        assert library.figures().uses == 1


def test_what_was_read_ahead_is_looked_up_without_asking_the_library(
    points: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = str(tmp_path / "library.db")
    goals = [f"measured(_, _, meas(m{n}))" for n in (2, 3)]
    assert work_through(points, goals, tmp_path) == ["planner", "library"]
    with Library(target) as library, LibraryPlanner(library) as practice:
        repertoire = practice.repertoire(points.domain)
        repertoire.load()
        assert repertoire.read_ahead(most=0) == 0
        assert repertoire.read_ahead() == len(repertoire) > 0
        assert repertoire.read_ahead() == 0
        for each in ("macrop", "outlines", "among"):
            monkeypatch.delattr(Library, each)
        assert practice.plan(asked(points, goals[1])).origin == "library"


def test_what_is_infeasible_is_not_learned(points: Problem, tmp_path: Path) -> None:
    heavy = dataclasses.replace(
        points, statics=tuple(s for s in points.statics if s.name != "needs")
    )
    with Library(str(tmp_path / "library.db")) as library, LibraryPlanner(library) as practice:
        answered = practice.plan(asked(heavy, "measured(_, _, meas(m4))"))
        assert not isinstance(answered.outcome, Found)
        assert library.all() == []


def test_what_lookup_finds_and_the_checker_refuses_is_planned(
    points: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever goes wrong inside lookup, a plan that is none does not leave by the library."""
    with Library(str(tmp_path / "library.db")) as library, LibraryPlanner(library) as practice:
        assert practice.plan(asked(points, "measured(_, _, meas(m2))")).origin == "planner"
        monkeypatch.setattr(
            macro_lookup, "instantiate_macro", broken(macro_lookup.instantiate_macro)
        )
        monkeypatch.setattr(macro_lookup, "check_instance", lambda _plan, query: query.situation)
        again = practice.plan(asked(points, "measured(_, _, meas(m3))"))
        assert again.origin == "planner"
        assert validate_plan(asked(points, "measured(_, _, meas(m3))"), plan_of(again).plan) == []


def broken(made: Callable[..., Plan]) -> Callable[..., Plan]:
    """Every instance without its first step."""
    return lambda *given: Plan(
        tuple(dataclasses.replace(step, after=()) for step in made(*given).steps[1:]), ()
    )


def test_what_the_library_gives_passes_the_checker(
    points: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    passed: list[Plan] = []
    checked = PlanGate.findings
    monkeypatch.setattr(
        PlanGate,
        "findings",
        lambda self, *given: (passed.append(given[1]), checked(self, *given))[1],
    )
    with Library(str(tmp_path / "library.db")) as library, LibraryPlanner(library) as practice:
        practice.plan(asked(points, "measured(_, _, meas(m2))"))
        again = practice.plan(asked(points, "measured(_, _, meas(m3))"))
        assert again.origin == "library"
        assert plan_of(again).plan in passed


def test_what_no_plan_is_made_for_is_not_looked_up_either(probes: Problem, tmp_path: Path) -> None:
    wanted = asked(probes, "at(probe_1, mars_gripper)")
    crowded = dataclasses.replace(wanted, statics=(*wanted.statics, *_both_at_home()))
    both = tuple(atom for each in ("open", "closed") for atom in _position(each))
    with Library(str(tmp_path / "library.db")) as library, LibraryPlanner(library) as practice:
        assert practice.plan(wanted).origin == "planner"
        with pytest.raises(InvalidInput, match="K204"):
            practice.plan(crowded)
        with pytest.raises(InvalidInput, match="K301"):
            practice.plan(dataclasses.replace(wanted, initial=both))


def _both_at_home() -> tuple[Function, ...]:
    slot = Function("slot", (Function("drawer"), Number(1)))
    return tuple(Function("own_depot", (Function(name), slot)) for name in ("probe_1", "probe_2"))


def _position(setting: str) -> tuple[Function, ...]:
    return (Function("position", (Function("flap"), Function(setting))),)
