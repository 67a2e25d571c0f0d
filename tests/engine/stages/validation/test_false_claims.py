"""What is said of a plan: each claim false by itself, and the same claim true, on small cells."""

from dataclasses import replace

import pytest

from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.model.plan_model import CausalLink, Claims, Happened, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from tests.engine.stages.validation.small_plans import atom, link, problem, step

BENCH = """domain: bench
types: {item: object}
objects: {item: [bolt, nut]}
statics: {"size(item, int)": {}}
fluents: {warm(item): {}, lit: {}, cold(item): {}}
events: {seen(item): {}}
operators:
  heat(Item, Size):
    where: size(Item, Size)
    adds: warm(Item)
    duration: 10 * Size
    cost: Size
    resources: oven, Item
  light: {adds: lit}
  chill(Item): {preconditions: lit, adds: cold(Item), duration: 3}
  look(Item): {preconditions: not lit, adds: seen(Item), duration: 4}
  show(Item): {preconditions: warm(Item), adds: seen(Item), deletes: warm(Item), duration: 2}
"""
SIZES = ("size(bolt, 2)", "size(nut, 3)")
HEAT_BOLT = replace(step(1, "heat(bolt, 2)", holds=("oven", "bolt")), duration=20, cost=2)
HEAT_NUT = replace(step(2, "heat(nut, 3)", 1, holds=("oven", "nut")), duration=30, cost=3)
WARM = problem("warm(bolt), warm(nut)", (), BENCH, statics=SIZES)
BOTH = (HEAT_BOLT, HEAT_NUT)


def said(
    posed: Problem,
    steps: tuple[Step, ...],
    claims: Claims | None = None,
    links: tuple[CausalLink, ...] = (),
) -> list[str]:
    """What the checker has against a plan and what is claimed of it, each as `code: message`."""
    found = validate_plan(posed, Plan(steps, links), claims=claims or Claims())
    return [f"{each.code}: {each.message}" for each in found]


def starting(**starts: int) -> Claims:
    """Claims of start times; `s1=3`: step 1 starts at 3."""
    return Claims({StepId(int(name[1:])): time for name, time in starts.items()})


@pytest.mark.parametrize(
    "claims",
    [
        Claims(),
        starting(s1=0),
        starting(s1=0, s2=20),
        starting(s1=5, s2=26),
        starting(s2=1000),
        replace(starting(s1=5), makespan=55),
        Claims(cost=5),
        Claims(makespan=50),
        replace(starting(s2=21), makespan=51),
        Claims(cost=5, makespan=50),
    ],
)
def test_true_claims_are_accepted(claims: Claims) -> None:
    assert said(WARM, BOTH, claims) == []


@pytest.mark.parametrize(
    ("claims", "why"),
    [
        (starting(s1=-1), ["step 1 heat(bolt, 2) starts at -1, before 0"]),
        (starting(s2=19), ["step 2 heat(nut, 3) starts at 19, but step 1 ends at 20"]),
        (starting(s1=1, s2=20), ["step 2 heat(nut, 3) starts at 20, but step 1 ends at 21"]),
        (
            starting(s1=-1, s2=18),
            [
                "step 1 heat(bolt, 2) starts at -1, before 0",
                "step 2 heat(nut, 3) starts at 18, but step 1 ends at 19",
            ],
        ),
        (Claims(cost=4), ["the cost is 5, not 4"]),
        (Claims(cost=0), ["the cost is 5, not 0"]),
        (Claims(makespan=49), ["the makespan is 50, not 49"]),
        (Claims(makespan=51), ["the makespan is 50, not 51"]),
        (Claims(makespan=0), ["the makespan is 50, not 0"]),
        (replace(starting(s2=21), makespan=50), ["the makespan is 51, not 50"]),
        (Claims(cost=6, makespan=7), ["the makespan is 50, not 7", "the cost is 5, not 6"]),
        (Claims(told=49), ["the makespan is 50, not 49"]),
        (Claims(makespan=49, told=49), ["the makespan is 50, not 49"]),
        (Claims(told=50, bound=51), ["the makespan is 50, so it is less than its lower bound 51"]),
    ],
)
def test_false_times_and_sums_are_told(claims: Claims, why: list[str]) -> None:
    assert said(WARM, BOTH, claims) == [f"K508: {each}" for each in why]


def test_sums_are_those_of_the_domain_where_a_step_says_something_else() -> None:
    cheap = (replace(HEAT_BOLT, cost=1), HEAT_NUT)
    assert said(WARM, cheap, Claims(cost=5)) == ["K508: step 1 heat(bolt, 2) has the cost 2, not 1"]
    quick = (replace(HEAT_BOLT, duration=1), HEAT_NUT)
    assert said(WARM, quick, replace(starting(s2=20), makespan=50)) == [
        "K508: step 1 heat(bolt, 2) has the duration 20, not 1"
    ]
    assert "K508: step 2 heat(nut, 3) starts at 1, but step 1 ends at 20" in said(
        WARM, quick, replace(starting(s2=1), makespan=31)
    )


