"""Twelve tasks with maximum lags: the search finds plans as short as a constraint model allows."""

from pathlib import Path

import pytest

from cellwright.engine.model.temporal import PlannedInTime
from cellwright.engine.pipelines.planning.temporal_plans import TimeEffort, plan_with_times
from tests.lag_tasks import TASKS
from tests.slow_time import Slow
from tests.timed_examples import task_of

# the epsilons between instants, and the part of a unit by which a lag may be longer in PDDL
SMALL = 0.1


@pytest.mark.parametrize("name", TASKS)
def test_a_shortest_plan_keeps_maximum_lags(name: str, tmp_path: Path) -> None:
    task, optimum = TASKS[name]
    assert task.least_makespan() == optimum
    problem = task_of(tmp_path, task.domain(), task.problem()).problem
    outcome = plan_with_times(problem, TimeEffort(expansions=5000))
    assert isinstance(outcome, PlannedInTime)
    assert Slow(problem).accepts(outcome.plan)
    assert abs(float(outcome.plan.makespan) - optimum) < SMALL
    assert outcome.bound <= outcome.plan.makespan


def test_a_lag_that_is_too_short_has_no_plan_but_is_not_taken_for_proved(tmp_path: Path) -> None:
    task, _ = TASKS["mixture"]
    longest = {("acid", "mix"): 4, ("base", "mix"): 11}
    short = type(task)(task.jobs, tuple((a, b, longest[a, b]) for a, b, _ in task.lags))
    assert short.least_makespan() is None
    problem = task_of(tmp_path, short.domain(), short.problem()).problem
    assert not isinstance(plan_with_times(problem, TimeEffort(expansions=300)), PlannedInTime)
