"""A revised plan makes no detour: no step can be left out, and what leads back to an old plan
costs no more than a new one.
"""

import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, event, example, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.recovery.plan_revision import PlanRevision, revise_plan
from cellwright.kb.diagnostics import InvalidInput
from tests.engine.pipelines.recovery.disturbances import PLANS, course, moment
from tests.properties.detours import needless

SMALL = [
    path
    for path in PLANS
    if (path.parts[-3], path.stem)
    in {
        ("bulkhead", "both_tools"),
        ("bulkhead", "one_point"),
        ("themse", "one"),
        ("themse", "lid_on_stand"),
        ("gauging", "two_probes"),
        ("dual", "bench"),
        ("centrifuge", "four"),
        ("handey", "five"),
    }
]
LAW = settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))
DRAWN = {
    "path": st.sampled_from(SMALL),
    "cut": st.floats(0, 1),
    "acts": st.integers(1, 3),
    "seed": st.integers(0, 2**20),
}


def revised(path: Path, cut: float, acts: int, seed: int) -> PlanRevision:
    """The plan that follows after somebody took a few steps."""
    own = course(path)
    now = moment(own, round(cut * len(own.plan.steps)), acts, 0, random.Random(seed))
    try:
        return revise_plan(own, now.done, now.observed)
    except InvalidInput:
        assume(False)
        raise


@given(**DRAWN)
@example(path=next(each for each in SMALL if each.stem == "two_probes"), cut=0.09, acts=3, seed=594)
@LAW
def test_a_repair_over_a_gap_costs_no_more_than_a_new_plan(
    path: Path, cut: float, acts: int, seed: int
) -> None:
    made = revised(path, cut, acts, seed)
    event(made.way)
    if made.way == "repaired" and isinstance(made.outcome, Found):
        anew = checked_plan.plan_problem(made.problem)
        assert isinstance(anew, Found)
        assert made.outcome.plan.cost <= anew.plan.cost


@given(**DRAWN)
@LAW
def test_no_step_of_a_revised_plan_can_be_left_out(
    path: Path, cut: float, acts: int, seed: int
) -> None:
    made = revised(path, cut, acts, seed)
    if isinstance(made.outcome, Found):
        event(f"{made.way}, {len(made.outcome.plan.steps)} steps")
        assert needless(made.problem, made.outcome.plan, 1) == ()


@pytest.mark.slow
@given(**DRAWN)
@settings(LAW, max_examples=60)
def test_no_pair_of_steps_of_a_revised_plan_can_be_left_out(
    path: Path, cut: float, acts: int, seed: int
) -> None:
    made = revised(path, cut, acts, seed)
    if isinstance(made.outcome, Found) and len(made.outcome.plan.steps) <= 22:
        assert needless(made.problem, made.outcome.plan, 2) == ()
