"""Schedules that keep the order of a plan: longest paths, with the ways of the arm, for plans
of any length.
"""

from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.engine.formats.report.plans.gantt_chart import BarKind, GanttBar, join_short_bars
from cellwright.engine.formats.report.plans.gantt_svg import draw_gantt
from cellwright.engine.model.plan_times import (
    Bottleneck,
    TimeShare,
    earliest_starts,
    find_bottleneck,
)
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.pipelines.planning import timetable as module
from cellwright.engine.pipelines.planning.timetable import keep_plan_order, make_timetable
from cellwright.engine.pipelines.planning.timetable.kept_order import (
    MAX_SCHEDULED_STEPS,
    SCOPE_KEPT_ORDER,
)
from cellwright.engine.stages.scheduling import check_schedule
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.asp import ground_term
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_problem
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function

DOMAIN = """
domain: yard
units: {{time: s}}
types: {{place: object, arm: object}}
objects: {{arm: [crane, truck], place: [p0..9]}}
{travel}
statics:
  position(place, int, int, int): {{}}
{statics}
fluents:
  waved(arm, place): {{}}
  ready: {{}}
operators:
  wave(Arm, Place):
    preconditions: ready
    adds: waved(Arm, Place)
    resources: Arm
    duration: 2 s
"""
PROBLEM = """
problem: signals
domain: yard
statics:
{facts}
initial: [ready]
goals: [ready]
"""
MOTION = "motion: {speed: 1 m/s}"
TABLE = "  travel(place, place, time): {}"


def yard(
    folder: Path, travel: str = MOTION, statics: str = "", facts: tuple[str, ...] = ()
) -> Problem:
    """Ten places a metre and more apart, and two arms that wave there."""
    positions = tuple(f"position(p{n}, {n * n * 1_000_000}, 0, 0)" for n in range(10))
    folder.mkdir(exist_ok=True)
    (folder / "domain.yaml").write_text(DOMAIN.format(travel=travel, statics=statics), "utf-8")
    lines = "\n".join(f"  - {fact}" for fact in (*positions, *facts))
    (folder / "problem.yaml").write_text(PROBLEM.format(facts=lines), "utf-8")
    return load_problem(str(folder / "problem.yaml"))


def waves(*visits: tuple[str, int]) -> Plan:
    """Waves of arms at places; those of one arm come one after another."""
    steps: list[Step] = []
    last: dict[str, StepId] = {}
    for number, (arm, place) in enumerate(visits, 1):
        operator = ground_term(f"wave({arm}, p{place})")
        assert isinstance(operator, Function)
        after = (last[arm],) if arm in last else ()
        steps.append(Step(StepId(number), operator, after, (Function(arm),), 2))
        last[arm] = StepId(number)
    return Plan(tuple(steps))


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    return yard(tmp_path_factory.mktemp("yard"))


visits = st.lists(
    st.tuples(st.sampled_from(["crane", "truck"]), st.integers(0, 9)), min_size=1, max_size=9
)


@given(visits)
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
def test_each_step_starts_as_soon_as_its_order_and_the_way_of_the_arm_allow(
    problem: Problem, said: list[tuple[str, int]]
) -> None:
    plan = waves(*said)
    assert validate_plan(problem, plan) == []
    made = keep_plan_order(problem, plan)
    held = [arm for arm, _ in said]
    busiest = min(set(held), key=lambda arm: (-held.count(arm), arm))
    now: dict[str, tuple[int, int]] = {}
    for step, (arm, place) in zip(plan.steps, said, strict=True):
        free, here = now.get(arm, (0, place))
        start = free + (abs(place**2 - here**2) if arm == busiest else 0)
        assert made.starts[step.id] == start
        now[arm] = start + 2, place
    assert made.schedule.makespan == max(free for free, _ in now.values())
    assert made.schedule.proved
    assert made.scope == SCOPE_KEPT_ORDER
    assert check_schedule(made.shop, made.schedule) == ()


