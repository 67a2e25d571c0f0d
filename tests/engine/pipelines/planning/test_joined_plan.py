"""A plan in which a step may not be taken any more is patched there: a checked plan, and the
same steps elsewhere.
"""

from dataclasses import replace

import pytest

from cellwright.engine.model.motion_values import Unmoved
from cellwright.engine.model.outcome import Found, Infeasible, Outcome
from cellwright.engine.pipelines.planning import plan_objective
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.decomposition.joined_plan import patch_plan
from cellwright.engine.pipelines.planning.goal_selection import drop_unreachable_goals
from cellwright.engine.pipelines.planning.plan_objective import Run
from cellwright.engine.pipelines.planning.restrictions import forbid_unreachable_steps
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.model.plan_model import Step
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function


@pytest.fixture(scope="module")
def problem() -> Problem:
    """Three points; one of them is reached from two stations."""
    given = problem_of("bulkhead/three_stations")
    more = Function("serves", (Function("left"), Function("b1")))
    return replace(given, statics=(*given.statics, more))


@pytest.fixture(scope="module")
def run(problem: Problem) -> Run:
    return plan_objective.plan_for_objective(problem, SearchLimits())


def step_to(run: Run, point: str) -> Step:
    """The step that goes before a point."""
    assert isinstance(run.outcome, Found)
    return next(
        each for each in run.outcome.plan.steps if str(each.operator).endswith(f"meas({point}))")
    )


def barred(problem: Problem, step: Step, *regardless: int) -> Problem:
    """The problem without a step, whatever some of its arguments are."""
    one = Unmoved(step.id, step.operator, "", "way", "", regardless=frozenset(regardless))
    return forbid_unreachable_steps(problem, [one])


def again(problem: Problem, run: Run, step: Step) -> Outcome | None:
    """The plan of a run, patched where a step is barred."""
    assert isinstance(run.outcome, Found)
    assert run.itinerary is not None
    return patch_plan(problem, run.outcome.plan, run.itinerary, step.id)


def test_another_station_serves_where_the_first_one_is_barred(problem: Problem, run: Run) -> None:
    step = step_to(run, "b1")
    asked = barred(problem, step, 0, 2)
    found = again(asked, run, step)
    assert isinstance(found, Found)
    assert isinstance(run.outcome, Found)
    assert not validate_plan(asked, found.plan)
    old = [each.operator for each in run.outcome.plan.steps]
    new = [each.operator for each in found.plan.steps]
    at = old.index(step.operator)
    assert step.operator not in new
    before = max(at - 3, 0)
    assert new[:before] == old[:before]
    assert new[-1] == old[-1]


def test_a_measurement_that_is_given_up_is_left_out_and_nothing_else(
    problem: Problem, run: Run
) -> None:
    step = step_to(run, "b1")
    asked, given_up = drop_unreachable_goals(barred(problem, step), {"b1": "no way leads there"})
    found = again(asked, run, step)
    assert len(given_up) == 1
    assert isinstance(found, Found)
    assert not validate_plan(asked, found.plan)
    assert all("b1" not in str(each.operator) for each in found.plan.steps)


def test_a_part_without_a_plan_of_its_own_is_infeasible(problem: Problem, run: Run) -> None:
    step = step_to(run, "a2")
    found = again(barred(problem, step, 0, 1, 2), run, step)
    assert isinstance(found, Infeasible)
    assert "a2" in found.reason
