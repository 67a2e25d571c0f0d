"""Derived predicates of PDDL tasks with times: each use means what it is defined by."""

from fractions import Fraction
from pathlib import Path

import pytest

from cellwright.engine.model.temporal import PlannedInTime
from cellwright.engine.pipelines.planning.temporal_plans import TimeEffort, plan_with_times
from cellwright.kb.diagnostics import InvalidInput
from tests.timed_examples import task_of

# a guest is served where a robot is; rob can be in the hall or in the kitchen
DOMAIN = """
(define (domain rooms)
  (:requirements :typing :durative-actions :derived-predicates :adl)
  (:types robot room)
  (:constants hall - room)
  (:predicates (in ?r - robot ?o - room) (open ?o - room) (near ?o - room) (ready ?r - robot ?o - room)
    (served ?o - room) (quiet))
  (:derived (near ?o - room) (exists (?r - robot) (ready ?r ?o)))
  (:derived (ready ?r - robot ?o - room) (and (in ?r ?o) (open ?o)))
  (:derived (quiet) (not (near hall)))
  (:durative-action go :parameters (?r - robot ?a ?o - room) :duration (= ?duration 3)
    :condition (at start (in ?r ?a))
    :effect (and (at start (not (in ?r ?a))) (at end (in ?r ?o))))
  (:durative-action serve :parameters (?o - room) :duration (= ?duration 2)
    :condition (and (at start (near ?o)) (over all (near ?o)))
    :effect (at end (served ?o))))
"""
PROBLEM = """
(define (problem guests) (:domain rooms) (:objects rob - robot kitchen - room)
  (:init (in rob hall) (open hall) (open kitchen))
  (:goal (and (served hall) (served kitchen) (quiet))))
"""


def test_what_is_defined_by_others_is_planned_for(tmp_path: Path) -> None:
    problem = task_of(tmp_path, DOMAIN, PROBLEM).problem
    outcome = plan_with_times(problem, TimeEffort(expansions=500))
    assert isinstance(outcome, PlannedInTime)
    # the robot serves in the hall, goes when that has ended, and serves in the kitchen
    assert outcome.plan.makespan == Fraction("7.001")


@pytest.mark.parametrize(
    ("change", "to", "code"),
    [
        ("(and (in ?r ?o) (open ?o))", "(and (in ?r ?o) (near ?o))", "K802"),
        ("(:derived (near ?o - room)", "(:derived (far ?o - room)", "K101"),
        ("(:derived (near ?o - room)", "(:derived (near)", "K102"),
        ("(at end (served ?o))", "(at end (near ?o))", "K103"),
        ("(exists (?r - robot) (ready ?r ?o))", "(ready ?a ?o)", "K105"),
        ("(not (near hall)))", ")", "K801"),
    ],
)
def test_a_definition_that_is_wrong_is_told(
    tmp_path: Path, change: str, to: str, code: str
) -> None:
    with pytest.raises(InvalidInput) as told:
        task_of(tmp_path, DOMAIN.replace(change, to), PROBLEM)
    assert code in {each.code for each in told.value.diagnostics}


def test_a_fact_about_a_derived_predicate_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="no fact can say"):
        task_of(tmp_path, DOMAIN, PROBLEM.replace("(open hall)", "(open hall) (near hall)"))