def test_a_table_lists_the_ways_that_take_time(tmp_path: Path) -> None:
    facts = ("travel(p0, p1, 7)", "travel(p1, p0, 9)")
    problem = yard(tmp_path / "table", "", TABLE, facts)
    made = keep_plan_order(problem, waves(("crane", 0), ("crane", 1), ("crane", 0), ("crane", 2)))
    assert list(made.starts.values()) == [0, 9, 20, 22]


def test_a_fact_tells_the_time_of_its_pair_and_the_motion_that_of_all_others(
    tmp_path: Path,
) -> None:
    problem = yard(tmp_path / "both", MOTION, TABLE, ("travel(p0, p1, 50)",))
    made = keep_plan_order(problem, waves(("crane", 0), ("crane", 1), ("crane", 0)))
    assert list(made.starts.values()) == [0, 52, 55]


def test_a_way_that_cannot_be_told_is_reported(tmp_path: Path) -> None:
    problem = yard(tmp_path / "negative", "", TABLE, ("travel(p0, p1, -7)",))
    with pytest.raises(InvalidInput) as caught:
        keep_plan_order(problem, waves(("crane", 0), ("crane", 1)))
    assert [each.code for each in caught.value.diagnostics] == ["K115"]


def test_the_solver_adds_the_ways_of_a_motion_as_well(problem: Problem) -> None:
    made = make_timetable(problem, waves(("crane", 0), ("crane", 1), ("crane", 2)))
    assert isinstance(made, Timetable)
    assert made.schedule.makespan == 3 * 2 + 4


def test_long_plans_are_timed_without_grounding_and_their_charts_stay_small(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise AssertionError("a long plan was grounded")

    monkeypatch.setattr(module, "task_for", refused)
    made = make_timetable(problem, circling(MAX_SCHEDULED_STEPS + 20))
    assert isinstance(made, Timetable)
    assert "more than 400 steps" in made.note
    monkeypatch.setattr(module, "_checked_plan", refused)
    long = keep_plan_order(problem, circling(12 * MAX_SCHEDULED_STEPS))
    ways = sum(
        abs((n % 10) ** 2 - ((n + 1) % 10) ** 2) for n in range(12 * MAX_SCHEDULED_STEPS - 1)
    )
    assert long.schedule.makespan == ways + 24 * MAX_SCHEDULED_STEPS
    assert len(draw_gantt(long.shop, long.schedule)) < 2_000_000


def circling(steps: int) -> Plan:
    """The crane waves at one place after another, round and round."""
    return waves(*(("crane", n % 10) for n in range(steps)))


bars = st.lists(st.tuples(st.integers(0, 30), st.integers(1, 40)), min_size=1, max_size=80)


@given(bars, st.floats(0.5, 60))
def test_joined_bars_are_few_and_cover_what_the_bars_cover(
    gaps: list[tuple[int, int]], least: float
) -> None:
    made: list[GanttBar] = []
    for gap, length in gaps:
        start = (made[-1].end if made else 0) + gap
        made.append(GanttBar(start, start + length, "x", BarKind.STAGE))
    found = join_short_bars(made, least)
    assert all(one.end <= other.start for one, other in pairwise(found))
    assert (found[0].start, found[-1].end) == (made[0].start, made[-1].end)
    for bar in made:
        assert any(each.start <= bar.start and bar.end <= each.end for each in found)
    assert all(each in made or each.end - each.start < least for each in found)
    assert len(found) <= 2 * (made[-1].end / least + 1)


def test_what_bounds_a_makespan_is_a_resource_that_never_rests_or_a_chain() -> None:
    busy = waves(("crane", 0), ("truck", 1), ("crane", 2))
    assert find_bottleneck(busy, earliest_starts(busy)) == Bottleneck(
        Function("crane"), (TimeShare("wave", 2, 4),)
    )
    waited = {StepId(1): 0, StepId(2): 0, StepId(3): 5}
    assert find_bottleneck(busy, waited) == Bottleneck(None, (TimeShare("wave", 2, 4),), 3)
    assert find_bottleneck(Plan(()), {}) == Bottleneck(None, ())
