"""Fault knowledge as probabilities: worked cases of every product, and Bayes' rule by brute
force over random fault bases.
"""

import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.troubleshooting import CaseHypothesis, Observation, Setup
from cellwright.engine.stages.diagnosis.case_session import CaseSession, explain_observations
from cellwright.engine.stages.diagnosis.fault_problems import (
    CURED,
    NOT_CURED,
    SAFE_STOP,
    CaseObjective,
    case_of,
    cure_chance,
    open_case,
    outcome_likelihood,
)
from cellwright.kb.model.fault_model import Cause, FaultModel, FaultTest, Interruption, Repair
from cellwright.kb.terms import Function

MANY = settings(max_examples=50, deadline=None)
GAUGE = FaultTest(
    "gauge",
    "",
    3,
    ("fine", "low", "high"),
    "fine",
    {"leak": {"fine": 0.4, "low": 0.6}, "jam": {"fine": 0.5, "high": 0.5}, "cut": {"low": 1.0}},
)


@pytest.mark.parametrize(
    ("causes", "fine", "low", "high"),
    [
        (("rust",), 1.0, 0.0, 0.0),  # a cause that the test does not show
        (("leak",), 0.4, 0.6, 0.0),
        (("leak", "rust"), 0.4, 0.6, 0.0),
        (("leak", "jam"), 0.2, 0.8 * 0.6 / 1.1, 0.8 * 0.5 / 1.1),
        (("leak", "cut"), 0.0, 1.0, 0.0),
        (("jam", "cut"), 0.0, 1.0 / 1.5, 0.5 / 1.5),
        (("leak", "jam", "cut"), 0.0, 1.6 / 2.1, 0.5 / 2.1),
    ],
)
def test_several_causes_disturb_a_test_by_a_noisy_or(
    causes: tuple[str, ...], fine: float, low: float, high: float
) -> None:
    found = [
        outcome_likelihood(GAUGE, outcome, CaseHypothesis(causes)) for outcome in GAUGE.outcomes
    ]
    assert found == pytest.approx([fine, low, high])


def test_a_test_that_lies_says_anything() -> None:
    lying = CaseHypothesis(("leak",), ("gauge",))
    assert [
        outcome_likelihood(GAUGE, outcome, lying) for outcome in GAUGE.outcomes
    ] == pytest.approx([1 / 3] * 3)
    assert outcome_likelihood(
        GAUGE, "fine", CaseHypothesis(("leak",), ("other",))
    ) == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("causes", "chance"),
    [
        (("leak",), 0.5),
        (("leak", "jam"), 0.4),
        (("leak", "rust"), 0.0),
        (("rust",), 0.0),
        ((), 1.0),
    ],
)
def test_a_repair_cures_if_it_puts_every_cause_right(
    causes: tuple[str, ...], chance: float
) -> None:
    repair = Repair("mend", "", 1, {"leak": 0.5, "jam": 0.8})
    assert cure_chance(repair, CaseHypothesis(causes)) == pytest.approx(chance)


# Bayes' rule by brute force.

CAUSES = ("c0", "c1", "c2")
chances = st.sampled_from((0.0, 0.2, 0.5, 0.7, 1.0))


@st.composite
def tables(draw: st.DrawFn, name: str) -> FaultTest:
    outcomes = ("usual", "odd", "strange")[: draw(st.integers(2, 3))]
    given = {}
    for cause in CAUSES:
        if draw(st.booleans()):
            weights = [draw(st.sampled_from((0, 0, 1, 3))) for _ in outcomes]
            total = sum(weights)
            if total:
                given[cause] = {o: w / total for o, w in zip(outcomes, weights, strict=True) if w}
    return FaultTest(name, "", draw(st.integers(1, 9)), outcomes, "usual", given)


@st.composite
def models(draw: st.DrawFn) -> FaultModel:
    tests = {name: draw(tables(name)) for name in ("t0", "t1")}
    cures = {cause: draw(chances) for cause in CAUSES if draw(st.booleans())}
    counts = {cause: float(draw(st.integers(0, 20))) for cause in CAUSES}
    return FaultModel(
        "random",
        {"halt": Interruption("halt", "", counts)},
        {cause: Cause(cause, "") for cause in CAUSES},
        tests,
        {"mend": Repair("mend", "", draw(st.integers(1, 9)), cures)},
        lies=draw(st.sampled_from((0.01, 0.2))),
    )


@st.composite
def cases(draw: st.DrawFn) -> tuple[FaultModel, list[Observation]]:
    model = draw(models())
    seen = [
        Observation(name, draw(st.sampled_from(model.tests[name].outcomes)))
        for name in ("t0", "t1")
        if draw(st.booleans())
    ]
    return model, seen + ([Observation("mend", NOT_CURED)] if draw(st.booleans()) else [])