def test_steps_that_wait_for_nothing_may_start_at_once_and_the_last_end_is_the_makespan() -> None:
    apart = (HEAT_BOLT, replace(HEAT_NUT, after=()))
    posed = problem(
        "warm(bolt), warm(nut)",
        (),
        BENCH.replace("resources: oven, Item", "resources: Item"),
        statics=SIZES,
    )
    steps = tuple(replace(each, resources=each.resources[1:]) for each in apart)
    assert said(posed, steps, Claims(makespan=30)) == []
    assert said(posed, steps[::-1], Claims(makespan=30)) == []
    assert said(posed, steps, Claims(makespan=20)) == ["K508: the makespan is 30, not 20"]


def test_a_step_waits_for_the_last_of_those_before_it() -> None:
    posed = problem("warm(bolt), warm(nut), lit", (), BENCH, statics=SIZES)
    steps = (HEAT_BOLT, HEAT_NUT, step(3, "light", 1, 2))
    assert said(posed, steps, starting(s3=50)) == []
    assert said(posed, steps, starting(s3=49)) == [
        "K508: step 3 light starts at 49, but step 2 ends at 50"
    ]
    assert said(posed, steps, starting(s3=10)) == [
        "K508: step 3 light starts at 10, but step 1 ends at 20",
        "K508: step 3 light starts at 10, but step 2 ends at 50",
    ]


def test_the_empty_plan_ends_at_once() -> None:
    posed = problem("", (), BENCH, statics=SIZES)
    assert said(posed, (), Claims(makespan=0, cost=0)) == []
    assert said(posed, (), Claims(makespan=1)) == ["K508: the makespan is 0, not 1"]


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"duration": 21}, "K508: step 1 heat(bolt, 2) has the duration 20, not 21"),
        ({"duration": 0}, "K508: step 1 heat(bolt, 2) has the duration 20, not 0"),
        ({"cost": 1}, "K508: step 1 heat(bolt, 2) has the cost 2, not 1"),
        ({"resources": HEAT_BOLT.resources[:1]}, "K501: step 1 heat(bolt, 2) must hold oven, bolt"),
        (
            {"resources": (*HEAT_BOLT.resources, atom("lamp"))},
            "K508: step 1 heat(bolt, 2) holds no lamp",
        ),
        ({"resources": ()}, "K501: step 1 heat(bolt, 2) must hold oven, bolt"),
    ],
)
def test_what_a_step_lasts_costs_and_holds_is_as_the_domain_says(
    changed: dict[str, object], why: str
) -> None:
    posed = problem("warm(bolt)", (), BENCH, statics=SIZES)
    assert said(posed, (HEAT_BOLT,)) == []
    assert said(posed, (replace(HEAT_BOLT, **changed),)) == [why]  # type: ignore[arg-type]


def test_what_a_step_lasts_is_no_less_than_zero() -> None:
    still = replace(HEAT_BOLT, operator=atom("heat(bolt, 0)"), duration=0, cost=0)
    assert said(problem("warm(bolt)", (), BENCH, statics=("size(bolt, 0)",)), (still,)) == []
    back = replace(still, operator=atom("heat(bolt, -1)"), duration=-10, cost=-1)
    why = "K501: step 1 heat(bolt, -1): its duration is -10"
    assert said(problem("warm(bolt)", (), BENCH, statics=("size(bolt, -1)",)), (back,)) == [why]


def test_what_a_step_costs_is_no_less_than_zero() -> None:
    domain = BENCH.replace("cost: Size", "cost: Size - 3")
    posed = problem("warm(bolt)", (), domain, statics=SIZES)
    assert said(posed, (replace(HEAT_BOLT, cost=-1),)) == [
        "K501: step 1 heat(bolt, 2): its cost is -1"
    ]


@pytest.mark.parametrize(
    ("key", "amount"), [("duration: 10 * Size", "((10*2)/0)"), ("cost: Size", "(2/0)")]
)
def test_a_step_whose_duration_or_cost_has_no_value_does_not_exist(key: str, amount: str) -> None:
    posed = problem("warm(bolt)", (), BENCH.replace(key, f"{key} / 0"), statics=SIZES)
    assert said(posed, (HEAT_BOLT,)) == [f"K501: step 1 heat(bolt, 2): {amount} has no value"]


def test_a_step_whose_resource_has_no_value_does_not_exist() -> None:
    posed = problem(
        "warm(bolt)", (), BENCH.replace("oven, Item", "oven, slot(Size / 0)"), statics=SIZES
    )
    why = "K501: step 1 heat(bolt, 2): a resource that it must hold has no value"
    assert said(posed, (HEAT_BOLT,)) == [why]


# Histories.

