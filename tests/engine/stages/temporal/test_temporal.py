"""Search in time: small tasks with known answers, and laws on random tasks against the slow
checker.
"""

import random
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.temporal import NoPlanInTime, PlannedInTime
from cellwright.engine.pipelines.planning.temporal_plans import TimeEffort, plan_with_times
from cellwright.engine.stages.instants import breaches
from cellwright.engine.stages.temporal.bounds import shortest_makespan
from cellwright.engine.stages.temporal.grounding import ground_times
from cellwright.kb.model.conditions import And, Literal
from cellwright.kb.model.durative import (
    DurationLimit,
    DurativeAction,
    Moment,
    TemporalProblem,
    TimedChange,
    TimedCondition,
    TimedEffect,
    TimedPlan,
    TimedStep,
    rational,
)
from cellwright.kb.terms import Function, Term
from tests.slow_time import Slow, worth
from tests.timed_examples import CELLAR, FUSES, HATCH, PATROL, ROUND, WINDOW, task_of


def length_of(term: Term) -> Fraction:
    return worth(term, {})


FEW = TimeEffort(expansions=3000)


def makespan_of(problem: TemporalProblem) -> Fraction:
    outcome = plan_with_times(problem, FEW)
    assert isinstance(outcome, PlannedInTime)
    assert Slow(problem).accepts(outcome.plan)
    assert outcome.bound <= outcome.plan.makespan
    return outcome.plan.makespan


def test_fuses_are_mended_while_matches_burn(tmp_path: Path) -> None:
    outcome = plan_with_times(task_of(tmp_path, CELLAR, FUSES).problem, FEW)
    assert isinstance(outcome, PlannedInTime)
    assert outcome.plan.makespan >= outcome.bound >= Fraction("6.002")
    assert outcome.plan.makespan <= Fraction("9.003")


def test_what_lasts_longer_than_all_light_has_no_plan(tmp_path: Path) -> None:
    dark = CELLAR.replace("(= ?duration 2)", "(= ?duration 6)")
    outcome = plan_with_times(task_of(tmp_path, dark, FUSES).problem, FEW)
    assert isinstance(outcome, NoPlanInTime)
    assert outcome.proved


def test_the_end_of_the_effort_is_no_proof(tmp_path: Path) -> None:
    outcome = plan_with_times(
        task_of(tmp_path, CELLAR, FUSES).problem, TimeEffort(interrupted=lambda: True)
    )
    assert isinstance(outcome, NoPlanInTime)
    assert not outcome.proved


def test_a_robot_charges_before_its_second_way(tmp_path: Path) -> None:
    assert makespan_of(task_of(tmp_path, PATROL, ROUND).problem) == Fraction("19.003")


def test_what_needs_a_window_waits_for_it(tmp_path: Path) -> None:
    assert makespan_of(task_of(tmp_path, HATCH, WINDOW).problem) == 13


@pytest.mark.parametrize("begin", ["(open) (washed)", "(at 2 (open)) (washed)"])
def test_what_comes_by_itself_needs_no_steps(tmp_path: Path, begin: str) -> None:
    waiting = f"(define (problem w) (:domain hatch) (:init {begin}) (:goal (and (open) (washed))))"
    outcome = plan_with_times(task_of(tmp_path, HATCH, waiting).problem, FEW)
    assert isinstance(outcome, PlannedInTime)
    assert (outcome.plan.steps, outcome.optimal) == ((), True)


def test_an_object_of_two_types_is_one_of_both(tmp_path: Path) -> None:
    both = FUSES.replace("f1 f2 f3 - fuse", "f1 f2 f3 - fuse f1 - match")
    assert task_of(tmp_path, CELLAR, both).problem.objects["f1"] >= {"fuse", "match", "object"}


