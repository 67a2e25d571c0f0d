"""A session's own decisions: which repairs it offers, what it asks a person, and what the
answers do.
"""

import random
from dataclasses import dataclass, field

import pytest

from cellwright.engine.model.troubleshooting import (
    Action,
    CaseAdvice,
    CaseDiagnosis,
    CaseHypothesis,
    Observation,
    PreparationSteps,
)
from cellwright.engine.stages.diagnosis.case_session import (
    A_PERSON,
    QUESTION,
    CaseSession,
    case_steps,
    explain_observations,
    run_session,
)
from cellwright.engine.stages.diagnosis.fault_problems import CURED, NOT_CURED, CaseObjective
from cellwright.engine.stages.diagnosis.hidden_cause import HiddenWorld, draw_cause
from cellwright.kb.model.fault_model import Cause, FaultModel, FaultTest, Interruption, Repair
from cellwright.kb.model.plan_model import Step, StepId
from cellwright.kb.terms import Function

LOOK = FaultTest("look", "", 2, ("fine", "wet"), "fine", {"leak": {"wet": 1.0}})
LISTEN = FaultTest("listen", "", 1, ("quiet", "loud"), "quiet", {"jam": {"loud": 1.0}})
COUNTS = {"leak": 4.0, "jam": 2.0, "rust": 1.0, "fog": 1.0}


def pump(
    *repairs: Repair, stops: tuple[str, ...] = (), tests: tuple[FaultTest, ...] = (LOOK, LISTEN)
) -> FaultModel:
    return FaultModel(
        "pump",
        {"halt": Interruption("halt", "the pump stands still", COUNTS)},
        {name: Cause(name, f"there is {name}", stops=name in stops) for name in COUNTS},
        {test.name: test for test in tests},
        {each.name: each for each in repairs},
        smoothing=0.0,
        stop=90,
    )


SEAL = Repair("seal", "", 5, {"leak": 1.0})
FREE = Repair("free", "", 9, {"jam": 0.9})
SWAP = Repair("swap", "", 50, {"leak": 1.0, "jam": 1.0, "rust": 1.0})
CHEAP = Repair("cheap", "", 4, {"leak": 1.0})


def told(
    model: FaultModel, *answers: str | None, objective: CaseObjective = CaseObjective.ISOLATE
) -> CaseDiagnosis:
    """The diagnosis after these answers, in the order of the questions."""
    replies = iter(answers)
    return run_session(CaseSession(model, "halt", objective), lambda *_: next(replies, None))


def test_repairs_that_serve_most_of_what_is_possible_come_first_then_the_cheapest() -> None:
    made = told(pump(SEAL, FREE, SWAP, CHEAP))
    assert made.repairs == ("swap", "cheap", "seal", "free")
    assert told(pump(FREE, Repair("no", "", 1, {"leak": 0.0}))).repairs == ("free",)


def test_where_the_likeliest_cause_stops_the_cell_no_repair_is_offered() -> None:
    assert told(pump(SEAL, SWAP, stops=("leak",))).repairs == ()
    assert told(pump(SEAL, SWAP, stops=("jam",))).repairs == ("swap", "seal")


def test_a_person_is_asked_what_is_the_matter_with_the_likeliest_answers() -> None:
    made = told(pump())
    assert made.question is not None
    assert made.question.text == "the pump stands still: what is the matter?"
    assert made.question.answers == ("leak", "jam", "rust", "something else")
    assert made.stages == ()
    assert not made.isolated
    assert not made.finished


def test_a_person_is_asked_whether_a_known_cause_has_been_put_right() -> None:
    made = told(pump(stops=tuple(COUNTS)), "wet")
    assert made.question is not None
    assert made.question.text == "there is leak: has it been put right?"
    assert made.question.answers == ("yes", "no")
    assert (made.isolated, made.finished, made.cured) == (True, True, None)


