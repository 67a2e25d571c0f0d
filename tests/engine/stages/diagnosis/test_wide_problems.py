"""Problems with more causes than a machine word has bits, and with more uncertain tests than
fit into one.
"""

import math
import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.troubleshooting import (
    Action,
    CaseHypothesis,
    Troubleshooting,
    expected_cost,
)
from cellwright.engine.stages.diagnosis.action_selection import ActionSelector
from cellwright.engine.stages.diagnosis.case_session import CaseSession, run_session
from cellwright.engine.stages.diagnosis.fault_problems import CaseObjective
from cellwright.engine.stages.diagnosis.hidden_cause import HiddenWorld
from cellwright.kb.model.fault_model import Cause, FaultModel, FaultTest, Interruption, Repair
from tests.engine.stages.diagnosis.fault_cases import (
    brute_force,
    certain,
    each_alone,
    isolations,
    names,
    troubles,
    uncertain,
)

PLACES = (0, 61, 62, 63, 64, 127, 128)  # where words begin and end
WIDE = 130


def widened(problem: Troubleshooting) -> Troubleshooting:
    """The same problem, its causes far apart among many that are impossible."""

    def spread(row: tuple[float, ...], other: float) -> tuple[float, ...]:
        found = [other] * WIDE
        for place, value in zip(PLACES, row, strict=False):
            found[place] = value
        return tuple(found)

    actions = tuple(
        replace(
            a, likelihoods=tuple(spread(row, float(o == 0)) for o, row in enumerate(a.likelihoods))
        )
        for a in problem.actions
    )
    conclusions = tuple(
        replace(c, losses=spread(c.losses, c.losses[0])) for c in problem.conclusions
    )
    return replace(
        problem,
        causes=names(WIDE),
        priors=spread(problem.priors, 0.0),
        actions=actions,
        conclusions=conclusions,
    )


def idle(number: int, causes: int) -> Action:
    """An uncertain test that tells nothing."""
    return uncertain(f"idle{number}", 1.0, (0.5,) * causes)


@settings(max_examples=40, deadline=None)
@given(isolations() | troubles())
def test_the_optimum_does_not_depend_on_the_words_of_the_causes(problem: Troubleshooting) -> None:
    wide = ActionSelector(widened(problem))
    advice = wide.advise(wide.start())
    assert advice.optimal
    assert advice.expected_cost == pytest.approx(brute_force(problem))
    assert expected_cost(wide.tree()) == pytest.approx(advice.expected_cost)


@settings(max_examples=20, deadline=None)
@given(troubles(3), st.integers(30, 70))
def test_the_optimum_does_not_depend_on_the_number_of_uncertain_tests(
    problem: Troubleshooting, more: int
) -> None:
    causes = len(problem.causes)
    tests = tuple(idle(number, causes) for number in range(more))
    wide = ActionSelector(replace(problem, actions=(*tests, *problem.actions), setup=None), 100_000)
    advice = wide.advise(wide.start())
    assert advice.optimal
    assert advice.expected_cost == pytest.approx(brute_force(replace(problem, setup=None)))


@pytest.mark.parametrize(("bits", "causes"), [(6, 64), (7, 128), (9, 512)])
def test_halving_isolates_each_of_many_causes(bits: int, causes: int) -> None:
    tests = tuple(
        certain(f"bit{bit}", 1.0, tuple(cause >> bit & 1 for cause in range(causes)))
        for bit in range(bits)
    )
    selector = ActionSelector(
        Troubleshooting(names(causes), (1.0 / causes,) * causes, tests, each_alone(causes)), 1
    )
    advice = selector.advise(selector.start())
    assert advice.expected_cost == pytest.approx(bits)
    assert advice.bound <= bits + 1e-9
    assert expected_cost(selector.tree()) == pytest.approx(bits)


@pytest.mark.parametrize("seed", range(2))
def test_what_is_too_large_for_a_proof_has_a_bound_that_holds(seed: int) -> None:
    chance = random.Random(seed)
    rows = [tuple(int(chance.random() < 0.2) for _ in range(80)) for _ in range(50)]
    tests = tuple(certain(f"t{i}", float(chance.randint(1, 9)), row) for i, row in enumerate(rows))
    problem = Troubleshooting(names(80), (1.0 / 80,) * 80, tests, each_alone(80, 50.0))
    selector = ActionSelector(problem, 20)
    advice = selector.advise(selector.start())
    reached = expected_cost(selector.tree())
    assert advice.bound <= reached <= advice.expected_cost + 1e-9


def model(causes: int, tests: int, unsure: int = 0) -> FaultModel:
    """A fault base in which the tests spell the number of the cause; `unsure` of them are right
    nine times of ten.
    """
    order = [f"c{number}" for number in range(causes)]
    made = {
        f"t{bit}": FaultTest(
            f"t{bit}",
            "",
            1 + bit,
            ("no", "yes"),
            "no",
            {
                c: {"yes": 0.9, "no": 0.1} if bit < unsure else {"yes": 1.0}
                for number, c in enumerate(order)
                if number >> bit % 9 & 1
            },
        )
        for bit in range(tests)
    }
    repairs = {f"r{c}": Repair(f"r{c}", "", 5, {c: 1.0}) for c in order}
    known = {c: Cause(c, "") for c in order}
    return FaultModel(
        "d", {"e": Interruption("e", "", dict.fromkeys(order, 1.0))}, known, made, repairs
    )


@pytest.mark.parametrize(
    ("causes", "tests", "unsure"), [(63, 9, 0), (200, 9, 0), (500, 9, 0), (100, 12, 3)]
)
def test_each_of_many_causes_is_isolated(causes: int, tests: int, unsure: int) -> None:
    base = model(causes, tests, unsure)
    hidden = CaseHypothesis((f"c{causes - 1}",))
    made = run_session(CaseSession(base, "e", expansions=0), _answers(base, hidden))
    assert made.isolated
    assert made.hypotheses[0][0] == hidden


@pytest.mark.slow
def test_a_pair_of_many_causes_is_explained() -> None:
    base = model(100, 9)
    base = replace(
        base, tests={**base.tests, "both": FaultTest("both", "", 1, ("no", "yes"), "no", {})}
    )
    made = run_session(
        CaseSession(base, "e", CaseObjective.REPAIR, expansions=0),
        _answers(base, CaseHypothesis(("c1", "c64"))),
    )
    assert made.finished
    assert math.isfinite(made.cost)


def _answers(base: FaultModel, hidden: CaseHypothesis):  # type: ignore[no-untyped-def]
    world = HiddenWorld(base, hidden, random.Random(0))
    return lambda action, _: world.respond(action)
