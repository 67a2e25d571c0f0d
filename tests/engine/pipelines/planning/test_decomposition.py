"""Inspections are planned part by part, in the order of the sequencer."""

import itertools
import random
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from cellwright.engine.formats.report.plans.itinerary_report import itinerary_entry
from cellwright.engine.formats.report.plans.itinerary_report import itinerary_text as shown
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.model.part_measurements import goal_measurements
from cellwright.engine.model.planning_choices import PlanningObjective, SequenceChoice
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.decomposition import by_sequence
from cellwright.engine.pipelines.planning.decomposition.measurement_order import order_of
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.plan_objective import plan_for_objective
from cellwright.kb.loader import find_target, load
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Term


def text(count: int, seed: int = 1, more: str = "", kinds: str = "") -> str:
    """A problem of `count` points on the bulkhead, of both kinds unless `kinds` names one."""
    chance = random.Random(seed)
    lines = [
        "problem: points",
        "domain: bulkhead",
        "objects:",
        f"  measurement: [m1..{count}]",
        "statics:",
    ]
    for number in range(1, count + 1):
        x, y = chance.randrange(-450_000, 450_000), chance.randrange(-950_000, 950_000)
        kind = kinds or chance.choice(("thickness", "thickness", "profile"))
        lines += [f"  - needs(m{number}, {kind})", f"  - position(m{number}, {x}, {y}, 0)"]
        lines += [f"  - normal(m{number}, 0, 0, -1000)", f"  - tolerance(m{number}, 200)"]
    goals = [f"  - measured(_, _, meas(m{number}))" for number in range(1, count + 1)]
    return "\n".join([*lines, more, "goals:", *goals]) + "\n"


def inspection(folder: Path, written: str) -> Problem:
    path = folder / "points.yaml"
    path.write_text(written)
    problem = load(find_target(str(path))).problem
    assert problem is not None
    return problem


def sequenced(problem: Problem) -> tuple[Found, list[tuple[str, str]]]:
    found = by_sequence(problem)
    assert found is not None
    assert isinstance(found.outcome, Found)
    return found.outcome, list(found.itinerary.visits)


def measured(outcome: Found) -> list[tuple[str, str]]:
    """The measurements of a plan and their tools, in its order."""
    steps = [step.operator for step in outcome.plan.steps]
    return [
        (str(s.arguments[2]), str(s.arguments[0])) for s in steps if s.name.endswith("_measure")
    ]


def test_the_plan_measures_in_the_order_of_the_sequence_with_its_tools(tmp_path: Path) -> None:
    outcome, visits = sequenced(inspection(tmp_path, text(30)))
    assert measured(outcome) == visits


def test_the_arm_travels_from_each_measurement_of_a_tool_to_the_next(tmp_path: Path) -> None:
    outcome, visits = sequenced(inspection(tmp_path, text(20)))
    ways = [
        tuple(map(str, s.operator.arguments[1:]))
        for s in outcome.plan.steps
        if s.operator.name == "move"
    ]
    for (one, tool), (other, same) in itertools.pairwise(visits):
        assert ((f"meas({one})", f"meas({other})") in ways) == (tool == same)


def test_each_tool_is_picked_up_once_and_put_down_before_the_next(tmp_path: Path) -> None:
    outcome, _ = sequenced(inspection(tmp_path, text(25)))
    changes = [s.operator for s in outcome.plan.steps if s.operator.name in ("pick_up", "put_down")]
    assert [each.name for each in changes] == ["pick_up", "put_down", "pick_up"]
    assert changes[0].arguments == changes[1].arguments


def test_the_checker_accepts_the_plan_with_its_links(tmp_path: Path) -> None:
    problem = inspection(tmp_path, text(15))
    outcome, _ = sequenced(problem)
    assert PlanGate().findings(problem, outcome.plan) == []
    needed = {link.consumer for link in outcome.plan.links}
    assert {step.id for step in outcome.plan.steps} <= needed


