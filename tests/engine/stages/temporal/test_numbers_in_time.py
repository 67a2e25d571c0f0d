"""Numbers in time: what has no value, what changes by itself, lengths that numbers say, and steps
that come again.
"""

import random
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.temporal import NoPlanInTime, PlannedInTime
from cellwright.engine.pipelines.planning.temporal_plans import (
    TimeEffort,
    check_timed_plan,
    plan_with_times,
)
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.conditions import Comparison, Literal
from cellwright.kb.model.durative import (
    DurationLimit,
    DurativeAction,
    Moment,
    NumericChange,
    TemporalProblem,
    TimedChange,
    TimedCondition,
    TimedEffect,
    TimedPlan,
    TimedStep,
)
from cellwright.kb.terms import Function, Number, Operation, Term
from tests.timed_examples import task_of

DOMAIN = """
(define (domain d) (:requirements :durative-actions :numeric-fluents)
  (:predicates (done) (aside)) (:functions (x) (y))
  (:durative-action work :parameters () :duration (= ?duration {length})
    :condition (and {condition}) :effect (and (at end (done)) {effect}))
  (:durative-action help :parameters () :duration (= ?duration 1)
    :condition () :effect (and (at end (aside)) (at end {helps}))))
"""
TASK = "(define (problem q) (:domain d) (:init (= (x) 1) {facts}) (:goal (done)))"
PARTS = {"length": "2", "condition": "", "effect": "", "helps": "(aside)", "facts": ""}
FEW = TimeEffort(expansions=1000)


def outcome_of(folder: Path, **parts: str) -> PlannedInTime | NoPlanInTime:
    parts = PARTS | parts
    return plan_with_times(
        task_of(folder, DOMAIN.format(**parts), TASK.format(**parts)).problem, FEW
    )


@pytest.mark.parametrize(
    ("parts", "makespan"),
    [
        ({"effect": "(at start (increase (y) 1))", "helps": "(assign (y) 2)"}, "3.001"),
        ({"effect": "(at end (increase (y) 1))", "helps": "(assign (y) 2)"}, "2"),
        ({"effect": "(at end (increase (x) (y)))", "helps": "(assign (y) 2)"}, "2"),
        ({"effect": "(at end (increase (x) (/ 1 (x))))"}, "2"),
        (
            {
                "effect": "(at start (assign (x) (/ (x) (y))))",
                "helps": "(increase (y) 2)",
                "facts": "(= (y) 0)",
            },
            "3.001",
        ),
        (
            {
                "effect": "(at start (scale-down (x) (y)))",
                "helps": "(increase (y) 2)",
                "facts": "(= (y) 0)",
            },
            "3.001",
        ),
        ({"condition": "(at start (> (x) 1))", "facts": "(at 7 (= (x) 2))"}, "9.001"),
        ({"condition": "(at start (> (x) 2))", "facts": "(at 7 (increase (x) 2))"}, "9.001"),
        ({"condition": "(over all (< (x) 1))", "facts": "(at 7 (decrease (x) 2))"}, "9"),
        (
            {
                "condition": "(at start (> (x) 2))",
                "facts": "(at 3 (= (y) 2)) (at 5 (increase (x) (y)))",
            },
            "7.001",
        ),
        ({"length": "(/ 4 (y))", "helps": "(increase (y) 1)", "facts": "(= (y) 1)"}, "3.001"),
        ({"length": "(/ 3 (y))", "helps": "(increase (y) 7)", "facts": "(= (y) 0)"}, "1.429571"),
        ({"length": "(y)", "helps": "(assign (y) 3)"}, "4.001"),
    ],
)
def test_a_shortest_plan_waits_until_numbers_have_values(
    tmp_path: Path, parts: dict[str, str], makespan: str
) -> None:
    outcome = outcome_of(tmp_path, **parts)
    assert isinstance(outcome, PlannedInTime)
    assert outcome.plan.makespan == Fraction(makespan)


@pytest.mark.parametrize(
    "parts",
    [
        {"effect": "(at end (increase (y) 1))"},
        {"effect": "(at end (increase (x) (y)))"},
        {"effect": "(at start (scale-up (y) 2))", "helps": "(increase (y) 1)"},
        {"effect": "(at end (assign (x) (/ 1 0)))"},
        {"condition": "(at start (> (y) 0))", "helps": "(increase (y) 1)"},
        {"length": "(y)", "helps": "(increase (y) 1)"},
    ],
)
def test_what_reads_a_number_that_nothing_assigns_never_happens(
    tmp_path: Path, parts: dict[str, str]
) -> None:
    outcome = outcome_of(tmp_path, **parts)
    assert isinstance(outcome, NoPlanInTime)
    assert outcome.proved