SEEN = problem("", (), BENCH, ("{name: bolt, stages: 'seen(bolt), cold(bolt)'}",), statics=SIZES)
SHOWN = (
    replace(step(1, "look(bolt)"), duration=4),
    step(2, "light", 1),
    replace(step(3, "chill(bolt)", 2), duration=3),
)
STAGES = (link(1, '_stage("bolt", 1)', 3), link(3, '_stage("bolt", 2)', -1))
FIRST, SECOND = (
    Happened("bolt", "seen(bolt)", StepId(1), 0, 4),
    Happened("bolt", "cold(bolt)", StepId(3), 4, 3),
)


def history(*lines: Happened) -> Claims:
    return Claims(histories=lines)


@pytest.mark.parametrize(
    ("claims", "why"),
    [
        (history(), []),
        (history(FIRST, SECOND), []),
        (history(FIRST), ["a history lacks a stage"]),
        (history(SECOND, FIRST), ["a history lacks a stage"]),
        (
            history(FIRST, replace(SECOND, start=5)),
            ["the history of bolt has no cold(bolt) by step 3 from 5 for 3"],
        ),
        (
            history(replace(FIRST, duration=5), SECOND),
            ["the history of bolt has no seen(bolt) by step 1 from 0 for 5"],
        ),
        (
            history(FIRST, replace(SECOND, step=StepId(2))),
            ["the history of bolt has no cold(bolt) by step 2 from 4 for 3"],
        ),
        (
            history(replace(FIRST, chain="nut"), SECOND),
            ["the history of nut has no seen(bolt) by step 1 from 0 for 4"],
        ),
        (
            history(FIRST, SECOND, replace(SECOND, stage="lit")),
            ["the history of bolt has no lit by step 3 from 4 for 3"],
        ),
        (replace(history(FIRST, replace(SECOND, start=9)), starts={StepId(3): 9}), []),
    ],
)
def test_histories_are_as_the_plan_makes_them(claims: Claims, why: list[str]) -> None:
    assert said(SEEN, SHOWN, claims, STAGES) == [f"K508: {each}" for each in why]


# Links that serve nobody.


@pytest.mark.parametrize(
    ("idle", "why"),
    [
        (link(1, "warm(bolt)", -1), []),
        (link(1, "warm(bolt)", 2), ["link 1 to 2 for warm(bolt): the consumer does not need it"]),
        (link(2, "warm(nut)", -1), []),
        (link(0, "not(lit)", -1), ["link 0 to -1 for not(lit): the consumer does not need it"]),
    ],
)
def test_a_link_serves_its_consumer(idle: CausalLink, why: list[str]) -> None:
    assert said(WARM, BOTH, links=(idle,)) == [f"K504: {each}" for each in why]


@pytest.mark.parametrize(
    ("stage", "why"),
    [
        (link(0, '_stage("bolt", 0)', 1), ""),
        (link(1, '_stage("bolt", 0)', 3), "the producer does not reach it"),
        (link(0, '_stage("bolt", 1)', 3), "the producer does not reach it"),
        (link(2, '_stage("bolt", 1)', 3), "the producer does not reach it"),
        (link(1, '_stage("bolt", 2)', 3), "the producer does not reach it"),
        (link(3, '_stage("bolt", 1)', 1), "the producer is not ordered before the consumer"),
        (link(3, '_stage("bolt", 2)', -1), ""),
        (link(3, '_stage("bolt", 3)', -1), "there is no such stage"),
        (link(0, '_stage("bolt", -1)', 1), "there is no such stage"),
        (link(1, '_stage("nut", 1)', 3), "there is no such stage"),
        (link(1, '_stage("bolt")', 3), "there is no such stage"),
        (link(1, "_stage(bolt, 1)", 3), "there is no such stage"),
        (link(1, '_stage("bolt", lit)', 3), "there is no such stage"),
    ],
)
def test_a_link_for_a_stage_names_the_step_that_reaches_it(stage: CausalLink, why: str) -> None:
    told = f"K504: link {stage.producer} to {stage.consumer} for {stage.condition}: {why}"
    assert said(SEEN, SHOWN, links=(stage,)) == ([told] if why else [])


def test_a_step_that_does_not_hold_what_it_must_is_not_executed() -> None:
    """Its precondition does not hold either, but it is not asked for."""
    posed = problem(
        "cold(bolt)", (), BENCH.replace("adds: cold(Item),", "adds: cold(Item), resources: Item,")
    )
    step_ = replace(step(1, "chill(bolt)"), duration=3)
    assert said(posed, (step_,)) == ["K501: step 1 chill(bolt) must hold bolt"]


def test_a_plan_without_links_has_the_histories_of_its_steps() -> None:
    assert said(SEEN, SHOWN, history(FIRST, SECOND), ()) == []
    wrong = history(replace(FIRST, start=1), SECOND)
    assert said(SEEN, SHOWN, wrong, ()) == [
        "K508: the history of bolt has no seen(bolt) by step 1 from 1 for 4"
    ]
