"""No recovery plan has a step that could be left out, and none costs more than a plan that is
proved to be cheapest.
"""

import random
from collections.abc import Iterator

import pytest
from _pytest.mark import ParameterSet

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.diagnosis.fault_problems import CaseObjective
from cellwright.engine.stages.planning import SearchLimits
from tests.properties.detours import needless
from tests.properties.recoveries import Ended, case, faults, interruptions, random_work, work
from tests.properties.test_recovered_plans import NAMES

QUICK = (
    ("bulkhead/both_tools", "tool_not_released"),
    ("bulkhead/both_tools", "path_blocked"),
)  # one cause of each


def _cases() -> Iterator[ParameterSet]:
    """Every exception of both fault bases that a step of the plan can end with, with each of
    its causes.
    """
    for name in NAMES:
        for exception, entry in faults(name).exceptions.items():
            for number, cause in enumerate(entry.counts):
                quick = number == 0 and (name, exception) in QUICK
                yield pytest.param(
                    name, exception, cause, marks=[] if quick else [pytest.mark.slow]
                )


@pytest.mark.parametrize(("name", "exception", "cause"), list(_cases()))
def test_recovery_makes_no_detour(name: str, exception: str, cause: str) -> None:
    steps = interruptions(work(name), exception)
    if not steps:
        pytest.skip("no step of this plan ends with this exception: only tests do")
    step = random.Random(f"{name} {exception} {cause}").choice(steps)
    for objective in CaseObjective:
        makes_no_detour(case(work(name), exception, step, cause, objective))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(20))
def test_recovery_makes_no_detour_with_fault_bases_that_nobody_would_write(seed: int) -> None:
    given = random_work(seed)
    for objective in CaseObjective:
        for cause in given.model.causes:
            step = random.Random(f"{seed} {cause}").choice(interruptions(given, "trouble"))
            makes_no_detour(case(given, "trouble", step, cause, objective, seed))


def makes_no_detour(ended: Ended) -> None:
    """The law for one case."""
    recovery = ended.desk.recover(ended.made)
    if not isinstance(recovery.outcome, Found):
        return
    plan = recovery.outcome.plan
    assert needless(recovery.problem, plan, 2) == ()
    least = checked_plan.plan_problem(recovery.problem, SearchLimits(strategy="shortest"))
    assert isinstance(least, Found)
    if least.optimal:
        assert plan.cost <= least.plan.cost