@pytest.mark.parametrize(
    ("facts", "helps"),
    [
        ("(at 5 (increase (y) 1))", "(aside)"),
        ("(at 5 (increase (x) (y)))", "(assign (y) 3)"),
        ("(at 5 (= (y) 1)) (at 4 (increase (y) 1))", "(aside)"),
        ("(at 5 (= (y) 1)) (at 5 (increase (x) (y)))", "(aside)"),
    ],
)
def test_a_timed_change_that_may_have_no_value_is_refused(
    tmp_path: Path, facts: str, helps: str
) -> None:
    with pytest.raises(InvalidInput, match="may have no value"):
        outcome_of(tmp_path, facts=facts, helps=helps)


def test_an_instance_begins_again_after_its_end(tmp_path: Path) -> None:
    parts = {
        "condition": "(at start (>= (x) 3))",
        "helps": "(increase (x) 1)",
        "effect": "(at start (decrease (x) 1))",
    }
    outcome = outcome_of(tmp_path, **parts)
    assert isinstance(outcome, PlannedInTime)
    assert outcome.plan.makespan == Fraction("4.001")  # help takes 1, twice


NUMBERS = ("x", "y", "z")


@st.composite
def numeric_problems(draw: st.DrawFn) -> TemporalProblem:
    chance = random.Random(draw(st.integers(0, 10**6)))

    def amount() -> Term:
        number = Function(chance.choice(NUMBERS))
        constant = Number(chance.randint(0, 3))
        return chance.choice((constant, number, Operation(chance.choice("+-*/"), constant, number)))

    def change() -> NumericChange:
        kinds = ("assign", "increase", "decrease", "scale-up", "scale-down")
        return NumericChange(chance.choice(kinds), Function(chance.choice(NUMBERS)), amount())

    def test() -> Comparison:
        relation = chance.choice(("<", "<=", ">", ">=", "=", "!="))
        return Comparison(Function(chance.choice(NUMBERS)), relation, amount(), True)

    actions = []
    for number in range(3):
        conditions = [
            TimedCondition(chance.choice(list(Moment)), test()) for _ in range(chance.randint(0, 2))
        ]
        effects = [
            TimedEffect(chance.choice((Moment.START, Moment.END)), change())
            for _ in range(chance.randint(0, 2))
        ]
        effects.append(TimedEffect(Moment.END, Literal(Function(f"p{number}"))))
        length = amount() if chance.random() < 0.3 else Number(chance.randint(1, 4))
        limit = DurationLimit("=", length)
        actions.append(
            DurativeAction(f"a{number}", (), (limit,), tuple(conditions), tuple(effects))
        )
    values = {
        Function(n): Fraction(chance.randint(-1, 3)) for n in NUMBERS if chance.random() < 0.7
    }
    changes = [
        TimedChange(
            Fraction(chance.randint(1, 6)), NumericChange("assign", Function("x"), amount())
        )
        for _ in range(chance.randint(0, 1))
    ]
    goal = Literal(Function(chance.choice(("p0", "p1", "p2"))))
    return TemporalProblem("random", {}, tuple(actions), frozenset(), values, tuple(changes), goal)


@given(numeric_problems(), st.integers(0, 10**6))
@settings(max_examples=80, deadline=None)
def test_plans_with_numbers_are_right_and_no_bound_is_undercut(
    problem: TemporalProblem, seed: int
) -> None:
    try:
        outcome = plan_with_times(problem, TimeEffort(expansions=200))  # its plans are checked
    except InvalidInput:
        return
    right = right_plan(problem, random.Random(seed))
    if isinstance(outcome, NoPlanInTime):
        assert not (outcome.proved and right)
    elif right:
        assert outcome.bound <= right.makespan


def right_plan(problem: TemporalProblem, chance: random.Random) -> TimedPlan | None:
    """A random plan that the checker accepts, if one of some is."""
    for _ in range(20):
        steps, time = [], Fraction(0)
        for _ in range(chance.randint(1, 3)):
            length = Fraction(chance.randint(1, 4))
            steps.append(TimedStep(time, Function(f"a{chance.randint(0, 2)}"), length))
            time += chance.choice((length + problem.epsilon, Fraction(1, 2)))
        plan = TimedPlan(tuple(steps))
        if not check_timed_plan(problem, plan, "plan"):
            return plan
    return None
