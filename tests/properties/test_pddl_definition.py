"""Random PDDL tasks, planned and validated, beside a brute force over the definition of the
language.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

from tests.properties.pddl_agreement import compared
from tests.properties.pddl_definition import Definition
from tests.properties.pddl_tasks import random_task

SEEDS = st.integers(0, 10**6)
QUICK = settings(max_examples=4, deadline=None, suppress_health_check=list(HealthCheck))


def agree(seed: int, numeric_axioms: bool = False) -> None:
    domain, problem = random_task(seed, numeric_axioms)
    with TemporaryDirectory() as folder:
        found = compared(domain, problem, Path(folder), seed)
    event(found.outcome.partition(" ")[0])
    assert not found.differences, f"{found.differences}\n{domain}\n{problem}"


@given(SEEDS)
@QUICK
def test_plans_and_verdicts_are_those_of_the_definition(seed: int) -> None:
    agree(seed)


@pytest.mark.slow
@given(SEEDS)
@settings(QUICK, max_examples=120)
def test_plans_and_verdicts_of_many_tasks(seed: int) -> None:
    agree(seed)


@pytest.mark.slow
@given(SEEDS)
@settings(QUICK, max_examples=80)
def test_plans_and_verdicts_with_axioms_over_numbers(seed: int) -> None:
    agree(seed, numeric_axioms=True)


DOMAIN = """(define (domain d) (:types a b - object c - a c - b) (:predicates (p ?x - a) (q ?x) (r)) (:functions (n ?x) (m))
  (:derived (r) (exists (?y - c) (and (p ?y) (not (q ?y)))))
  (:action go :parameters (?x - b) :precondition (and (not (p ?x)) (or (r) (>= (m) 1) (not (q ?x))))
    :effect (and (p ?x) (forall (?x - a) (when (p ?x) (q ?x))) (decrease (n ?x) 1) (assign (m) (n ?x)))))"""
PROBLEM = """(define (problem p) (:domain d) (:objects o - c u - object) (:init (= (n o) 2)) (:goal (and (r) (<= (n o) 1))))"""


def test_the_definition_itself_on_a_task_that_can_be_done_by_hand() -> None:
    definition = Definition(DOMAIN, PROBLEM)
    assert definition.of("a") == definition.of("b") == ["o"]
    assert definition.search(100) == ([("go", ("o",))], True)
    after = definition.after(definition.start(), "go", ("o",))
    assert after is not None
    assert dict(after.values) == {("n", "o"): 1, ("m",): 2}
    assert definition.after(after, "go", ("o",)) is None
    assert not definition.satisfied(["not", [">=", ["m"], "0"]], {}, definition.start())
