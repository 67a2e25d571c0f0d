"""Problems in time of unified-planning: planned, and the plans accepted by its own validator."""

from pathlib import Path

import pytest

pytest.importorskip("unified_planning")

from unified_planning.engines import PlanGenerationResultStatus as Status
from unified_planning.engines import ValidationResultStatus
from unified_planning.io import PDDLReader
from unified_planning.shortcuts import PlanValidator, get_environment
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
