"""Faults that a person orders for a run: what is wrong with them is told before any plan is made."""

from pathlib import Path

import pytest

from cellwright.engine.pipelines.execution import Wanted, listed
from cellwright.engine.pipelines.execution.faults import settled
from cellwright.engine.pipelines.planning import problem_of
from cellwright.engine.pipelines.simulator.driver import fault_base
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.journal import Journal
from tests.engine.pipelines.execution.cells import planned


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
    wanted = Wanted("themse/one", store=store, options={"fault": fault})
    with pytest.raises(InvalidInput) as refused, listed(wanted, problem_of("themse/one")):
        pytest.fail("a plan would be made now")
    (found,) = refused.value.diagnostics
    assert said in f"{found.message} {found.hint}"
    with Journal(store) as journal:
        assert journal.begun() == ()


def test_a_misspelt_operator_is_named() -> None:
    problem, ready = planned("themse/in_furnace")
    with pytest.raises(InvalidInput) as refused:
        settled("pikc=not_gripped", ready, fault_base(problem))
    assert refused.value.diagnostics[0].hint == "did you mean 'pick'?"
