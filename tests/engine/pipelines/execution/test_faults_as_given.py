"""Faults that a person orders for a run: what is wrong with them is told before any plan is
made.
"""

from pathlib import Path

import pytest

from cellwright.engine.pipelines.execution import RunRequest, list_run
from cellwright.engine.pipelines.execution.run_start import settle_faults
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.simulators.virtual_clock import fault_base
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.journal import Journal
from tests.engine.pipelines.execution.executed_cells import planned


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("pick#3=not_griped", "unknown cause 'not_griped'"),
        ("heat=xyz", "at heat: "),
        ("pick#3", "'pick#3' is no fault"),
        ("=not_gripped", "'=not_gripped' is no fault"),
        ("pick#3=not_gripped; pick#4=nobody", "unknown cause 'nobody'"),
    ],
)
def test_faults_that_no_plan_can_have_are_refused_before_one_is_made(
    tmp_path: Path, fault: str, said: str
) -> None:
    store = str(tmp_path / "runs.db")
    wanted = RunRequest("themse/one", store=store, options={"fault": fault})
    with pytest.raises(InvalidInput) as refused, list_run(wanted, problem_of("themse/one")):
        pytest.fail("a plan would be made now")
    (found,) = refused.value.diagnostics
    assert said in f"{found.message} {found.hint}"
    with Journal(store) as journal:
        assert journal.begun() == ()


def test_a_misspelt_operator_is_named() -> None:
    problem, ready = planned("themse/in_furnace")
    with pytest.raises(InvalidInput) as refused:
        settle_faults("pikc=not_gripped", ready, fault_base(problem))
    assert refused.value.diagnostics[0].hint == "did you mean 'pick'?"
