"""A plan in which a step may not be taken any more is patched there: a checked plan, and the same steps elsewhere."""

from dataclasses import replace

import pytest

from cellwright.engine.model.moves import Unmoved
from cellwright.engine.model.outcome import Found, Infeasible, Outcome
from cellwright.engine.pipelines import objective
from cellwright.engine.pipelines.moves.bars import without_blocked
from cellwright.engine.pipelines.moves.leaving_out import within_reach
from cellwright.engine.pipelines.objective import Run
from cellwright.engine.pipelines.parts.patching import patched
from cellwright.engine.pipelines.planning import problem_of
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.validation import validate
from cellwright.kb.model.plan import Step
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function


@pytest.fixture(scope="module")
def problem() -> Problem:
    """Three points; one of them is reached from two stations."""
    given = problem_of("bulkhead/three_stations")
    more = Function("serves", (Function("left"), Function("b1")))
    return replace(given, statics=(*given.statics, more))


@pytest.fixture(scope="module")
def run(problem: Problem) -> Run:
    return objective.plan(problem, Limits())


def step_to(run: Run, point: str) -> Step:
    """The step that goes before a point."""
    assert isinstance(run.outcome, Found)
    return next(each for each in run.outcome.plan.steps if str(each.operator).endswith(f"meas({point}))"))


def barred(problem: Problem, step: Step, *regardless: int) -> Problem:
    """The problem without a step, whatever some of its arguments are."""
    one = Unmoved(step.id, step.operator, "", "way", "", regardless=frozenset(regardless))
    return without_blocked(problem, [one])


def again(problem: Problem, run: Run, step: Step) -> Outcome | None:
    """The plan of a run, patched where a step is barred."""
    assert isinstance(run.outcome, Found)
    assert run.itinerary is not None
    return patched(problem, run.outcome.plan, run.itinerary, step.id)


def test_another_station_serves_where_the_first_one_is_barred(problem: Problem, run: Run) -> None:
    step = step_to(run, "b1")
    asked = barred(problem, step, 0, 2)
    found = again(asked, run, step)
    assert isinstance(found, Found)
    assert isinstance(run.outcome, Found)
    assert not validate(asked, found.plan)
    old = [each.operator for each in run.outcome.plan.steps]
    new = [each.operator for each in found.plan.steps]
    at = old.index(step.operator)
    assert step.operator not in new
    assert new[: at - 3] == old[: at - 3]
    assert new[-1] == old[-1]


def test_a_measurement_that_is_given_up_is_left_out_and_nothing_else(problem: Problem, run: Run) -> None:
    step = step_to(run, "b1")
    asked, given_up = within_reach(barred(problem, step), {"b1": "no way leads there"})
    found = again(asked, run, step)
    assert len(given_up) == 1
    assert isinstance(found, Found)
    assert not validate(asked, found.plan)
    assert all("b1" not in str(each.operator) for each in found.plan.steps)


def test_a_part_without_a_plan_of_its_own_is_infeasible(problem: Problem, run: Run) -> None:
    step = step_to(run, "a2")
    found = again(barred(problem, step, 0, 1, 2), run, step)
    assert isinstance(found, Infeasible)
    assert "a2" in found.reason
