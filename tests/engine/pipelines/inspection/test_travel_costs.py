"""Travel is declared once: planner, sequencer, scheduler and checker read the same time for
every way.
"""

import dataclasses
import math
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.pipelines.inspection.measurement_points import with_places
from cellwright.engine.pipelines.inspection.tool_tours import partition_by_tool, tour_problem
from cellwright.engine.pipelines.inspection.travel_costs import time_between
from cellwright.engine.pipelines.planning.timetable import keep_plan_order, make_timetable
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.scheduling import check_schedule
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.asp import ground_term
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_domain, load_problem, with_goals
from cellwright.kb.model.domain_model import Domain, Kind, Motion, Predicate, distance_um
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Term

FEW = settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
BULKHEAD = load_problem("bulkhead/both_tools").domain
NAMES = ("m1", "m2", "m3")
RACKS = ("rack(us_probe)", "rack(slra)")
PLACES = (*(f"meas({name})" for name in NAMES), *RACKS)
micrometres = st.integers(-3_000_000, 3_000_000)


def fact(text: str) -> Atom:
    found = ground_term(text)
    assert isinstance(found, Function)
    return found


def term(text: str) -> Term:
    return ground_term(text)


def inspection(domain: Domain, statics: list[str]) -> Problem:
    """Three points for the ultrasonic probe, which is in hand at the first of them."""
    needs = [f"needs({name}, thickness)" for name in NAMES]
    return with_goals(
        domain,
        "at(t3_746, approach_point(meas(m3)))",
        Problem(
            "three",
            domain,
            dict.fromkeys(NAMES, "measurement"),
            tuple(map(fact, (*needs, *statics))),
            (fact("at(t3_746, approach_point(meas(m1)))"), fact("holding(t3_746, us_probe)")),
        ),
    )


@st.composite
def straight(draw: st.DrawFn) -> Problem:
    """Random points, and straight ways between them at a random speed."""
    speed = Fraction(draw(st.integers(1, 10**6)), draw(st.integers(1, 50)))
    settling = Fraction(draw(st.integers(0, 100)), draw(st.integers(1, 10)))
    domain = dataclasses.replace(BULKHEAD, motion=Motion(speed, settling, "bulkhead"))
    points = [[draw(micrometres) for _ in range(3)] for _ in NAMES]
    return inspection(
        domain,
        [f"position({n}, {', '.join(map(str, at))})" for n, at in zip(NAMES, points, strict=True)],
    )


@st.composite
def tabled(draw: st.DrawFn) -> Problem:
    """A random table of times, with each direction for itself."""
    table = Predicate("travel", ("place", "place", "time"), Kind.STATIC)
    domain = dataclasses.replace(
        BULKHEAD, motion=None, predicates={**BULKHEAD.predicates, "travel": table}
    )
    ways = [(a, b) for a in PLACES for b in PLACES if a != b]
    return inspection(domain, [f"travel({a}, {b}, {draw(st.integers(0, 500))})" for a, b in ways])


walks = st.lists(st.sampled_from(PLACES), min_size=1, max_size=8)


def walked(problem: Problem, through: list[str]) -> Plan:
    """Moves through places from the first point to the last, each as long as the ground
    operator says.
    """
    stops = ["meas(m1)"]
    for place in (*through, "meas(m3)"):
        if place != stops[-1]:
            stops.append(place)
    known = {operator.instance: operator.duration for operator in ground(problem).operators}
    steps = []
    for number, (here, there) in enumerate(pairwise(stops), 1):
        move = fact(f"move(t3_746, {here}, {there})")
        after = (StepId(number - 1),) if number > 1 else ()
        steps.append(Step(StepId(number), move, after, (term("t3_746"),), known[move]))
    return Plan(tuple(steps))


@pytest.mark.slow
@given(st.one_of(straight(), tabled()), walks)
@FEW
def test_planner_scheduler_and_checker_agree_on_every_way(
    problem: Problem, through: list[str]
) -> None:
    plan = walked(problem, through)
    assume(plan.steps)
    assert validate_plan(problem, plan) == []
    total = sum(step.duration for step in plan.steps)
    for made in (make_timetable(problem, plan), keep_plan_order(problem, plan)):
        assert isinstance(made, Timetable)
        assert made.schedule.makespan == total
        assert check_schedule(made.shop, made.schedule) == ()
    longer = dataclasses.replace(plan.steps[-1], duration=plan.steps[-1].duration + 1)
    assert [each.code for each in validate_plan(problem, Plan((*plan.steps[:-1], longer)))] == [
        "K508"
    ]


@given(st.one_of(straight(), tabled()), st.permutations(range(3)))
@FEW
def test_the_sequencer_counts_what_the_steps_of_the_plan_take(
    problem: Problem, order: list[int]
) -> None:
    known = {operator.instance: operator.duration for operator in ground(problem).operators}
    tours = tour_problem(problem, partition_by_tool(problem))
    names = [tours.visits[n].name for n in order]
    steps = [fact(f"move(t3_746, meas({a}), meas({b}))") for a, b in pairwise(names)]
    assert time_between(problem, tours, order) == sum(known[step] for step in steps)
    if problem.domain.motion is None:
        assert sum(int(tours.travel[a, b]) for a, b in pairwise(order)) == sum(
            known[s] for s in steps
        )
        assert tours.unit == problem.domain.time_unit


points = st.tuples(micrometres, micrometres, micrometres)


