"""The law of recovery: what is believed at the end of a case is true, and the recovery plan
works in the true world.
"""

import random
from collections.abc import Iterator

import pytest
from _pytest.mark import ParameterSet

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.stages.diagnosis.fault_problems import CaseObjective
from tests.properties.recoveries import (
    Ended,
    carried_out,
    case,
    faults,
    interruptions,
    random_work,
    within_reach,
    work,
)

NAMES = ("bulkhead/both_tools", "themse/one")


def _cases(objective: CaseObjective) -> Iterator[ParameterSet]:
    """Every cause once; where it is repaired, for every exception: one new cause of each
    quickly, all others slowly.
    """
    for name in NAMES:
        seen: set[str] = set()
        for exception, entry in faults(name).exceptions.items():
            new = [cause for cause in entry.counts if cause not in seen]
            every = entry.counts if objective is CaseObjective.REPAIR else new
            quick = new[:1] if objective is CaseObjective.REPAIR else new
            for cause in every:
                yield pytest.param(
                    name, exception, cause, marks=[] if cause in quick else [pytest.mark.slow]
                )
            seen.update(new)


@pytest.mark.parametrize(("name", "exception", "cause"), list(_cases(CaseObjective.REPAIR)))
def test_recovery_starts_from_the_true_world_and_works_in_it(
    name: str, exception: str, cause: str
) -> None:
    holds_good(_case(name, exception, cause, CaseObjective.REPAIR))


@pytest.mark.long
@pytest.mark.parametrize(("name", "exception", "cause"), list(_cases(CaseObjective.ISOLATE)))
def test_recovery_works_beside_a_cause_that_is_there_still(
    name: str, exception: str, cause: str
) -> None:
    holds_good(_case(name, exception, cause, CaseObjective.ISOLATE))


@pytest.mark.long
@pytest.mark.parametrize("objective", list(CaseObjective))
@pytest.mark.parametrize("seed", range(20))
def test_the_law_holds_for_fault_bases_that_nobody_would_write(
    seed: int, objective: CaseObjective
) -> None:
    given = random_work(seed)
    for cause in given.model.causes:
        step = random.Random(f"{seed} {cause}").choice(interruptions(given, "trouble"))
        holds_good(case(given, "trouble", step, cause, objective, seed))


def _case(name: str, exception: str, cause: str, objective: CaseObjective) -> Ended:
    steps = interruptions(work(name), exception)
    if not steps:
        pytest.skip("no step of this plan ends with this exception: only tests do")
    step = random.Random(f"{name} {exception} {cause}").choice(steps)
    return case(work(name), exception, step, cause, objective)


def holds_good(ended: Ended) -> None:
    """The law for one case."""
    believed, truth = ended.findings.believed, ended.world.state
    if ended.made.isolated:
        assert believed == truth
    assert believed.facts <= truth.facts
    dynamics, facts = ended.world.cell.dynamics, believed.facts
    assert not any(dynamics.displaced(facts - {atom}, (atom,)) for atom in facts), (
        "free of contradictions"
    )
    recovery = ended.desk.recover(ended.made)
    promised = isinstance(recovery.outcome, Found)
    assert promised or isinstance(recovery.outcome, Infeasible)
    assert promised or recovery.given_up, "the stop says why"
    if ended.made.isolated and recovery.repair is None:
        assert list(within_reach(ended, recovery)) == [], "what is given up is out of reach"
    assert carried_out(ended, recovery) == ""
