"""The search by counts of operators: what it counts, what it finds, and values that are too
large for a search.
"""

import itertools
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from cellwright.engine.formats.interop.pddl import read_pddl_task
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found, GaveUp
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.planning.forward.balances import Balances
from cellwright.engine.stages.planning.forward.operator_counting import search_by_counts
from cellwright.kb.model.planning_problem import Problem
from tests.properties.test_quantities import cases, loaded

COUNTERS = """
(define (domain counters) (:types counter)
  (:functions (value ?c - counter) (most))
  (:action up :parameters (?c - counter) :precondition (< (value ?c) (most)) :effect (increase (value ?c) 1))
  (:action down :parameters (?c - counter) :precondition (>= (value ?c) 1) :effect (decrease (value ?c) 1)))
"""
BUCKETS = """
(define (domain buckets) (:types plant)
  (:predicates (at_tap))
  (:functions (carried) (capacity) (poured ?p - plant))
  (:action load :parameters () :precondition (and (at_tap) (< (carried) (capacity))) :effect (increase (carried) 2))
  (:action go :parameters () :precondition (at_tap) :effect (not (at_tap)))
  (:action return :parameters () :effect (at_tap))
  (:action pour :parameters (?p - plant) :precondition (and (not (at_tap)) (>= (carried) 3))
    :effect (and (decrease (carried) 3) (increase (poured ?p) 1))))
"""
DOUBLING = """
(define (domain doubling)
  (:functions (x) (z))
  (:action double :parameters () :effect (increase (x) (x)))
  (:action grow :parameters () :precondition (< (z) 90) :effect (increase (z) 1)))
"""


def problem_in(folder: Path, domain: str, init: str, goal: str, objects: str = "") -> Problem:
    (folder / "domain.pddl").write_text(domain)
    name = domain.split("(domain ")[1].split(")")[0]
    (folder / "problem.pddl").write_text(
        f"(define (problem p) (:domain {name}) (:objects {objects}) (:init {init}) (:goal (and "
        f"{goal})))"
    )
    return read_pddl_task(folder / "domain.pddl", folder / "problem.pddl").problem


def falling(folder: Path, count: int) -> Problem:
    """Counters that fall by two from each to the next, and shall rise."""
    names = [f"c{number}" for number in range(count)]
    init = " ".join(f"(= (value {name}) {2 * (count - place)})" for place, name in enumerate(names))
    pairs = itertools.pairwise(names)
    goal = " ".join(f"(<= (+ (value {one}) 1) (value {other}))" for one, other in pairs)
    return problem_in(
        folder, COUNTERS, f"(= (most) {2 * count}) {init}", goal, f"{' '.join(names)} - counter"
    )


def total(task: GroundTask) -> float | None:
    """The sum of the counts at the start."""
    assert task.axioms is not None
    counts = Balances(task.operators, task.goals[0], task.axioms).counts(
        memoryview(task.axioms.values(task.initial))
    )
    return None if counts is None else counts.total


def test_counters_that_depend_on_each_other_take_as_many_steps_as_are_counted(
    tmp_path: Path,
) -> None:
    problem = falling(tmp_path, 12)
    task = ground(problem)
    outcome = checked_plan.plan_problem(
        problem, SearchLimits(strategy="counting", improvement=0, room=None, expansions=100)
    )
    assert isinstance(outcome, Found)
    assert len(outcome.plan.steps) == total(task)


def test_what_is_used_up_is_counted_too(tmp_path: Path) -> None:
    """Four times three units are poured, and loaded by two: six loads besides four steps of
    pouring.
    """
    init, goal = (
        "(= (carried) 0) (= (capacity) 7) (= (poured a) 0) (= (poured b) 1)",
        "(= (poured a) 2) (= (poured b) 3)",
    )
    assert total(ground(problem_in(tmp_path, BUCKETS, init, goal, "a b - plant"))) == pytest.approx(
        10
    )


def test_goals_that_cannot_add_up_are_seen_without_search(tmp_path: Path) -> None:
    problem = problem_in(
        tmp_path,
        COUNTERS,
        "(= (value a) 0) (= (value b) 0) (= (most) 5)",
        "(>= (+ (value a) (value b)) 11)",
        "a b - counter",
    )
    assert total(ground(problem)) is None


def test_there_is_no_such_search_where_no_goal_asks_for_quantities(tmp_path: Path) -> None:
    problem = problem_in(
        tmp_path, BUCKETS, "(= (carried) 0) (= (capacity) 7) (at_tap)", "(not (at_tap))"
    )
    assert search_by_counts(ground(problem), 0) is None


@given(cases())
@settings(max_examples=25, deadline=None)
def test_the_counts_are_no_more_than_the_steps_of_any_plan(case: tuple[str, str]) -> None:
    with TemporaryDirectory() as folder:
        problem = loaded(*case, folder)
        task = ground(problem)
        outcome = checked_plan.plan_problem(problem, SearchLimits())
        if isinstance(outcome, Found) and task.axioms is not None and len(task.goals) == 1:
            counted = total(task)
            event(f"counted: {counted}")
            assert counted is not None
            assert counted <= len(outcome.plan.steps) + 1e-6


@pytest.mark.parametrize("strategy", ["auto", "forward", "landmarks", "novelty", "counting"])
def test_a_search_goes_on_where_values_get_too_large(tmp_path: Path, strategy: str) -> None:
    init = "(= (x) 1) (= (z) 0)"
    problem = problem_in(tmp_path, DOUBLING, init, "(>= (z) 80) (>= (x) 3)")
    outcome = checked_plan.plan_problem(
        problem, SearchLimits(strategy=strategy, improvement=0, room=None)
    )
    assert isinstance(outcome, Found)


@given(st.sampled_from(["forward", "novelty"]))
@settings(max_examples=2, deadline=None)
def test_nothing_is_proved_where_values_get_too_large(strategy: str) -> None:
    with TemporaryDirectory() as folder:
        problem = problem_in(
            Path(folder), DOUBLING, "(= (x) 3) (= (z) 0)", "(= (x) (* 5 (z))) (>= (z) 3)"
        )
        outcome = checked_plan.plan_problem(
            problem, SearchLimits(strategy=strategy, expansions=20_000)
        )
        assert isinstance(outcome, GaveUp)