@given(
    points,
    points,
    st.fractions(min_value=Fraction(1, 1000), max_value=10**9, max_denominator=1000),
    st.fractions(min_value=0, max_value=1000, max_denominator=1000),
)
def test_a_time_is_the_least_whole_number_in_which_the_way_can_be_made(
    here: tuple[int, int, int], there: tuple[int, int, int], speed: Fraction, settling: Fraction
) -> None:
    squared = sum((a - b) ** 2 for a, b in zip(here, there, strict=True))

    def enough(time: int) -> bool:
        moving = time - settling
        return moving >= 0 and (moving * speed) ** 2 >= squared

    found = Motion(speed, settling).time(here, there)
    assert enough(found)
    assert not enough(found - 1)


@given(points, points)
def test_a_distance_is_rounded_to_the_nearest_micrometre(
    here: tuple[int, int, int], there: tuple[int, int, int]
) -> None:
    squared = sum((a - b) ** 2 for a, b in zip(here, there, strict=True))
    found = distance_um(here, there)
    assert (2 * found - 1) ** 2 <= 4 * squared or found == 0
    assert 4 * squared <= (2 * found + 1) ** 2
    assert found == distance_um(there, here)
    assert abs(found - math.dist(here, there)) <= 1


def test_the_cell_gives_the_places_of_the_racks_seen_from_the_part() -> None:
    problem = load_problem("bulkhead/both_tools")
    known = {operator.instance: operator.duration for operator in ground(problem).operators}
    there = known[fact("move(t3_746, meas(m2), rack(us_probe))")]
    assert there == known[fact("move(t3_746, rack(us_probe), meas(m2))")]
    way = math.dist((0, -0.75, 0), (0.6, -1.4, -1.75))  # in the frame of the bulkhead, in metres
    assert there == math.ceil(0.5 + way / 0.25)


@pytest.mark.parametrize("listed", [[], ["travel(meas(m1), meas(m2), 4)"]])
def test_what_the_sequencer_cannot_tell_is_reported(listed: list[str], tmp_path: Path) -> None:
    table = Predicate("travel", ("place", "place", "time"), Kind.STATIC)
    domain = dataclasses.replace(
        BULKHEAD,
        motion=None,
        predicates={**BULKHEAD.predicates, "travel": table},
        path=str(tmp_path),
    )
    problem = inspection(domain, listed)
    with pytest.raises(InvalidInput) as caught:
        tour_problem(problem, partition_by_tool(problem))
    assert [each.code for each in caught.value.diagnostics] == ["K115"]
    assert "is not known" in str(caught.value)


def test_a_measurement_needs_no_position_where_a_table_tells_the_ways() -> None:
    table = Predicate("travel", ("place", "place", "time"), Kind.STATIC)
    domain = dataclasses.replace(
        BULKHEAD, motion=None, predicates={**BULKHEAD.predicates, "travel": table}
    )
    problem = inspection(domain, [f"travel({a}, {b}, 3)" for a in PLACES for b in PLACES if a != b])
    assert partition_by_tool(problem).groups == {"us_probe": NAMES}


def test_positions_of_the_cell_and_of_facts_are_seen_from_one_frame() -> None:
    """m1 comes from a fact in the frame of the part, m2 from the cell: their distance is that
    of the drawing.
    """
    problem = inspection(BULKHEAD, ["position(m1, -300000, -750000, 0)"])
    tours = tour_problem(with_places(problem), partition_by_tool(with_places(problem)))
    assert int(tours.travel[0, 1]) == 300_000


@pytest.mark.parametrize(
    ("speed", "settling", "expected"),
    [
        ("250 mm/s", "500 ms", Motion(Fraction(250_000), Fraction(1, 2))),
        ("15 m / min", "", Motion(Fraction(250_000))),
        ("0.5 in/second", "1 min", Motion(Fraction(12_700), Fraction(60))),
        ("1cm/s", "2", Motion(Fraction(10_000), Fraction(2))),
    ],
)
def test_speeds_and_times_have_units(
    speed: str, settling: str, expected: Motion, tmp_path: Path
) -> None:
    said = f"domain: bare\nmotion:\n  speed: {speed}\n" + (
        f"  settling: {settling}\n" if settling else ""
    )
    (tmp_path / "domain.yaml").write_text(said, "utf-8")
    assert load_domain(str(tmp_path)).motion == expected


@pytest.mark.parametrize(
    ("section", "code"),
    [
        ("speed: nan mm/s", "K005"),
        ("speed: inf m/s", "K005"),
        ("speed: 250", "K005"),
        ("speed: 250 mm", "K005"),
        ("speed: -250 mm/s", "K005"),
        ("speed: 250 mm/year", "K005"),
        ("speed: 0.0 mm/s", "K113"),
        ("speed: 99999999 m/s", "K113"),
        ("speed: 1 m/s\n  settling: nan", "K005"),
        ("speed: 1 m/s\n  settling: -1", "K005"),
        ("speed: 1 m/s\n  settling: 9999999 h", "K113"),
        ("speed: [1, 2]", "K005"),
        ("settling: 1 s", "K005"),
        ("velocity: 1 m/s", "K005"),
    ],
)
def test_what_is_no_speed_or_time_is_reported_at_its_place(
    section: str, code: str, tmp_path: Path
) -> None:
    (tmp_path / "domain.yaml").write_text(f"domain: bare\nmotion:\n  {section}\n", "utf-8")
    with pytest.raises(InvalidInput) as caught:
        load_domain(str(tmp_path))
    assert {each.code for each in caught.value.diagnostics} == {code}
    assert all(each.where.line in (2, 3, 4) for each in caught.value.diagnostics)