def test_what_a_person_put_right_is_cured() -> None:
    made = told(pump(), "wet", "yes")
    assert (made.cured, made.question) == (A_PERSON, None)
    assert made.observations == (Observation("look", "wet"), Observation(QUESTION, "yes"))
    assert made.cost == 2.0 + 90.0
    assert made.repairs == ()


def test_what_a_person_did_not_put_right_is_not_asked_again() -> None:
    made = told(pump(), "wet", "no")
    assert (made.cured, made.question, made.isolated) == (None, None, True)


def test_a_person_names_the_cause_and_is_then_asked_whether_it_is_put_right() -> None:
    made = told(pump(tests=()), "jam", "yes")
    assert made.hypotheses == ((CaseHypothesis(("jam",)), 1.0),)
    assert [each.outcome for each in made.observations] == ["jam", "yes"]
    assert made.finished
    assert made.cured == A_PERSON


def test_something_else_ends_the_questions() -> None:
    made = told(pump(tests=()), "something else", "leak")
    assert [each.outcome for each in made.observations] == ["something else"]
    assert made.question is None
    assert len(made.hypotheses) == 4


def test_an_answer_that_was_not_offered_is_no_answer() -> None:
    made = told(pump(tests=()), "gremlins")
    assert made.observations == ()
    assert made.question is not None


def test_the_stage_of_a_question_shows_the_belief_before_it() -> None:
    (stage,) = told(pump(tests=()), "something else").stages
    assert dict(stage.belief) == pytest.approx(
        {"leak": 0.5, "jam": 0.25, "rust": 0.125, "fog": 0.125}
    )
    assert stage.advice == CaseAdvice(None, None, 90.0, 90.0, True)
    assert stage.cost == 90.0


def test_a_repair_that_cures_ends_the_case_with_what_it_cures() -> None:
    made = told(pump(SEAL, tests=()), CURED, objective=CaseObjective.REPAIR)
    assert made.cured == "seal"
    assert made.hypotheses == ((CaseHypothesis(("leak",)), 1.0),)
    assert (made.repairs, made.question, made.finished) == ((), None, True)
    assert made.cost == 5.0


def test_a_repair_that_does_not_help_leaves_the_other_causes() -> None:
    made = told(pump(SEAL, tests=()), NOT_CURED, objective=CaseObjective.REPAIR)
    assert made.cured is None
    assert {str(h) for h, _ in made.hypotheses} == {"jam", "rust", "fog"}


def test_a_case_without_an_answer_stays_where_it_is() -> None:
    session = CaseSession(pump(), "halt")
    assert list(case_steps(session, lambda *_: None)) == []
    assert session.belief() == tuple(
        (CaseHypothesis((name,)), pytest.approx(count / 8)) for name, count in COUNTS.items()
    )


def test_counts_that_are_given_replace_those_of_the_fault_base() -> None:
    session = CaseSession(pump(), "halt", counts={"fog": 3.0, "rust": 1.0})
    assert dict(session.belief()) == pytest.approx(
        {CaseHypothesis(("fog",)): 0.75, CaseHypothesis(("rust",)): 0.25}
    )


def test_when_nothing_alone_explains_what_was_seen_sets_of_causes_do() -> None:
    session = CaseSession(pump(), "halt")
    for name, said in (("listen", "loud"), ("look", "wet")):
        actions = [action.name for action in session.case.problem.actions]
        index = actions.index(name)
        session.observe(
            index, session.case.problem.actions[index].outcomes.index(said), session.advice()
        )
    assert session.belief()[0][0] == CaseHypothesis(("jam", "leak"))
    assert session.case.problem.actions == ()
    assert session.diagnosis().cost == 3.0


def test_a_case_is_finished_when_its_cause_is_known_even_if_a_repair_is_left_to_do() -> None:
    session = CaseSession(pump(SEAL), "halt", CaseObjective.REPAIR)
    look = [action.name for action in session.case.problem.actions].index("look")
    session.observe(look, 1, session.advice())
    assert session.advice().action is not None
    made = session.diagnosis()
    assert (made.isolated, made.finished, made.cured) == (True, True, None)


