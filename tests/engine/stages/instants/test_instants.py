"""The checker of time: each broken condition with its amount, and the same verdict as a slow
checker on mutants of plans.
"""

import random
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest

from cellwright.engine.model.temporal import PlannedInTime
from cellwright.engine.pipelines.planning.temporal_plans import TimeEffort, plan_with_times
from cellwright.engine.stages.instants import breaches
from cellwright.kb.model.durative import TemporalProblem, TimedPlan, TimedStep
from cellwright.kb.terms import Function
from tests.slow_time import Slow
from tests.timed_examples import CELLAR, FUSES, HATCH, PATROL, ROUND, WINDOW, task_of

TASKS = {"cellar": (CELLAR, FUSES), "patrol": (PATROL, ROUND), "hatch": (HATCH, WINDOW)}
MILLI = Fraction(1, 1000)


def step(start: str, action: str, *objects: str, duration: str) -> TimedStep:
    return TimedStep(
        Fraction(start), Function(action, tuple(map(Function, objects))), Fraction(duration)
    )


def good() -> list[TimedStep]:
    return [
        step("0", "strike", "m1", duration="5"),
        step("0", "mend", "f1", "m1", duration="2"),
        step("2.001", "mend", "f2", "m1", duration="2"),
        step("4", "strike", "m2", duration="5"),
        step("4.002", "mend", "f3", "m2", duration="2"),
    ]


def said(
    problem: TemporalProblem, steps: list[TimedStep]
) -> list[tuple[str, Fraction | None, str]]:
    return [
        (each.code, each.amount, each.message)
        for each in breaches(problem, TimedPlan(tuple(steps)))
    ]


@pytest.fixture
def cellar(tmp_path: Path) -> TemporalProblem:
    return task_of(tmp_path, CELLAR, FUSES).problem


def test_a_right_plan_has_no_breaches(cellar: TemporalProblem) -> None:
    assert said(cellar, good()) == []


def test_a_condition_over_all_may_begin_at_the_start_and_stop_at_the_end(
    cellar: TemporalProblem,
) -> None:
    late = [
        *good()[:2],
        step("3", "mend", "f2", "m1", duration="2"),
        *good()[3:4],
        step("5.001", "mend", "f3", "m2", duration="2"),
    ]
    assert said(cellar, late) == []


def test_a_duration_is_told_with_what_it_is_off_by(cellar: TemporalProblem) -> None:
    steps = good()
    steps[4] = replace(steps[4], duration=Fraction(5, 2))
    assert [(code, amount) for code, amount, _ in said(cellar, steps)] == [("K501", Fraction(1, 2))]


def test_instants_that_touch_the_same_are_epsilon_apart(cellar: TemporalProblem) -> None:
    steps = good()
    steps[2] = replace(steps[2], start=Fraction("2.0004"))
    assert [(code, amount) for code, amount, _ in said(cellar, steps)] == [
        ("K503", Fraction("0.0006"))
    ]
    steps[2] = replace(steps[2], start=Fraction(2))
    assert ("K503", MILLI) in [(code, amount) for code, amount, _ in said(cellar, steps)]


def test_light_that_goes_out_is_told_with_its_time(cellar: TemporalProblem) -> None:
    steps = good()
    steps[2] = replace(steps[2], start=Fraction("3.5"))
    steps[4] = replace(steps[4], start=Fraction("5.501"))
    messages = [message for _, _, message in said(cellar, steps)]
    assert messages == [
        "step 3 mend(f2, m1): light(m1) does not hold throughout: it fails from 5 on"
    ]


def test_the_goal_is_read_at_the_end(cellar: TemporalProblem) -> None:
    assert [code for code, _, _ in said(cellar, good()[:4])] == ["K502"]


def test_a_number_that_is_too_small_is_told_with_what_it_lacks(tmp_path: Path) -> None:
    problem = task_of(tmp_path, PATROL, ROUND).problem
    steps = [
        step("0", "move", "r2d2", "wp1", "wp2", duration="5"),
        step("5.001", "move", "r2d2", "wp2", "wp3", duration="5"),
        step("10.002", "patrol", "r2d2", "wp3", duration="5"),
    ]
    assert [(code, amount) for code, amount, _ in said(problem, steps)] == [("K501", Fraction(8))]


def test_the_goal_must_outlast_timed_literals(tmp_path: Path) -> None:
    problem = task_of(
        tmp_path, HATCH, WINDOW.replace("(and (loaded) (washed))", "(and (loaded) (open))")
    ).problem
    steps = [step("10", "load", duration="3")]
    assert [(code, message) for code, _, message in said(problem, steps)] == [
        ("K502", "the goal open does not hold at the end")
    ]


def mutant(plan: TimedPlan, chance: random.Random) -> TimedPlan:
    """A plan with one to three small changes."""
    steps = list(plan.steps)
    for _ in range(chance.randint(1, 3)):
        place = chance.randrange(len(steps))
        shift = Fraction(
            chance.choice((-2000, -500, -2, -1, 1, 2, 500, 1000, 3000)),
            chance.choice((1000, 1000, 2000)),
        )
        kind = chance.randrange(5)
        if kind == 0 and len(steps) > 1:
            steps.pop(place)
        elif kind == 1:
            steps[place] = replace(steps[place], start=max(Fraction(0), steps[place].start + shift))
        elif kind == 2:
            steps = [
                replace(each, start=each.start + abs(shift))
                if each.start >= steps[place].start
                else each
                for each in steps
            ]
        elif kind == 3:
            steps[place] = replace(
                steps[place], duration=max(Fraction(0), steps[place].duration + shift)
            )
        else:
            steps[place] = replace(steps[place], start=steps[chance.randrange(len(steps))].start)
    return TimedPlan(tuple(sorted(steps, key=lambda each: each.start)))


@pytest.mark.parametrize("name", TASKS)
def test_the_slow_checker_says_the_same_of_mutants(name: str, tmp_path: Path) -> None:
    problem = task_of(tmp_path, *TASKS[name]).problem
    outcome = plan_with_times(problem, TimeEffort(expansions=2000))
    assert isinstance(outcome, PlannedInTime)
    slow, chance = Slow(problem), random.Random(47)
    assert slow.accepts(outcome.plan)
    verdicts = []
    for _ in range(200):
        plan = mutant(outcome.plan, chance)
        mine = not breaches(problem, plan)
        assert mine == slow.accepts(plan), plan
        verdicts.append(mine)
    assert 0 < sum(verdicts) < 200
