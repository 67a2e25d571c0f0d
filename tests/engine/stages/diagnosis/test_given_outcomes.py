"""Outcomes that are given count, whether they would have been asked for or not; and what they
come to.
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.model.troubleshooting import Observation, expected_cost
from cellwright.engine.pipelines.recovery.case_input import scripted_answerer
from cellwright.engine.stages.diagnosis.action_selection import ActionSelector
from cellwright.engine.stages.diagnosis.case_session import CaseSession, run_session
from cellwright.engine.stages.diagnosis.fault_problems import (
    CURED,
    NOT_CURED,
    CaseObjective,
    chance_of,
    open_case,
    suited_objective,
)
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.fault_model import Cause, FaultModel, FaultTest, Interruption, Repair


def look(shows: float = 0.95, repeats: int = 1) -> FaultTest:
    chances = {"a": {"yes": shows, "no": 1.0 - shows}, "b": {"yes": 0.05, "no": 0.95}}
    return FaultTest("look", "", 1, ("yes", "no"), "no", chances, repeats=repeats)


LISTEN = FaultTest("listen", "", 900, ("loud", "low"), "low", {"a": {"loud": 0.7, "low": 0.3}})
SURE = FaultTest("weigh", "", 5, ("heavy", "light"), "light", {"a": {"heavy": 1.0}})
MEND = Repair("mend", "", 20, {"a": 1.0})


def cell(*tests: FaultTest, repairs: tuple[Repair, ...] = (MEND,), b: float = 5.0) -> FaultModel:
    exceptions = {"halt": Interruption("halt", "", {"a": 5.0, "b": b})}
    causes = {name: Cause(name, "") for name in ("a", "b")}
    named = {each.name: each for each in tests}
    return FaultModel(
        "cell", exceptions, causes, named, {each.name: each for each in repairs}, stop=300
    )


def believed(
    model: FaultModel, text: str, objective: CaseObjective | None = None
) -> dict[str, float]:
    script = scripted_answerer(model, text)
    made = run_session(CaseSession(model, "halt", objective), script, script.seen)
    return {str(hypothesis): chance for hypothesis, chance in made.hypotheses}


@pytest.mark.parametrize("objective", [None, *CaseObjective])
def test_an_outcome_of_an_unsure_test_changes_what_is_believed(
    objective: CaseObjective | None,
) -> None:
    assert believed(cell(look()), "look=yes", objective) == pytest.approx({"a": 0.95, "b": 0.05})


def test_an_unsure_test_is_asked_for_and_what_is_likely_enough_is_found() -> None:
    session = CaseSession(cell(look()), "halt", None)
    assert session.advice().action == 0
    made = run_session(session, lambda action, _: "yes" if action.name == "look" else None)
    assert made.isolated
    assert len(made.hypotheses) == 2
    assert [str(each) for each in made.counted_on] == ["a"]


@given(
    st.lists(
        st.sampled_from(("look=yes", "look=no", "listen=loud", "listen=low", "mend=not cured")),
        unique=True,
    )
)
def test_all_that_is_given_counts_in_any_order(outcomes: list[str]) -> None:
    """What nobody would ask for (listening costs 900), and what is no action of the objective."""
    model = cell(look(), LISTEN, repairs=(Repair("mend", "", 20, {"a": 0.8}),))
    seen = [Observation(*each.split("=")) for each in outcomes]
    if len({each.action for each in seen}) < len(seen):
        with pytest.raises(InvalidInput, match="K907"):
            scripted_answerer(model, ", ".join(outcomes))
        return
    actions: dict[str, FaultTest | Repair] = {**model.tests, **model.repairs}
    session = CaseSession(model, "halt")
    weights = [
        math.prod(chance_of(actions[each.action], each.outcome, hypothesis) for each in seen)
        for hypothesis in session.case.hypotheses
    ]
    for objective in CaseObjective:
        found = believed(model, ", ".join(outcomes), objective)
        assert [found.get(name, 0.0) for name in ("a", "b")] == pytest.approx(
            [each / sum(weights) for each in weights]
        )


def test_repetitions_count_if_they_are_independent() -> None:
    assert believed(cell(look(0.6)), "look=yes, look=yes") == pytest.approx(
        {"a": 12 / 13, "b": 1 / 13}
    )
    twice = believed(cell(look(0.6, repeats=2)), "look=yes, look=yes")
    assert twice == pytest.approx({"a": 144 / 145, "b": 1 / 145})
    apart = believed(cell(look(0.6, repeats=2)), "look=yes, look=no")
    assert apart == pytest.approx(believed(cell(look(0.6, repeats=2)), "look=no, look=yes"))
    with pytest.raises(InvalidInput, match="K907"):
        scripted_answerer(cell(look(0.6, repeats=2)), "look=yes, look=no, look=yes")


def test_a_repair_that_cured_ends_the_case_wherever_it_is_named() -> None:
    model = cell(look())
    script = scripted_answerer(model, f"mend={CURED}, look=no")
    made = run_session(CaseSession(model, "halt", CaseObjective.ISOLATE), script, script.seen)
    assert made.cured == "mend"
    assert [str(hypothesis) for hypothesis, _ in made.hypotheses] == ["a"]
    assert [each.action for each in made.observations] == ["look", "mend"]
    assert made.cost == 21.0


def test_what_the_same_repair_has_shown_tells_nothing_new() -> None:
    model = cell(look(), repairs=(Repair("mend", "", 20, {"a": 0.5}),))
    once, twice = (believed(model, ", ".join([f"mend={NOT_CURED}"] * times)) for times in (1, 2))
    assert once == twice == pytest.approx({"a": 1 / 3, "b": 2 / 3})


@pytest.mark.parametrize(
    ("model", "objective"),
    [
        (cell(look()), CaseObjective.REPAIR),
        (cell(look(), repairs=()), CaseObjective.ISOLATE),
        (cell(look(), SURE), CaseObjective.ISOLATE),
        (cell(repairs=(MEND,)), CaseObjective.ISOLATE),
    ],
)
def test_the_objective_suits_the_tests(model: FaultModel, objective: CaseObjective) -> None:
    assert suited_objective(model, "halt") is objective


def test_where_nothing_repairs_tests_go_on_to_the_certainty_that_is_asked_for() -> None:
    model = cell(look(repeats=6), repairs=())
    costs = []
    for certainty in (0.9, 0.99, 0.999):
        problem = open_case(model, "halt", None, certainty=certainty).problem
        costs.append(expected_cost(ActionSelector(problem).tree()))
    assert costs == sorted(costs)
    assert costs[0] == pytest.approx(1.0)
    assert costs[1] > 2.0
    assert open_case(model, "halt", None).certainty == 0.95
    assert open_case(cell(SURE), "halt", None).certainty == 1.0


def test_a_cause_that_cannot_be_is_not_believed() -> None:
    model = FaultModel(
        "cell", cell(b=0.0).exceptions, cell().causes, {"look": look()}, {}, smoothing=0.0
    )
    assert believed(model, "look=no") == {"a": 1.0}


def test_an_observation_that_is_said_never_to_lie_is_doubted_last() -> None:
    model = FaultModel(
        "cell", cell().exceptions, cell().causes, {"weigh": SURE}, {"mend": MEND}, lies=0.0
    )
    found = believed(model, f"weigh=heavy, mend={NOT_CURED}")
    assert sum(found.values()) == pytest.approx(1.0)