def joint(model: FaultModel, seen: list[Observation], hypothesis: CaseHypothesis) -> float:
    """The probability of a set of causes and lies together with what was seen, multiplied out."""
    weight = math.prod(model.priors("halt")[cause] for cause in hypothesis.causes)
    weight *= model.lies ** len(hypothesis.lies)
    for each in seen:
        if each.action == "mend":
            weight *= 1.0 - math.prod(
                model.repairs["mend"].cures.get(c, 0.0) for c in hypothesis.causes
            )
        else:
            weight *= seen_so(model.tests[each.action], each.outcome, hypothesis)
    return weight


def seen_so(test: FaultTest, outcome: str, hypothesis: CaseHypothesis) -> float:
    """A noisy-or: nothing shows if no cause disturbs; else each outcome by its share in what
    the causes may show.
    """
    if test.name in hypothesis.lies:
        return 1 / len(test.outcomes)
    rows = [test.gives.get(cause, {test.otherwise: 1.0}) for cause in hypothesis.causes]
    quiet = math.prod(row.get(test.otherwise, 0.0) for row in rows)
    odd = {o: sum(row.get(o, 0.0) for row in rows) for o in test.outcomes if o != test.otherwise}
    if outcome == test.otherwise:
        return quiet
    return (1 - quiet) * odd[outcome] / sum(odd.values()) if any(odd.values()) else 0.0


def subsets(names: tuple[str, ...]) -> list[tuple[str, ...]]:
    return [each for size in range(len(names) + 1) for each in itertools.combinations(names, size)]


@given(cases())
@MANY
def test_explanations_are_the_minimal_ones_with_the_probabilities_of_bayes(
    case: tuple[FaultModel, list[Observation]],
) -> None:
    model, seen = case
    tested = tuple(each.action for each in seen if each.action != "mend")
    explaining = [
        CaseHypothesis(causes, lies)
        for causes in subsets(CAUSES)[1:]
        for lies in subsets(tested)
        if joint(model, seen, CaseHypothesis(causes, lies)) > 0.0
    ]
    minimal = [h for h in explaining if not any(_less(other, h) for other in explaining)]
    total = sum(joint(model, seen, each) for each in minimal)
    found = explain_observations(model, model.priors("halt"), seen)
    assert {h: p for h, p in found} == pytest.approx(
        {h: joint(model, seen, h) / total for h in minimal}
    )
    assert [p for _, p in found] == sorted((p for _, p in found), reverse=True)


def _less(one: CaseHypothesis, other: CaseHypothesis) -> bool:
    whole = {*other.causes, *other.lies}
    return one != other and {*one.causes, *one.lies} <= whole


@given(cases(), st.sampled_from(list(CaseObjective)))
@MANY
def test_a_belief_is_that_of_bayes_after_every_outcome(
    case: tuple[FaultModel, list[Observation]], objective: CaseObjective
) -> None:
    model, seen = case
    session = CaseSession(model, "halt", objective)
    past: list[Observation] = []
    for each in seen:
        names = [action.name for action in session.case.problem.actions]
        if each.action not in names:
            continue
        past.append(each)
        alone = {
            CaseHypothesis((cause,)): joint(model, past, CaseHypothesis((cause,)))
            for cause in CAUSES
        }
        if not any(alone.values()):
            return
        action = names.index(each.action)
        outcome = session.case.problem.actions[action].outcomes.index(each.outcome)
        session.observe(action, outcome, session.advice())
        total = sum(alone.values())
        expected = {h: w / total for h, w in alone.items() if w > 0.0}
        assert dict(session.belief()) == pytest.approx(expected)
        assert [p for _, p in session.belief()] == pytest.approx(
            sorted(expected.values(), reverse=True)
        )


# Which actions a case has.


def base(**tests: FaultTest) -> FaultModel:
    return FaultModel(
        "pump",
        {"halt": Interruption("halt", "", {"leak": 3.0, "jam": 1.0, "rust": 0.0})},
        {name: Cause(name, "") for name in ("leak", "jam", "rust", "cut")},
        {"gauge": GAUGE, **tests},
        {
            "mend": Repair(
                "mend", "", 7, {"leak": 0.5, "jam": 1.0}, preconditions=(Function("near"),)
            ),
            "splice": Repair("splice", "", 9, {"cut": 1.0}),
            "hope": Repair("hope", "", 1, {"leak": 0.0}),
        },
        stop=500,
    )


SILENT = FaultTest("silent", "", 1, ("a", "b"), "a", {"cut": {"b": 1.0}})
SHARP = FaultTest(
    "sharp", "", 2, ("no", "yes"), "no", {"leak": {"yes": 1.0}}, preconditions=(Function("far"),)
)