@pytest.mark.slow
def test_few_parts_are_planned_and_the_others_learned_from_them(tmp_path: Path) -> None:
    outcome, _ = sequenced(inspection(tmp_path, text(40)))
    counts = outcome.statistics.counts
    assert counts["parts planned"] <= 10
    assert counts["operators"] <= 300


@pytest.mark.slow
def test_as_many_operators_are_grounded_for_one_of_many_points_as_for_one_of_few(
    tmp_path: Path,
) -> None:
    sizes = [
        sequenced(inspection(tmp_path, text(count, kinds="thickness")))[0].statistics.counts[
            "operators"
        ]
        for count in (15, 45)
    ]
    assert sizes[0] == sizes[1]


def test_a_plan_of_a_sequence_is_no_worse_than_one_of_the_planner_alone(tmp_path: Path) -> None:
    problem = inspection(tmp_path, text(6))
    own, free = plan_for_objective(problem), plan_for_objective(problem, order=SequenceChoice.FREE)
    assert own.itinerary is not None
    assert free.itinerary is None
    assert isinstance(own.outcome, Found)
    assert isinstance(free.outcome, Found)
    assert own.outcome.plan.cost <= free.outcome.plan.cost


def test_a_goal_that_names_a_tool_is_reached_with_that_tool(tmp_path: Path) -> None:
    written = text(4, kinds="thickness").replace(
        "measured(_, _, meas(m2))", "measured(us_probe, _, meas(m2))"
    )
    assert ("m2", "us_probe") in measured(sequenced(inspection(tmp_path, written))[0])


def test_what_is_asked_for_beside_measurements_comes_last(tmp_path: Path) -> None:
    more = "goals:\n  - location(us_probe, t3_746, in_rack)"
    written = text(4, kinds="thickness").replace("goals:", more)
    outcome, visits = sequenced(inspection(tmp_path, written))
    assert measured(outcome) == visits
    assert outcome.plan.steps[-1].operator.name == "put_down"


def test_measurements_that_hold_already_are_not_made_again(tmp_path: Path) -> None:
    start = "initial:\n  - measured(us_probe, t3_746, meas(m3))"
    outcome, _ = sequenced(inspection(tmp_path, text(6, kinds="thickness", more=start)))
    assert sorted(name for name, _ in measured(outcome)) == ["m1", "m2", "m4", "m5", "m6"]


def test_a_measurement_that_nothing_can_make_has_no_plan_and_the_reason_is_told(
    tmp_path: Path,
) -> None:
    written = text(6, kinds="profile").replace("statics:", "statics:\n  - bore(m4, 1000)")
    found = by_sequence(inspection(tmp_path, written))
    assert found is not None
    assert isinstance(found.outcome, Infeasible)
    assert "m4: slra is too broad for the bore" in found.outcome.reason


def test_other_problems_are_no_inspections() -> None:
    problem = load(find_target("themse/one")).problem
    assert problem is not None
    assert by_sequence(problem) is None


@pytest.mark.parametrize("seed", range(3))
def test_the_ways_of_the_plan_are_those_of_the_tour(tmp_path: Path, seed: int) -> None:
    problem = inspection(tmp_path, text(12, seed, kinds="thickness"))
    found = by_sequence(problem)
    assert found is not None
    assert isinstance(found.outcome, Found)
    places: dict[Term, tuple[int, ...]] = {}
    for fact in problem.statics:
        if fact.name == "position":
            places[fact.arguments[0]] = tuple(int(str(each)) for each in fact.arguments[1:])
    moves = [
        s.operator.arguments[1:] for s in found.outcome.plan.steps if s.operator.name == "move"
    ]
    ways = [[getattr(end, "arguments", ())[0] for end in move] for move in moves]
    length = sum(
        sum((a - b) ** 2 for a, b in zip(places[one], places[other], strict=True)) ** 0.5
        for one, other in ways
        if one in places and other in places
    )
    assert length == pytest.approx(found.itinerary.tour.cost, abs=len(moves))


