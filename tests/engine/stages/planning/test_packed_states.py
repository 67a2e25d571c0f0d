"""Packed states against the states of the task, and which states are no better than others."""

from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.formats.interop.pddl import read_pddl_task
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.planning.forward import transitions
from cellwright.engine.stages.planning.forward.packed_states import (
    PackedSpace,
    ParetoFronts,
    monotone_quantities,
)
from tests.engine.interpreted import interpreted
from tests.properties.test_quantities import cases, loaded

BOTH = pytest.mark.parametrize(
    "module", [transitions, interpreted(transitions)], ids=["imported", "interpreted"]
)


@given(cases(), st.lists(st.integers(0, 1000), max_size=6))
@settings(max_examples=15, deadline=None)
def test_packed_states_follow_those_of_the_task(case: tuple[str, str], choices: list[int]) -> None:
    with TemporaryDirectory() as folder:
        task = ground(loaded(*case, folder))
    space = PackedSpace(task.operators, len(task.atoms), task.axioms)
    state = task.initial
    packed = space.packed(state)
    for choice in choices:
        ready = [n for n, each in enumerate(task.operators) if each.preconditions & ~state == 0]
        if not ready:
            break
        number = ready[choice % len(ready)]
        state = task.after(state, task.operators[number])
        packed, done = space.after(packed, number)
        assert done == 1
        assert task.axioms is not None
        assert space.atoms(packed) == state & (1 << task.axioms.size) - 1
        own = task.axioms.values(state)
        assert all(own[n] == space.values(packed)[n] for n in compared(task))


def compared(task: GroundTask) -> set[int]:
    assert task.axioms is not None
    return {level.number for test in task.axioms.tests for level, _ in test.sum.parts}


@BOTH
@given(
    pairs=st.lists(
        st.tuples(st.integers(0, 3), st.integers(-4, 4), st.integers(-4, 4)), max_size=12
    )
)
@settings(max_examples=30)
def test_a_state_is_left_out_if_one_at_least_as_good_was_met(
    module: ModuleType, pairs: list[tuple[int, int, int]]
) -> None:
    """Two quantities, of the first more is better, of the second less; atoms 0 and 1 are
    fluents, atom 2 is derived.
    """
    fronts = ParetoFronts(module.Dominance(bytes([0b011, *[0] * 7]), [1, -1]))
    met: list[tuple[int, int, int]] = []
    for atoms, more, less in pairs:
        numbers = b"".join(each.to_bytes(8, "little", signed=True) for each in (more, less))
        plainly = any(a == atoms and m >= more and n <= less for a, m, n in met)
        assert fronts.met(bytes([atoms | (more > 0) << 2, *[0] * 7]) + numbers) == plainly
        met.append((atoms, more, less))


POWER = """
(define (domain power)
  (:requirements :typing :numeric-fluents)
  (:types hour)
  (:predicates (now ?h - hour) (next ?h ?g - hour))
  (:functions (funds) (stored) (level) (price ?h - hour))
  (:action wait :parameters (?h ?g - hour) :precondition (and (now ?h) (next ?h ?g)) :effect (and (now ?g) (not (now ?h))))
  (:action pump :parameters (?h - hour) :precondition (and (now ?h) (>= (funds) (price ?h)))
   :effect (and (decrease (funds) (price ?h)) (increase (stored) 1) (increase (level) 2)))
  (:action generate :parameters (?h - hour) :precondition (and (now ?h) (>= (stored) 1) (= (level) 2))
   :effect (and (increase (funds) (price ?h)) (decrease (stored) 1) (decrease (level) 2))))
"""
DAY = """
(define (problem day) (:domain power) (:objects h1 h2 h3 - hour)
  (:init (now h1) (next h1 h2) (next h2 h3) (= (funds) 10) (= (stored) 0) (= (level) 0)
         (= (price h1) 5) (= (price h2) 2) (= (price h3) 9))
  (:goal (>= (funds) 17)))
"""


def test_more_of_what_is_only_asked_for_in_one_direction_is_better(tmp_path: Path) -> None:
    (tmp_path / "domain.pddl").write_text(POWER)
    (tmp_path / "problem.pddl").write_text(DAY)
    problem = read_pddl_task(tmp_path / "domain.pddl", tmp_path / "problem.pddl").problem
    task = ground(problem)
    assert task.axioms is not None
    found = monotone_quantities(task.operators, task.goals[0], task.axioms)
    assert {level.quantity.name: sign for level, sign in found.items()} == {"funds": 1, "stored": 1}
    outcome = checked_plan.plan_problem(problem, SearchLimits(strategy="novelty"))
    assert isinstance(outcome, Found)
    assert [each.operator.name for each in outcome.plan.steps] == [
        "wait",
        "pump",
        "wait",
        "generate",
    ]
