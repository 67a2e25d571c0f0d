"""Conditions with alternatives and numbers, and conditional effects: what the search finds in
random tasks, the checker accepts. `plan_with_times` ends with an internal error otherwise.
"""

import random
from fractions import Fraction

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.temporal import PlannedInTime
from cellwright.engine.pipelines.planning.temporal_plans import TimeEffort, plan_with_times
from cellwright.engine.stages.instants import breaches
from cellwright.kb.model.conditions import And, Comparison, Condition, Literal, Or
from cellwright.kb.model.durative import (
    DurationLimit,
    DurativeAction,
    Moment,
    NumericChange,
    TemporalProblem,
    TimedChange,
    TimedCondition,
    TimedEffect,
    rational,
)
from cellwright.kb.terms import Function

NAMES = "pqrstu"
NUMBERS = (Function("n"), Function("m"))


def some_literal(chance: random.Random) -> Literal:
    return Literal(Function(chance.choice(NAMES)), chance.random() < 0.6)


def some_condition(chance: random.Random, depth: int = 0) -> Condition:
    kind = chance.random()
    if kind < 0.5 or depth > 1:
        return some_literal(chance)
    if kind < 0.65:
        amount = rational(Fraction(chance.randint(-1, 4)))
        return Comparison(
            chance.choice(NUMBERS), chance.choice(["<", "<=", ">", ">="]), amount, exact=True
        )
    parts = some_condition(chance, depth + 1), some_condition(chance, depth + 1)
    return Or(parts) if kind < 0.9 else And(parts)


def some_effect(chance: random.Random, moment: Moment) -> TimedEffect:
    change: Literal | NumericChange = some_literal(chance)
    if chance.random() < 0.25:
        kind = chance.choice(["increase", "decrease", "assign"])
        amount = rational(Fraction(chance.randint(1, 2)))
        change = NumericChange(kind, chance.choice(NUMBERS), amount)
    when = (TimedCondition(moment, some_condition(chance)),) if chance.random() < 0.25 else ()
    return TimedEffect(moment, change, (), when)


def some_action(chance: random.Random, name: str) -> DurativeAction:
    instantaneous = chance.random() < 0.15
    moments = [Moment.START] if instantaneous else list(Moment)
    ends = [Moment.START] if instantaneous else [Moment.START, Moment.END]
    conditions = [
        TimedCondition(chance.choice(moments), some_condition(chance))
        for _ in range(chance.randint(0, 3))
    ]
    effects = [some_effect(chance, chance.choice(ends)) for _ in range(chance.randint(1, 3))]
    relation = "=" if chance.random() < 0.6 else "<="
    limit = DurationLimit(relation, rational(Fraction(chance.randint(1, 8), 2)))
    limits = () if instantaneous else (limit,)
    return DurativeAction(name, (), limits, tuple(conditions), tuple(effects), instantaneous)


@given(st.integers(0, 10**6))
@settings(max_examples=80, deadline=None)
def test_the_checker_accepts_what_the_search_finds(seed: int) -> None:
    chance = random.Random(seed)
    actions = tuple(some_action(chance, f"a{n}") for n in range(chance.randint(2, 5)))
    times = sorted(chance.sample(range(1, 10), chance.randint(0, 2)))
    problem = TemporalProblem(
        "random",
        {},
        actions,
        frozenset(Function(name) for name in NAMES if chance.random() < 0.4),
        {NUMBERS[0]: Fraction(1), NUMBERS[1]: Fraction(2)},
        tuple(TimedChange(Fraction(time), some_literal(chance)) for time in times),
        And((some_condition(chance), some_condition(chance))),
    )
    outcome = plan_with_times(problem, TimeEffort(expansions=200))
    if isinstance(outcome, PlannedInTime):
        assert breaches(problem, outcome.plan) == []
        assert outcome.bound <= outcome.plan.makespan
