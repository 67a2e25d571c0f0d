"""Settings of a workflow are made in their turn where that costs nothing, and where it does,
when the plan needs them.
"""

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan, plan_objective
from cellwright.engine.pipelines.planning.makespan_plans import delay_settings
from cellwright.kb.model.planning_problem import Problem


def operators(problem: Problem) -> list[str]:
    run = plan_objective.plan_for_objective(problem)
    assert isinstance(run.outcome, Found)
    return [str(step.operator) for step in run.outcome.plan.steps]


def test_what_is_named_first_is_done_first() -> None:
    said = "read the wrist force before opening the drawer"
    assert operators(checked_plan.problem_of("themse", command=said)) == [
        "sense(wrist_force)",
        "open_drawer",
    ]


def test_a_plan_searched_the_other_way_round_is_turned() -> None:
    posed = checked_plan.problem_of(
        "themse", command="read the wrist force before opening the drawer"
    )
    outcome, task = checked_plan.plan_and_ground(posed)
    assert isinstance(outcome, Found)
    turned = delay_settings(posed, task, outcome.plan)
    assert [step.operator.name for step in turned.steps] == ["sense", "open_drawer"]
    assert turned.steps[1].after == (turned.steps[0].id,)
    assert checked_plan.check_plan(posed, turned) == []
    assert delay_settings(posed, task, turned) == turned


def test_what_the_plan_needs_earlier_stays_there() -> None:
    said = "heat probe 1 for 5 min, then close the flap"
    names = operators(checked_plan.problem_of("themse", command=said))
    assert names[-2:] == ["press_switch(open, closed)", "heat(probe_1, slot(furnace, 1), 300)"]
