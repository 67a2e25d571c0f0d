"""The law of recovery: what is believed at the end of a case is true, and the recovery plan works in the true world."""

import random
from collections.abc import Iterator

import pytest

from engine.model.outcome import Found, Infeasible
from engine.stages.diagnosis.knowledge import Objective
from tests.properties.recoveries import Ended, carried_out, case, faults, interruptions, work

NAMES = ("bulkhead/both_tools", "themse/one")


def _cases(objective: Objective) -> Iterator[tuple[str, str, str]]:
    """Every cause of every exception; each cause once where nothing is repaired."""
    for name in NAMES:
        seen: set[str] = set()
        for exception, entry in faults(name).exceptions.items():
            for cause in entry.counts:
                if objective is Objective.REPAIR or cause not in seen:
                    yield name, exception, cause
                seen.add(cause)


@pytest.mark.parametrize(("name", "exception", "cause"), list(_cases(Objective.REPAIR)))
def test_recovery_starts_from_the_true_world_and_works_in_it(name: str, exception: str, cause: str) -> None:
    holds_good(_case(name, exception, cause, Objective.REPAIR))


@pytest.mark.parametrize(("name", "exception", "cause"), list(_cases(Objective.ISOLATE)))
def test_recovery_works_beside_a_cause_that_is_there_still(name: str, exception: str, cause: str) -> None:
    holds_good(_case(name, exception, cause, Objective.ISOLATE))


def _case(name: str, exception: str, cause: str, objective: Objective) -> Ended:
    step = random.Random(f"{name} {exception} {cause}").choice(interruptions(work(name), exception))
    return case(work(name), exception, step, cause, objective)


def holds_good(ended: Ended) -> None:
    """The law for one case."""
    believed, truth = ended.findings.believed, ended.world.state
    if ended.made.isolated:
        assert believed == truth
    assert believed.facts <= truth.facts
    recovery = ended.desk.recover(ended.made)
    promised = isinstance(recovery.outcome, Found)
    assert promised or isinstance(recovery.outcome, Infeasible)
    assert promised or recovery.given_up, "the stop says why"
    assert carried_out(ended, recovery) == ""
