"""Plans with fewer batches: the order in which dear steps come late, and stretches that are
planned anew.
"""

from itertools import pairwise

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning.forward.forward_search import start_forward_search
from cellwright.engine.stages.planning.improvement.batch_reduction import (
    reduce_batches,
    repeat_stretches,
)
from cellwright.engine.stages.planning.improvement.plan_reordering import delay_dear_steps
from cellwright.engine.stages.planning.improvement.window_optimisation import steps_cost
from cellwright.engine.stages.planning.search_control import Effort, SearchResult
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.planning_problem import Problem
from tests.properties.problems import problems

SOME = settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
DERIVING = st.one_of(problems(), problems(deductive=True))


def planned(problem: Problem, seed: int) -> tuple[GroundTask, list[GroundOperator]]:
    """A task, and steps of a forward search to its goals."""
    try:
        task = ground(problem)
    except InvalidInput:
        assume(False)
    assume(bool(task.goals))
    found = start_forward_search(task, seed).run(Effort(2000))
    assume(isinstance(found, SearchResult) and bool(found.steps))
    assert found is not None
    assert found.steps is not None
    return task, found.steps


def end(task: GroundTask, steps: list[GroundOperator]) -> Bits:
    """The state after steps, each of which can be done."""
    state = task.initial
    for step in steps:
        assert not step.preconditions & ~state
        state = task.after(state, step)
    return state


@given(DERIVING, st.integers(0, 3))
@SOME
def test_the_order_with_dear_steps_late_has_the_same_effect(problem: Problem, seed: int) -> None:
    task, steps = planned(problem, seed)
    ordered = delay_dear_steps(task, steps)
    assert sorted(map(id, ordered)) == sorted(map(id, steps))
    assert end(task, ordered) == end(task, steps)


@given(DERIVING, st.integers(0, 3))
@SOME
def test_every_plan_with_fewer_batches_reaches_the_goals_and_costs_less(
    problem: Problem, seed: int
) -> None:
    task, steps = planned(problem, seed)
    found = list(reduce_batches(task, steps, Effort(3000)))
    for each in found:
        state = end(task, each)
        assert any(not goal & ~state for goal in task.goals)
    assert all(
        steps_cost(better) < steps_cost(worse) for worse, better in pairwise([steps, *found[1:]])
    )


@given(DERIVING, st.integers(0, 3))
@SOME
def test_a_stretch_has_a_step_twice(problem: Problem, seed: int) -> None:
    task, steps = planned(problem, seed)
    for stretch in repeat_stretches(task, steps):
        names = [step.instance.name for step in steps[stretch.first : stretch.end]]
        assert len(set(names)) < len(names)


@given(DERIVING)
@SOME
def test_no_effort_leaves_the_plan_alone(problem: Problem) -> None:
    task, steps = planned(problem, 0)
    assert list(reduce_batches(task, steps, Effort(0))) == []
