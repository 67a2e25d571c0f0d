"""A revised plan is valid from what is observed; it keeps what serves and says what it does not."""

import random
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from disturbances import DOMAINS, PLANS, course, moment
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.recovery.observations import expected_situation, observed_state
from cellwright.engine.pipelines.recovery.plan_revision import PlanRevision, revise_plan
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.terms import Atom, Function


def atom(text: str) -> Atom:
    from cellwright.kb.asp import ground_term

    found = ground_term(text)
    assert isinstance(found, Function)
    return found


def bundled(name: str) -> Path:
    domain, problem = name.split("/")
    return DOMAINS / domain / "golden" / f"{problem}.json"


def plan_of(found: PlanRevision) -> Plan:
    assert isinstance(found.outcome, Found)
    return found.outcome.plan


def assert_accounted_for(path: Path, done: tuple[StepId, ...], found: PlanRevision) -> None:
    """Every step is kept, dropped or added, and is counted once."""
    left = sorted(str(step.operator) for step in course(path).plan.steps if step.id not in done)
    now = sorted(str(step.operator) for step in plan_of(found).steps)
    kept, dropped, added = (
        [str(step.operator) for step in steps] for steps in (found.kept, found.dropped, found.added)
    )
    assert sorted(kept + dropped) == left
    assert sorted(kept + added) == now


@pytest.mark.slow
@pytest.mark.parametrize("path", PLANS, ids=lambda path: f"{path.parts[-3]}-{path.stem}")
@given(cut=st.floats(0, 1), acts=st.integers(0, 3), seed=st.integers(0, 2**20))
@settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))
def test_after_any_disturbance_the_revised_plan_is_valid(
    path: Path, cut: float, acts: int, seed: int
) -> None:
    made = course(path)
    now = moment(made, int(cut * len(made.plan.steps)), acts, 0, random.Random(seed))
    found = revise_plan(made, now.done, now.observed)
    assert validate_plan(found.problem, plan_of(found)) == []
    assert_accounted_for(path, now.done, found)
    if not acts:
        assert found.way in ("continued", "done")
        assert found.added == ()


repairs = sys.modules[revise_plan.__module__]  # the package gives its function the module's name
SMALL = [
    bundled("bulkhead/one_point"),
    bundled("bulkhead/both_tools"),
    bundled("themse/lid_on_stand"),
]


@pytest.mark.slow
@given(
    path=st.sampled_from(SMALL),
    cut=st.floats(0, 1),
    losses=st.integers(1, 2),
    seed=st.integers(0, 2**20),
)
@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
def test_when_facts_get_lost_revision_finds_a_plan_exactly_if_there_is_one(
    path: Path, cut: float, losses: int, seed: int
) -> None:
    made = course(path)
    now = moment(made, int(cut * len(made.plan.steps)), 0, losses, random.Random(seed))
    found = revise_plan(made, now.done, now.observed)
    fresh = checked_plan.plan_problem(found.problem)
    assert isinstance(found.outcome, Found) == isinstance(fresh, Found)
    if isinstance(found.outcome, Found):
        assert validate_plan(found.problem, found.outcome.plan) == []


@given(
    path=st.sampled_from(SMALL),
    cut=st.floats(0, 1),
    acts=st.integers(1, 3),
    seed=st.integers(0, 2**20),
)
@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
def test_asked_for_both_the_cheaper_is_taken(path: Path, cut: float, acts: int, seed: int) -> None:
    made = course(path)
    now = moment(made, int(cut * len(made.plan.steps)), acts, 0, random.Random(seed))
    found = revise_plan(made, now.done, now.observed, both=True)
    if found.way != "done" and found.repair_cost is not None and found.replanning_cost is not None:
        assert plan_of(found).cost == min(found.repair_cost, found.replanning_cost)


def test_a_repair_that_the_checker_refuses_is_replanned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever goes wrong inside repair, a plan that is none does not leave by revision."""
    whole = repairs.deorder_steps
    monkeypatch.setattr(repairs, "deorder_steps", lambda *given: Plan(whole(*given).steps[:-1]))
    made = course(bundled("themse/one"))
    found = revise_plan(
        made, (), observed_state(made, made.start, [atom("position(flap, open)")], [])
    )
    assert found.way == "replanned"
    assert validate_plan(found.problem, plan_of(found)) == []


def test_a_repair_whose_orders_cannot_be_shown_is_given_as_a_sequence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = repairs.deorder_steps

    def loose(*given: Any) -> Plan:
        return Plan(tuple(replace(step, after=()) for step in whole(*given).steps))

    monkeypatch.setattr(repairs, "deorder_steps", loose)
    made = course(bundled("bulkhead/one_point"))
    found = revise_plan(made, (), made.start.state)  # type: ignore[arg-type]
    assert found.way == "continued"
    assert [step.after for step in plan_of(found).steps] == [(), *((n,) for n in range(1, 5))]
    assert validate_plan(found.problem, plan_of(found)) == []


def test_a_flap_that_somebody_closed_is_opened_again() -> None:
    made = course(bundled("themse/one"))
    done = tuple(StepId(n) for n in (1, 2, 3))  # the flap is open, a probe in the gripper
    here = expected_situation(made, done)
    now = observed_state(made, here, [atom("position(flap, closed)")], [])
    assert atom("position(flap, open)") not in now
    found = revise_plan(made, done, now)
    assert found.way == "repaired"
    assert "press_switch(closed, open)" in {str(step.operator) for step in plan_of(found).steps}
    assert len(found.kept) == len(made.plan.steps) - 3


def test_what_was_done_already_by_others_is_dropped() -> None:
    made = course(bundled("bulkhead/one_point"))
    there = [
        atom("at(t3_746, in_contact_point(meas(m2)))"),
        atom("couplant_applied(goal_point(meas(m2)))"),
    ]
    found = revise_plan(made, (), observed_state(made, made.start, there, []))
    assert found.way == "continued"
    assert [str(step.operator) for step in plan_of(found).steps] == [
        "us_measure(us_probe, t3_746, m2)"
    ]
    assert len(found.dropped) == 4


def test_nothing_is_left_when_the_goals_hold() -> None:
    made = course(bundled("bulkhead/one_point"))
    found = revise_plan(
        made,
        (),
        observed_state(made, made.start, [atom("measured(us_probe, t3_746, meas(m2))")], []),
    )
    assert (found.way, plan_of(found).steps) == ("done", ())


def test_stages_that_were_reached_need_not_be_reached_again() -> None:
    made = course(bundled("themse/one"))
    heated = next(step.id for step in made.plan.steps if step.operator.name == "heat")
    done = tuple(step.id for step in made.plan.steps if step.id <= heated)
    found = revise_plan(made, done, expected_situation(made, done).state)  # type: ignore[arg-type]
    assert [str(stage.name) for stage in found.problem.chains[0].stages] == ["cooled", "stored"]
    assert "heat" not in {step.operator.name for step in plan_of(found).steps}
