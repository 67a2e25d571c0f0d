from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.loader import load_problem


def test_one_point_takes_the_five_steps_of_figure_4() -> None:
    outcome = checked_plan.plan_problem(load_problem("bulkhead/one_point"))
    assert isinstance(outcome, Found)
    names = [step.operator.name for step in outcome.plan.steps]
    assert names == ["move_retract", "move", "apply_couplant", "move_contact", "us_measure"]
    assert [step.after for step in outcome.plan.steps] == [(), (1,), (2,), (3,), (4,)]


def test_a_tool_that_is_elsewhere_makes_a_profile_infeasible() -> None:
    assert isinstance(checked_plan.plan_problem(load_problem("bulkhead/tool_missing")), Infeasible)
