"""Where diagnosis meets planning: set-up costs are plans, and recovery starts from what was
found out.
"""

import math
from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.model.troubleshooting import CaseHypothesis, Revision
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.recovery.diagnosis_case import (
    Preparations,
    recover_goals,
    state_after,
)
from cellwright.engine.stages.diagnosis.belief_revision import binding_of, world_revision
from cellwright.engine.stages.diagnosis.case_session import QUESTION, CaseSession, run_session
from cellwright.engine.stages.diagnosis.hidden_cause import HiddenWorld
from cellwright.kb.asp import ground_term
from cellwright.kb.loader.fault_base import load_faults
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Variable


def atom(text: str) -> Atom:
    found = ground_term(text)
    assert isinstance(found, Function)
    return found


@pytest.fixture(scope="module")
def problem() -> Problem:
    return checked_plan.problem_of("bulkhead/one_point")


@pytest.fixture(scope="module")
def model(problem: Problem) -> FaultModel:
    return load_faults(Path(problem.domain.path))[0]


@pytest.fixture
def preparations(problem: Problem, model: FaultModel) -> Preparations:
    step = atom("us_measure(us_probe, t3_746, m1)")
    return Preparations(problem, binding_of(model, "implausible_value", step))


def needs(*texts: str) -> tuple[Atom, ...]:
    return tuple(map(atom, texts))


def test_what_holds_already_costs_nothing(preparations: Preparations) -> None:
    assert preparations([needs("holding(t3_746, us_probe)"), ()]).costs[0] == (0.0, 0.0)


def test_a_precondition_costs_what_its_plan_lasts(preparations: Preparations) -> None:
    wanted = needs("holding(t3_746, slra)")
    made = preparations.plan_from(preparations.semantics.initial(), preparations.goal(wanted))
    assert made is not None
    assert preparations([wanted]).costs[0] == (sum(step.duration for step in made.steps),)


def test_a_prepared_test_needs_no_more_preparation(preparations: Preparations) -> None:
    setup = preparations([needs("holding(t3_746, slra)"), ()])
    assert setup.costs[setup.following[0][0]][0] == 0.0


def test_variables_that_the_step_does_not_bind_are_some_object(preparations: Preparations) -> None:
    pattern = Function("holding", (Variable("Arm"), Variable("AnyTool")))
    assert preparations([(pattern,)]).costs[0] == (0.0,)


def test_what_no_plan_reaches_costs_infinitely(preparations: Preparations) -> None:
    impossible = needs("holding(t3_746, us_probe)", "holding(t3_746, slra)")
    assert preparations([impossible]).costs[0] == (math.inf,)


def test_situations_keep_their_numbers_when_others_join(preparations: Preparations) -> None:
    first = preparations([needs("holding(t3_746, slra)")])
    more = preparations(
        [needs("at(t3_746, approach_point(rack(slra)))"), needs("holding(t3_746, slra)")]
    )
    assert more.following[0][1] == first.following[0][0]
    assert len(more.costs) > len(first.costs)


def test_a_case_without_a_cause_goes_on_where_the_cell_stands(
    preparations: Preparations, model: FaultModel
) -> None:
    session = CaseSession(model, "implausible_value", setup=preparations)
    wrong = {"tool_self_test": "passed", "measure_reference_block": "nothing"}
    usual = {test.name: test.otherwise for test in model.tests.values()} | wrong
    made = run_session(session, lambda a, _: None if a.name == QUESTION else usual[a.name])
    assert math.fsum(p for _, p in made.hypotheses) == pytest.approx(1.0)
    assert all(h.lies for h, _ in made.hypotheses)
    assert len({each.action for each in made.observations}) == len(made.stages)


@pytest.mark.parametrize("cause", ["missing_couplant", "tilted_contact", "loose_cable"])
def test_the_planner_reaches_the_goals_from_what_was_found(
    problem: Problem, model: FaultModel, preparations: Preparations, cause: str
) -> None:
    world = HiddenWorld(model, CaseHypothesis((cause,)))
    made = run_session(
        CaseSession(model, "implausible_value", setup=preparations), lambda a, _: world.respond(a)
    )
    went_on = recover_goals(problem, world_revision(model, made, preparations.binding))
    assert isinstance(went_on.outcome, Found)
    assert not checked_plan.check_plan(went_on.problem, went_on.outcome.plan)


def test_a_lost_resource_is_not_planned_with(problem: Problem) -> None:
    went_on = recover_goals(problem, Revision(lost=("us_probe",)))
    assert isinstance(went_on.outcome, Infeasible)  # nothing else measures a thickness


def test_the_state_after_a_plan_has_its_goals(problem: Problem, preparations: Preparations) -> None:
    wanted = needs("holding(t3_746, slra)")
    made = preparations.plan_from(preparations.semantics.initial(), preparations.goal(wanted))
    assert made is not None
    assert set(wanted) <= state_after(problem, frozenset(problem.initial), made)
