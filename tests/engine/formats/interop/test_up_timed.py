"""Problems in time of unified-planning: planned, and the plans accepted by its own validator."""

from pathlib import Path

import pytest

pytest.importorskip("unified_planning")

from unified_planning.engines import PlanGenerationResultStatus as Status
from unified_planning.engines import ValidationResultStatus
from unified_planning.engines.results import FailedValidationReason
from unified_planning.io import PDDLReader
from unified_planning.plans import TimeTriggeredPlan
from unified_planning.shortcuts import (
    GlobalStartTiming,
    PlanValidator,
    Problem,
    get_environment,
)
from unified_planning.test.examples import get_example_problems

from cellwright.engine.formats.interop.up import CellwrightEngine
from tests.timed_examples import CELLAR, FUSES, PATROL, ROUND

EXAMPLES = {
    name: each
    for name, each in get_example_problems().items()
    if each.problem.kind.has_continuous_time() and CellwrightEngine.supports(each.problem.kind)
}
PAIRS = ("wp1 wp1", "wp2 wp2", "wp3 wp3", "wp2 wp1", "wp3 wp2", "wp1 wp3")
REST = " ".join(f"(= (distance {pair}) 99)" for pair in PAIRS)
FULL = ROUND.replace("(= (distance wp1 wp2) 10)", f"(= (distance wp1 wp2) 10) {REST}")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("domain", "problem"), [(CELLAR, FUSES), (PATROL, FULL)], ids=["cellar", "patrol"]
)
def test_a_plan_in_time_is_accepted_by_the_library(
    domain: str, problem: str, tmp_path: Path
) -> None:
    get_environment().credits_stream = None
    (tmp_path / "d.pddl").write_text(domain, "utf-8")
    (tmp_path / "p.pddl").write_text(problem, "utf-8")
    theirs = PDDLReader().parse_problem(str(tmp_path / "d.pddl"), str(tmp_path / "p.pddl"))
    assert CellwrightEngine.supports(theirs.kind)
    result = CellwrightEngine().solve(theirs)
    assert result.status in (Status.SOLVED_SATISFICING, Status.SOLVED_OPTIMALLY)
    with PlanValidator(problem_kind=theirs.kind, plan_kind=result.plan.kind) as judge:
        assert judge.validate(theirs, result.plan).status == ValidationResultStatus.VALID


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_with_time_are_solved_when_they_can_be(name: str) -> None:
    problem = EXAMPLES[name].problem
    result = CellwrightEngine(expansions=2000).solve(problem)
    assert (result.plan is not None) == EXAMPLES[name].solvable
    if result.plan is not None:
        with PlanValidator(problem_kind=problem.kind, plan_kind=result.plan.kind) as judge:
            assert judge.validate(problem, result.plan).status == ValidationResultStatus.VALID


@pytest.fixture
def cellar(tmp_path: Path) -> Problem:
    (tmp_path / "d.pddl").write_text(CELLAR, "utf-8")
    (tmp_path / "p.pddl").write_text(FUSES, "utf-8")
    return PDDLReader().parse_problem(str(tmp_path / "d.pddl"), str(tmp_path / "p.pddl"))


@pytest.mark.filterwarnings("ignore")
def test_our_validator_says_what_is_broken_in_a_plan_with_times(cellar: Problem) -> None:
    plan = CellwrightEngine().solve(cellar).plan
    assert CellwrightEngine.supports_plan(plan.kind)
    assert CellwrightEngine().validate(cellar, plan).status == ValidationResultStatus.VALID
    first, instance, length = plan.timed_actions[0]
    longer = TimeTriggeredPlan([(first, instance, length + 1), *plan.timed_actions[1:]])
    verdict = CellwrightEngine().validate(cellar, longer)
    assert verdict.status == ValidationResultStatus.INVALID
    assert "1 off" in verdict.log_messages[0].message
    unfinished = CellwrightEngine().validate(cellar, TimeTriggeredPlan([]))
    assert unfinished.reason == FailedValidationReason.UNSATISFIED_GOALS


@pytest.mark.filterwarnings("ignore")
def test_each_better_plan_with_times_is_told(cellar: Problem) -> None:
    results = list(CellwrightEngine(seed=3).get_solutions(cellar, timeout=0.3))
    ends = [max(start + length for start, _, length in r.plan.timed_actions) for r in results]
    assert ends == sorted(ends, reverse=True)
    assert results[-1].status in (Status.SOLVED_SATISFICING, Status.SOLVED_OPTIMALLY)
    assert all(result.status is Status.INTERMEDIATE for result in results[:-1])


@pytest.mark.filterwarnings("ignore")
def test_kinds_that_the_search_in_time_lacks_are_refused_by_name(cellar: Problem) -> None:
    cellar.add_timed_goal(GlobalStartTiming(5), cellar.fluent("handfree"))
    assert not CellwrightEngine.supports(cellar.kind)
    engine = CellwrightEngine()
    engine.skip_checks = True
    result = engine.solve(cellar)
    assert result.status == Status.UNSUPPORTED_PROBLEM
    assert "timed goals" in result.log_messages[0].message