DANCE = """
(define (domain dance)
  (:requirements :durative-actions)
  (:predicates (led) (followed) (danced))
  (:durative-action lead :parameters () :duration (= ?duration 4)
    :condition (over all (followed)) :effect (and (at start (led)) (at end (danced))))
  (:durative-action follow :parameters () :duration (= ?duration 4)
    :condition (over all (led)) :effect (at start (followed))))
"""
STEPS = "(define (problem one) (:domain dance) (:init) (:goal (danced)))"


def test_what_can_only_begin_together_is_not_proved_to_be_impossible(tmp_path: Path) -> None:
    problem = task_of(tmp_path, DANCE, STEPS).problem
    both = [TimedStep(Fraction(0), Function(name), Fraction(4)) for name in ("lead", "follow")]
    assert breaches(problem, TimedPlan(tuple(both))) == []
    outcome = plan_with_times(problem, FEW)
    assert isinstance(outcome, PlannedInTime) or not outcome.proved


CONDITIONAL = """
(define (domain lamps)
  (:requirements :typing :durative-actions :adl)
  (:types lamp)
  (:predicates (lit ?l - lamp) (broken ?l - lamp) (powered) (off))
  (:durative-action power :parameters () :duration (and (>= ?duration 1) (<= ?duration 4))
    :condition (at start (or (off) (exists (?l - lamp) (broken ?l))))
    :effect (and (at end (powered))
      (forall (?l - lamp) (when (at start (not (broken ?l))) (at end (lit ?l))))))
  (:action repair :parameters (?l - lamp) :precondition (and (broken ?l) (not (powered))) :effect (not (broken ?l))))
"""
LAMPS = """
(define (problem two) (:domain lamps) (:objects a b - lamp)
  (:init (broken a) (broken b)) (:goal (forall (?l - lamp) (lit ?l))))
"""


def test_conditional_effects_and_alternatives_are_variants(tmp_path: Path) -> None:
    lasting = LAMPS.replace("(broken b)", "(broken b) (off)")
    outcome = plan_with_times(task_of(tmp_path, CONDITIONAL, lasting).problem, FEW)
    assert isinstance(outcome, PlannedInTime)
    assert outcome.plan.makespan == Fraction("1.001")


def test_alternatives_that_contradict_each_other_are_no_way_to_a_plan(tmp_path: Path) -> None:
    outcome = plan_with_times(
        task_of(tmp_path, CONDITIONAL, LAMPS.replace("(broken a) ", "")).problem, FEW
    )
    assert isinstance(outcome, NoPlanInTime)
    assert outcome.proved


CHOICE = """
(define (domain choice) (:requirements :durative-actions :adl)
  (:predicates (p) (q) (r) (s))
  (:functions (n))
  (:durative-action a :parameters () :duration (= ?duration 2)
    :condition (at start READ) :effect (at end (r)))
  (:durative-action b :parameters () :duration (= ?duration 2)
    :condition (at start (p)) :effect (and (at start CHANGE) (at end (s)))))
"""
BOTH = """
(define (problem both) (:domain choice) (:init (p) (q) (= (n) 3)) (:goal (and (r) (s))))
"""


@pytest.mark.parametrize(
    ("read", "change"),
    [
        ("(or (p) (q))", "(not (q))"),
        ("(or (p) (>= (n) 2))", "(increase (n) 1)"),
        ("(and (p) (imply (q) (p)))", "(not (q))"),
        ("(p)", "(p)"),
        ("(not (s))", "(not (s))"),
    ],
)
def test_what_a_condition_reads_without_need_is_apart_from_who_changes_it(
    tmp_path: Path, read: str, change: str
) -> None:
    domain = CHOICE.replace("READ", read).replace("CHANGE", change)
    outcome = plan_with_times(task_of(tmp_path, domain, BOTH).problem, FEW)
    assert isinstance(outcome, PlannedInTime)  # the checker has accepted it
    assert outcome.plan.makespan == Fraction("2.001")


