"""The law of recovery: what is believed at the end of a case is true, and the recovery plan works in the true world."""

import random

import pytest

from engine.model.outcome import Found, Infeasible
from engine.stages.diagnosis.knowledge import Objective
from tests.properties.recoveries import Ended, carried_out, case, interruptions, work

NAMES = ("bulkhead/both_tools", "themse/one")
CASES = [
    pytest.param(name, exception, cause, id=f"{name}-{exception}-{cause}")
    for name in NAMES
    for exception, entry in work(name).model.exceptions.items()
    for cause in entry.counts
]


@pytest.mark.parametrize("objective", list(Objective))
@pytest.mark.parametrize(("name", "exception", "cause"), CASES)
def test_recovery_starts_from_the_true_world_and_works_in_it(
    name: str, exception: str, cause: str, objective: Objective
) -> None:
    step = random.Random(f"{name} {exception} {cause}").choice(interruptions(work(name), exception))
    holds_good(case(work(name), exception, step, cause, objective))


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
