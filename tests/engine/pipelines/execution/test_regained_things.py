"""What a repair has put right is used again in the rest of a run."""

from cellwright.engine.model.troubleshooting import Revision
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.pipelines.planning import checked_plan


def test_what_was_lost_and_is_put_right_is_used_again() -> None:
    problem = checked_plan.problem_of("bulkhead/both_tools")
    whole = RunScope(problem)
    without = whole.changed(Revision(lost=("us_probe",)))
    assert without.lost == ("us_probe",)
    assert without.problem.domain != problem.domain
    again = without.changed(Revision(regained=("us_probe",)))
    assert again.lost == ()
    assert again.problem == problem


def test_other_things_stay_lost() -> None:
    problem = checked_plan.problem_of("bulkhead/both_tools")
    both = RunScope(problem).changed(Revision(lost=("us_probe",))).changed(Revision(lost=("slra",)))
    once = both.changed(Revision(regained=("us_probe",)))
    assert once.lost == ("slra",)
    assert once.problem.domain == RunScope(problem).changed(Revision(lost=("slra",))).problem.domain