def test_instants_that_change_what_nobody_reads_are_apart_too(tmp_path: Path) -> None:
    flash = """
    (define (domain flash) (:requirements :durative-actions :duration-inequalities)
      (:predicates (lit) (seen))
      (:durative-action blink :parameters () :duration (<= ?duration 2)
        :condition () :effect (and (at start (lit)) (at end (not (lit))) (at end (seen)))))
    """
    once = "(define (problem once) (:domain flash) (:init) (:goal (seen)))"
    assert makespan_of(task_of(tmp_path, flash, once).problem) == Fraction("0.001")


NAMES = "pqrstu"


@st.composite
def problems(draw: st.DrawFn) -> TemporalProblem:
    chance = random.Random(draw(st.integers(0, 10**6)))

    def some(most: int) -> list[Literal]:
        return [
            Literal(Function(chance.choice(NAMES)), chance.random() < 0.7)
            for _ in range(chance.randint(0, most))
        ]

    actions = []
    for number in range(chance.randint(2, 5)):
        conditions = [TimedCondition(chance.choice(list(Moment)), each) for each in some(2)]
        effects = [TimedEffect(chance.choice((Moment.START, Moment.END)), each) for each in some(3)]
        limit = DurationLimit("=", rational(Fraction(chance.randint(1, 8), chance.choice((1, 2)))))
        actions.append(
            DurativeAction(f"a{number}", (), (limit,), tuple(conditions), tuple(effects))
        )
    timed = [
        TimedChange(
            Fraction(chance.randint(1, 9)),
            Literal(Function(chance.choice(NAMES)), chance.random() < 0.5),
        )
        for _ in range(chance.randint(0, 2))
    ]
    changes = tuple({(each.at, each.change.atom): each for each in timed}.values())  # type: ignore[union-attr]
    initial = frozenset(Function(name) for name in NAMES if chance.random() < 0.4)
    goal = And(tuple(dict.fromkeys(Literal(Function(chance.choice(NAMES))) for _ in range(2))))
    return TemporalProblem(
        "random", {}, tuple(actions), initial, {}, tuple(sorted(changes, key=lambda c: c.at)), goal
    )


@given(problems())
@settings(max_examples=60, deadline=None)
def test_plans_are_right_and_no_shorter_than_the_bound(problem: TemporalProblem) -> None:
    outcome = plan_with_times(problem, TimeEffort(expansions=300))
    if isinstance(outcome, PlannedInTime):
        assert Slow(problem).accepts(outcome.plan)
        assert outcome.bound <= outcome.plan.makespan
    else:
        assert outcome.proved == (shortest_makespan(ground_times(problem)) is None)


@given(problems(), st.integers(0, 10**6))
@settings(max_examples=300, deadline=None)
def test_a_right_plan_is_no_shorter_than_the_bound(problem: TemporalProblem, seed: int) -> None:
    chance = random.Random(seed)
    lengths = {action.name: action.limits[0].amount for action in problem.actions}
    steps = []
    for _ in range(chance.randint(1, 4)):
        name = chance.choice(list(lengths))
        start = Fraction(chance.randint(0, 8), 2) + Fraction(chance.randint(0, 2), 1000)
        steps.append(TimedStep(start, Function(name), length_of(lengths[name])))
    plan = TimedPlan(tuple(sorted(steps, key=lambda step: step.start)))
    reached = [
        Literal(Function(name))
        for name in NAMES
        if Slow(replace(problem, goal=Literal(Function(name)))).accepts(plan)
    ]
    if reached:
        bound = shortest_makespan(ground_times(replace(problem, goal=And(tuple(reached)))))
        assert bound is not None
        assert bound <= plan.makespan


@pytest.mark.parametrize("seed", range(3))
def test_the_same_seed_gives_the_same_plan(tmp_path: Path, seed: int) -> None:
    problem = task_of(tmp_path, CELLAR, FUSES).problem
    first, second = (
        plan_with_times(problem, TimeEffort(expansions=500, seed=seed)) for _ in range(2)
    )
    assert first == second
