"""The independent checker against a plain simulation of every order and overlap that a plan
allows.
"""

import dataclasses

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.stages.validation import validate_plan
from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.step_changes import State
from cellwright.kb.model.conditions import And
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, CausalLink, Plan, full_order
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function
from tests.properties.problems import CONSTANTS, conditions, problems, successors
from tests.properties.random_plans import ATOMS, posed
from tests.properties.simulation import Simulation

MANY = settings(max_examples=50, deadline=None, suppress_health_check=list(HealthCheck))


@given(posed())
@MANY
def test_what_the_checker_accepts_goes_well_in_every_order_and_overlap(
    given: tuple[Problem, Plan],
) -> None:
    problem, plan = given
    if not validate_plan(problem, plan):
        assert Simulation(problem, plan).fails() == ""


@given(posed(), conditions(CONSTANTS))
@MANY
def test_of_a_sequence_the_checker_says_what_the_simulation_says(
    given: tuple[Problem, Plan], goal: And
) -> None:
    problem, plan = dataclasses.replace(given[0], goal=goal), full_order(Plan(given[1].steps))
    contradicts = any(
        "both adds and denies" in each.message for each in validate_plan(problem, plan)
    )
    assert contradicts or bool(validate_plan(problem, plan)) == bool(
        Simulation(problem, plan).fails()
    )


@given(posed())
@MANY
def test_links_of_a_sequence_are_refused_only_if_they_break(given: tuple[Problem, Plan]) -> None:
    problem, plan = given[0], full_order(given[1])
    found = {each.code for each in validate_plan(problem, plan)}
    fails = Simulation(problem, Plan(plan.steps)).fails()
    if not fails and found == {"K504"}:
        assert any(not _needless(problem, plan, each) for each in plan.links)


@given(posed(), st.data())
@MANY
def test_a_checker_that_knows_the_cell_finds_what_a_new_one_finds(
    given: tuple[Problem, Plan], data: st.DataObject
) -> None:
    problem, plan = given
    gate = PlanGate()
    for _ in range(3):
        state = tuple(sorted(data.draw(st.sets(st.sampled_from(ATOMS))), key=str))
        other = dataclasses.replace(problem, initial=state, complete=data.draw(st.booleans()))
        tried = Plan(tuple(data.draw(st.permutations(plan.steps))), plan.links)
        assert gate.findings(other, tried) == validate_plan(other, tried)


def _needless(problem: Problem, plan: Plan, link: CausalLink) -> bool:
    """Whether a link of a sequence is kept and its producer adds, or denies, what it promises."""
    states = _states(problem, plan)
    places = {
        INITIAL_STEP: 0,
        **{step.id: place for place, step in enumerate(plan.steps, 1)},
        GOAL_STEP: len(plan.steps) + 1,
    }
    first, last = places[link.producer], places[link.consumer]
    negative = link.condition.name == "not"
    atom: Atom = link.condition.arguments[0] if negative else link.condition  # type: ignore[assignment]
    kept = all((atom in state) != negative for state in states[first:last])
    return first < last and kept and (not first or (atom in states[first - 1]) == negative)


def _states(problem: Problem, plan: Plan) -> list[State]:
    semantics = Semantics(problem)
    states = [semantics.initial()]
    for step in plan.steps:
        states.append(dict(successors(semantics, problem, states[-1]))[step.operator])
    return states


@given(problems(), st.data())
@MANY
def test_every_state_lies_between_its_bounds(problem: Problem, data: st.DataObject) -> None:
    """What is proved from bounds holds in every state between them, derived atoms included."""
    semantics = Semantics(problem)
    certain = data.draw(st.sets(st.sampled_from(ATOMS)))
    possible = certain | data.draw(st.sets(st.sampled_from(ATOMS)))
    state = certain | {atom for atom in possible - certain if data.draw(st.booleans())}
    lower, upper = semantics.bounds(certain, possible)
    facts = semantics.facts(state)
    condition = data.draw(conditions(CONSTANTS))
    if condition_holds(condition, lower, {}, upper):
        assert condition_holds(condition, facts, {})
    derived = [Function("d", (each,)) for each in CONSTANTS] + [Function("e")]
    for atom in (*ATOMS, *derived):
        assert (atom in lower) <= (atom in facts) <= (atom in upper)
    if certain == possible:
        assert condition_holds(condition, lower, {}, upper) == condition_holds(condition, facts, {})
