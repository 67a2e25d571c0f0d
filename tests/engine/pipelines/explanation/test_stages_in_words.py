"""Reasons of steps name stages of a workflow in words."""

from cellwright.engine.formats.report.plans.explanation_report import step_reason
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.explanation.step_purposes import explain_step
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.kb.loader import load_problem


def test_a_stage_that_a_later_step_waits_for_is_said_in_words() -> None:
    problem = load_problem("centrifuge/four")
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    task = ground(problem)
    said = "\n".join(
        step_reason(explain_step(task, outcome.plan, step.id)).plain for step in outcome.plan.steps
    )
    assert "stage 1 of 1:" in said
    assert "_stage" not in said
