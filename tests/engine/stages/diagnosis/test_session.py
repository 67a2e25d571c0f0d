"""Cases from the exception to their end, in a world with a hidden cause."""

import math
import random

import pytest

from cellwright.engine.model.troubleshooting import (
    CaseDiagnosis,
    CaseHypothesis,
    Observation,
    expected_cost,
)
from cellwright.engine.stages.diagnosis.action_selection import ActionSelector
from cellwright.engine.stages.diagnosis.belief_revision import (
    assertion_certainties,
    binding_of,
    world_revision,
)
from cellwright.engine.stages.diagnosis.case_session import (
    QUESTION,
    CaseSession,
    explain_observations,
    run_session,
)
from cellwright.engine.stages.diagnosis.fault_problems import (
    CaseObjective,
    open_case,
    outcome_likelihood,
)
from cellwright.engine.stages.diagnosis.hidden_cause import HiddenWorld, draw_cause, simulated_cost
from cellwright.kb.asp import ground_term
from cellwright.kb.loader import bundled_domains
from cellwright.kb.loader.fault_base import load_faults
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.terms import Function

MODELS = {
    name: load_faults(bundled_domains()[name] / "domain.yaml")[0] for name in ("bulkhead", "themse")
}
RAISED = [
    (name, e, c)
    for name, model in MODELS.items()
    for e in model.exceptions
    for c in model.exceptions[e].counts
]


def step(text: str) -> Function:
    found = ground_term(text)
    assert isinstance(found, Function)
    return found


def diagnosed(model: FaultModel, exception: str, *hidden: str, seed: int = 0) -> CaseDiagnosis:
    world = HiddenWorld(model, CaseHypothesis(hidden), random.Random(seed))
    return run_session(CaseSession(model, exception), lambda action, _: world.respond(action))


@pytest.mark.parametrize(("domain", "exception", "cause"), RAISED)
def test_every_cause_is_isolated_from_every_exception_that_it_raises(
    domain: str, exception: str, cause: str
) -> None:
    made = diagnosed(MODELS[domain], exception, cause)
    assert made.isolated
    assert made.hypotheses == ((CaseHypothesis((cause,)), pytest.approx(1.0)),)
    assert bool(made.repairs) != MODELS[domain].causes[cause].stops


@pytest.mark.parametrize("domain", MODELS)
def test_the_mean_cost_of_cases_is_the_expected_cost(domain: str) -> None:
    model, chance = MODELS[domain], random.Random(7)
    for exception in model.exceptions:
        problem = open_case(model, exception).problem
        tree = ActionSelector(problem).tree()
        costs = [simulated_cost(problem, tree, chance) for _ in range(1000)]
        assert sum(costs) / len(costs) == pytest.approx(expected_cost(tree), rel=0.15)


def test_beliefs_sum_to_one_at_every_stage() -> None:
    made = diagnosed(MODELS["bulkhead"], "implausible_value", "part_moved")
    assert len(made.stages) > 2
    for stage in made.stages:
        assert math.fsum(p for _, p in stage.belief) == pytest.approx(1.0)


def test_two_causes_are_found_together() -> None:
    seen = [Observation("look_at_spot", "dry"), Observation("tool_self_test", "failed")]
    model = MODELS["bulkhead"]
    found = explain_observations(model, model.priors("no_echo"), seen)
    assert found[0][0] == CaseHypothesis(("broken_probe", "missing_couplant"))
    assert math.fsum(p for _, p in found) == pytest.approx(1.0)


def test_what_no_cause_explains_is_a_wrong_observation() -> None:
    model = MODELS["bulkhead"]
    answers = {"read_controller": "ready"}
    session = CaseSession(model, "move_timeout")
    usual = {test.name: test.otherwise for test in model.tests.values()}
    made = run_session(session, lambda action, _: {**usual, **answers}[action.name])
    assert made.hypotheses
    seen = [Observation("read_controller", "ready"), Observation("scan_cell", "as_modelled")]
    found = explain_observations(model, model.priors("move_timeout"), seen)
    assert all(h.lies for h, _ in found)
    assert {h.causes for h, _ in found} == {("controller_hung",), ("brake_stuck",), ("obstacle",)}


def test_no_explanation_contains_another() -> None:
    model = MODELS["themse"]
    seen = [Observation("sense_grip_width", "wider"), Observation("sense_grip_force", "slack")]
    found = [
        {*h.causes, *(f"{t} lies" for t in h.lies)}
        for h, _ in explain_observations(model, model.priors("grip_failed"), seen)
    ]
    assert not any(one < other for one in found for other in found)


def test_a_sure_repair_that_fails_shows_a_second_cause() -> None:
    model = MODELS["themse"]
    seen = [Observation("sense_grip_width", "wider"), Observation("reference_arm", "not cured")]
    found = explain_observations(model, model.priors("grip_failed"), seen)
    assert all(h.causes != ("arm_offset",) for h, _ in found)
    assert any(set(h.causes) > {"arm_offset"} for h, _ in found)