def test_a_case_has_the_tests_that_tell_and_the_repairs_that_serve_its_causes() -> None:
    model = base(silent=SILENT, sharp=SHARP)
    tests = open_case(model, "halt").problem
    assert [action.name for action in tests.actions] == ["gauge", "sharp"]
    assert tests.causes == ("leak", "jam", "rust")
    assert tests.priors == pytest.approx((4 / 7, 2 / 7, 1 / 7))
    both = open_case(model, "halt", CaseObjective.REPAIR).problem
    assert [action.name for action in both.actions] == ["gauge", "sharp", "mend"]
    assert open_case(model, "halt", counts={"rust": 7.0}).problem.priors == pytest.approx(
        (0.1, 0.1, 0.8)
    )


def test_the_rows_of_a_test_are_its_likelihoods_and_those_of_a_repair_its_cures() -> None:
    gauge, mend = open_case(base(), "halt", CaseObjective.REPAIR).problem.actions
    assert (gauge.cost, gauge.outcomes, gauge.ends) == (3.0, ("fine", "low", "high"), frozenset())
    assert gauge.likelihoods == ((0.4, 0.5, 1.0), (0.6, 0.0, 0.0), (0.0, 0.5, 0.0))
    assert (mend.cost, mend.outcomes, mend.ends) == (7.0, (CURED, NOT_CURED), frozenset({0}))
    assert mend.likelihoods == ((0.5, 1.0, 0.0), (0.5, 0.0, 1.0))


def test_to_isolate_is_to_conclude_what_is_sure_and_to_repair_is_to_end_or_to_stop() -> None:
    inf = math.inf
    found = open_case(base(sharp=SHARP), "halt", certainty=1.0).problem.conclusions
    assert [(each.name, each.losses) for each in found] == [
        ("leak", (0.0, inf, inf)),
        ("jam", (inf, 0.0, inf)),
        ("rust", (inf, inf, 0.0)),
        ("jam or rust", (inf, 0.0, 0.0)),  # the gauge may leave both possible
    ]
    (stop,) = open_case(base(sharp=SHARP), "halt", CaseObjective.REPAIR).problem.conclusions
    assert (stop.name, stop.losses) == (SAFE_STOP, (500.0, 500.0, 500.0))


def test_causes_that_no_test_surely_tells_apart_are_concluded_together_through_others() -> None:
    """The gauge leaves leak and rust possible together, and jam and rust; so all three are one
    group.
    """
    inf = math.inf
    alone = open_case(base(), "halt", certainty=1.0).problem.conclusions
    assert [each.losses for each in alone][3:] == [(0.0, 0.0, 0.0)]
    exact = FaultTest(
        "exact", "", 1, ("no", "yes"), "no", {"leak": {"yes": 1.0}, "jam": {"no": 0.5, "yes": 0.5}}
    )
    (pair, *_) = open_case(
        base(exact=exact, sharp=SHARP), "halt", certainty=1.0
    ).problem.conclusions[3:]
    assert pair.losses == (inf, 0.0, 0.0)


def test_what_was_done_is_not_done_again() -> None:
    model, both = base(sharp=SHARP), (CaseHypothesis(("leak",)), CaseHypothesis(("jam",)))
    case = case_of(model, "halt", both, (3.0, 1.0), CaseObjective.REPAIR, done=("gauge", "mend"))
    assert [action.name for action in case.problem.actions] == ["sharp"]
    assert case.problem.priors == (0.75, 0.25)
    assert (case.exception, case.hypotheses) == ("halt", both)


def test_what_cannot_be_set_up_is_left_out() -> None:
    def setup(needed: object) -> Setup:
        assert isinstance(needed, list)
        costs = tuple(math.inf if Function("far") in each else 5.0 for each in needed)
        return Setup((costs,), (tuple(0 for _ in needed),))

    found = open_case(base(sharp=SHARP), "halt", CaseObjective.REPAIR, setup=setup).problem
    assert [action.name for action in found.actions] == ["gauge", "mend"]
    assert found.setup == Setup(((5.0, 5.0),), ((0, 0),))
    assert open_case(base(), "halt", setup=setup).problem.setup == Setup(((5.0,),), ((0,),))


@pytest.mark.parametrize("frequent", CAUSES)
def test_the_most_frequent_of_causes_that_explain_alike_is_found_first(frequent: str) -> None:
    """Where one explanation is all that is asked for, it is the most probable one."""
    table = FaultTest(
        "t", "", 1, ("usual", "odd"), "usual", {cause: {"odd": 1.0} for cause in CAUSES}
    )
    counts = {cause: 90.0 if cause == frequent else 3.0 for cause in CAUSES}
    model = FaultModel(
        "three",
        {"halt": Interruption("halt", "", counts)},
        {cause: Cause(cause, "") for cause in CAUSES},
        {"t": table},
        {},
        lies=0.001,
    )
    seen = [Observation("t", "odd")]
    ((found, _),) = explain_observations(model, model.priors("halt"), seen, most=1)
    assert found == CaseHypothesis((frequent,), ())
    assert explain_observations(model, model.priors("halt"), seen)[0][0] == found