def test_measurements_that_cannot_be_made_and_that_no_goal_asks_for_are_told(
    tmp_path: Path,
) -> None:
    written = (
        text(4)
        .replace("[m1..4]", "[m1..6]")
        .replace(
            "statics:\n",
            "statics:\n  - needs(m5, profile)\n  - position(m5, 0, 0, 0)\n  - tolerance(m5, 1)\n",
        )
    )
    run = plan_for_objective(inspection(tmp_path, written))
    assert run.itinerary is not None
    assert set(run.itinerary.unasked) == {"m5", "m6"}
    assert run.itinerary.partition.impossible == {}
    assert set(itinerary_entry(run)["sequence"]["partition"]["impossible"]) == {"m5", "m6"}
    console = Console(width=200, record=True, file=StringIO())
    console.print(shown(run, "s"))
    assert "No goal asks for 2 measurements that cannot be made: " in console.export_text()


def test_a_sentence_that_orders_measurements_has_them_made_in_this_order() -> None:
    """A measurement that was made stays made, so nothing but the tour keeps its place in the
    order.
    """
    problem = problem_of("bulkhead/twelve_points", command="measure m9, then m1, then m8")
    outcome = plan_for_objective(problem).outcome
    assert isinstance(outcome, Found)
    names = [step.operator.name for step in outcome.plan.steps]
    made = [
        str(s.operator.arguments[-1])
        for s, n in zip(outcome.plan.steps, names, strict=True)
        if "measure" in n
    ]
    assert made == ["m9", "m1", "m8"]


def test_a_workflow_of_other_acts_is_no_order_of_measurements() -> None:
    problem = problem_of(
        "bulkhead/twelve_points", command="measure m1, then pick up the laser, then measure m2"
    )
    assert order_of(problem, goal_measurements(problem)) is None


def stationed(count: int, seed: int) -> str:
    """`text` with points that are measured from three stations."""
    chance = random.Random(seed)
    stations = (chance.choice(("left", "middle", "right")) for _ in range(count))
    return text(
        count, seed, "".join(f"  - serves({at}, m{n})\n" for n, at in enumerate(stations, 1))
    )


@pytest.mark.parametrize(("count", "seed"), [(4, 1), (4, 8), (7, 3)])
def test_plans_from_several_stations_are_no_worse_than_those_of_the_planner_alone(
    tmp_path: Path, count: int, seed: int
) -> None:
    problem = inspection(tmp_path, stationed(count, seed))
    fast, cheap = (
        plan_for_objective(problem),
        plan_for_objective(problem, objective=PlanningObjective.COST),
    )
    free = plan_for_objective(problem, objective=PlanningObjective.COST, order=SequenceChoice.FREE)
    for own in (fast, cheap):
        assert own.itinerary is not None
        assert own.timetable is not None
        assert free.timetable is not None
        assert own.timetable.schedule.makespan <= free.timetable.schedule.makespan
    assert isinstance(cheap.outcome, Found)
    assert isinstance(free.outcome, Found)
    assert cheap.outcome.plan.cost <= free.outcome.plan.cost


def test_runs_are_put_in_order_from_where_the_arm_stands() -> None:
    """Twenty seconds of driving are saved if the station at which the arm stands comes first."""
    run = plan_for_objective(problem_of("bulkhead/three_stations"))
    assert isinstance(run.outcome, Found)
    assert run.timetable is not None
    assert (run.outcome.plan.cost, run.timetable.schedule.makespan) == (31, 203)
    assert run.itinerary is not None
    assert run.itinerary.altered


def test_runs_of_a_tour_whose_order_is_asked_for_stay_where_they_are(tmp_path: Path) -> None:
    more = "  - before(m1, m2)\n"
    problem = inspection(tmp_path, stationed(5, 2).replace("goals:", f"{more}goals:"))
    found = by_sequence(problem)
    assert found is not None
    assert found.itinerary.fixed
    assert not found.itinerary.altered