def test_a_case_of_two_causes_ends_with_both_or_with_the_one_that_shows() -> None:
    made = diagnosed(MODELS["themse"], "furnace_too_cold", "furnace_off", "flap_leaks")
    assert made.isolated
    assert set(made.hypotheses[0][0].causes) <= {"furnace_off", "flap_leaks"}


def test_outcomes_of_several_causes_are_a_distribution() -> None:
    model = MODELS["themse"]
    for test in model.tests.values():
        for pair in (
            ("probe_slipped", "arm_offset"),
            ("lid_jammed", "lid_iced"),
            ("furnace_off", "flap_leaks"),
        ):
            total = math.fsum(
                outcome_likelihood(test, outcome, CaseHypothesis(pair)) for outcome in test.outcomes
            )
            assert total == pytest.approx(1.0)


def test_a_repair_that_cures_ends_the_case() -> None:
    model = MODELS["themse"]
    world = HiddenWorld(model, CaseHypothesis(("arm_offset",)))
    made = run_session(
        CaseSession(model, "grip_failed", CaseObjective.REPAIR), lambda a, _: world.respond(a)
    )
    assert made.cured == "reference_arm"
    assert made.hypotheses[0][0] == CaseHypothesis(("arm_offset",))


def test_an_exception_makes_the_assertions_of_its_causes_uncertain() -> None:
    model = MODELS["bulkhead"]
    binding = binding_of(model, "implausible_value", step("us_measure(us_probe, t3_746, m1)"))
    belief = CaseSession(model, "implausible_value").belief()
    certain = assertion_certainties(model, belief, binding)
    wet = step("couplant_applied(goal_point(meas(m1)))")
    assert certain[wet] == pytest.approx(
        1.0 - model.priors("implausible_value")["missing_couplant"]
    )


def test_the_isolated_cause_withdraws_and_the_others_restore() -> None:
    model = MODELS["bulkhead"]
    binding = binding_of(model, "implausible_value", step("us_measure(us_probe, t3_746, m1)"))
    wet = step("couplant_applied(goal_point(meas(m1)))")
    dry = world_revision(model, diagnosed(model, "implausible_value", "missing_couplant"), binding)
    assert wet in dict(dry.withdrawn)
    assert wet not in dict(dry.restored)
    moved = world_revision(model, diagnosed(model, "implausible_value", "loose_cable"), binding)
    assert wet in dict(moved.restored)
    assert wet not in dict(moved.withdrawn)


def stopped(*answers: str) -> CaseDiagnosis:
    """A case of a cause that nobody in the cell can repair, and what the person answers who is
    asked.
    """
    model, replies = MODELS["bulkhead"], iter(answers)
    world = HiddenWorld(model, CaseHypothesis(("rough_surface",)))
    session = CaseSession(model, "implausible_value")
    return run_session(
        session, lambda a, _: next(replies, None) if a.name == QUESTION else world.respond(a)
    )


def test_where_nothing_helps_a_person_is_asked_one_question() -> None:
    made = stopped()
    assert made.repairs == ()
    assert made.question is not None
    assert 2 <= len(made.question.answers) <= 4


def test_the_answer_of_a_person_is_an_observation_like_any_other() -> None:
    assert stopped("yes").cured
    assert stopped("yes").observations[-1] == Observation(QUESTION, "yes")
    assert stopped("no").cured is None
    assert stopped("no").question is None


def test_an_answer_among_several_causes_settles_which() -> None:
    session = CaseSession(MODELS["themse"], "drawer_does_not_close")
    session.reply("probe_fallen")
    made = session.diagnosis()
    assert made.hypotheses == ((CaseHypothesis(("probe_fallen",)), pytest.approx(1.0)),)


def test_the_repair_that_serves_most_of_what_is_possible_comes_first() -> None:
    model = MODELS["bulkhead"]
    made = run_session(
        CaseSession(model, "tool_not_held"),
        lambda a, _: "normal" if a.name == "read_pressure" else None,
    )
    assert not made.isolated
    assert made.repairs[0] == "set_rack_right"


def test_a_hidden_world_repeats_itself() -> None:
    world = HiddenWorld(MODELS["bulkhead"], CaseHypothesis(("loose_cable",)), random.Random(3))
    assert len({world.answer("repeat_measurement") for _ in range(20)}) == 1


def test_causes_are_drawn_as_often_as_they_were_counted() -> None:
    model, chance = MODELS["bulkhead"], random.Random(1)
    drawn = [draw_cause(model, "no_echo", chance).causes[0] for _ in range(4000)]
    for cause, prior in model.priors("no_echo").items():
        assert drawn.count(cause) / 4000 == pytest.approx(prior, abs=0.03)