def test_a_repair_that_cures_several_causes_finishes_the_case_without_telling_which() -> None:
    made = told(pump(SWAP, tests=()), CURED, objective=CaseObjective.REPAIR)
    assert {str(h) for h, _ in made.hypotheses} == {"leak", "jam", "rust"}
    assert (made.isolated, made.finished, made.cured) == (False, True, "swap")


def test_the_likeliest_explanations_are_kept() -> None:
    """The leak explains what was seen; so does rust, the likelier cause, but only if the look
    was wrong.
    """
    seen = [Observation("look", "wet")]
    every = explain_observations(pump(), {"leak": 0.4, "rust": 0.6}, seen)
    assert [h for h, _ in every] == [
        CaseHypothesis(("leak",)),
        CaseHypothesis(("rust",), ("look",)),
    ]
    assert explain_observations(pump(), {"leak": 0.4, "rust": 0.6}, seen, most=1) == [
        (CaseHypothesis(("leak",)), 1.0)
    ]


def test_a_cause_that_never_happens_explains_nothing() -> None:
    found = explain_observations(pump(), {"leak": 0.0, "rust": 1.0}, [Observation("look", "wet")])
    assert found == [(CaseHypothesis(("rust",), ("look",)), 1.0)]


@dataclass
class Helper:
    """Prepares tests and repairs, except what is out of reach, at a cost of 4; notes what was
    done.
    """

    out_of_reach: tuple[str, ...] = ()
    done: list[tuple[str, str]] = field(default_factory=list)

    def prepare(self, session: CaseSession, action: str) -> PreparationSteps | None:
        assert action in [each.name for each in session.case.problem.actions]
        return None if action in self.out_of_reach else PreparationSteps((GO,), 4.0)

    def carried_out(self, action: str, outcome: str, prepared: PreparationSteps) -> None:
        assert prepared.steps == (GO,)
        self.done.append((action, outcome))


GO = Step(StepId(1), Function("go"))


def test_what_comes_before_a_test_is_done_and_paid_with_it() -> None:
    helper = Helper()
    made = run_session(
        CaseSession(pump(), "halt", hands=helper),
        lambda action, _: {"look": "wet"}.get(action.name),
    )
    assert helper.done == [("look", "wet")]
    assert [(stage.cost, stage.steps) for stage in made.stages] == [(2.0 + 4.0, (GO,))]


def test_what_cannot_be_prepared_any_more_is_left_out_and_the_belief_stays() -> None:
    helper = Helper(("look",))
    session = CaseSession(pump(), "halt", hands=helper)
    before, asked = session.belief(), list[str]()
    run_session(session, lambda action, _: asked.append(action.name))
    assert session.left_out == ["look"]
    assert asked[0] == "listen"
    assert session.belief() == tuple((each, pytest.approx(share)) for each, share in before)
    assert helper.done == []


# A world with a hidden cause.


def test_a_hidden_world_answers_tests_by_their_chances_and_questions_truly() -> None:
    often = FaultTest("often", "", 1, ("no", "yes"), "no", {"leak": {"no": 0.25, "yes": 0.75}})
    model = pump(SEAL, FREE, tests=(often,))
    said = [
        HiddenWorld(model, CaseHypothesis(("leak",)), random.Random(n)).answer("often")
        for n in range(400)
    ]
    assert said.count("yes") == pytest.approx(300, abs=30)
    world = HiddenWorld(model, CaseHypothesis(("leak",)))
    assert (world.answer("seal"), world.answer("free")) == (CURED, NOT_CURED)
    ask = Action(QUESTION, 1.0, ("jam", "leak", "other"), ((1.0,), (1.0,), (1.0,)))
    assert world.respond(ask) == "leak"
    assert HiddenWorld(model, CaseHypothesis(("rust",))).respond(ask) == "other"


def test_causes_are_drawn_by_the_counts_that_are_given() -> None:
    drawn = {draw_cause(pump(), "halt", random.Random(n), {"fog": 1.0}) for n in range(20)}
    assert drawn == {CaseHypothesis(("fog",))}
