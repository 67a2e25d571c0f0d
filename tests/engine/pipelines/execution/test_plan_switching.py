"""Plans joined with what is under way share the ground tasks in which they are looked at."""

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.execution.plan_switching import SwitchTasks
from cellwright.engine.pipelines.planning.checked_plan import problem_of, search_plan, task_for
from cellwright.kb.model.plan_model import Plan


def test_plans_that_name_the_same_share_a_task_which_is_that_of_each() -> None:
    problem = problem_of("themse/two")
    outcome, _ = search_plan(problem)
    assert isinstance(outcome, Found)
    plan = outcome.plan
    turned, shorter = Plan(tuple(reversed(plan.steps))), Plan(plan.steps[:3])
    tasks = SwitchTasks(problem)
    task = tasks.task_of(plan)
    assert tasks.task_of(turned) is task
    assert tasks.task_of(shorter) is not task
    for looked_at in (plan, shorter):
        fresh = task_for(problem, looked_at)
        own = tasks.task_of(looked_at)
        assert [step.instance for step in own.operators] == [
            step.instance for step in fresh.operators
        ]
        assert (own.initial, own.atoms) == (fresh.initial, fresh.atoms)
