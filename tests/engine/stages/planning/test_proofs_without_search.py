"""Proofs that there is no plan: by what no state allows, and by the counters of workflow chains
alone.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.ground_task import GroundOperator
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.model.plan_explanation import Amendment, Edit
from cellwright.engine.pipelines.explanation.amendments import apply_amendment
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.planning.search_control import NO_PLAN, Effort
from cellwright.engine.stages.planning.unsolvability import UnsolvabilityProof
from cellwright.kb.loader import load_problem
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number

HOARD = """
domain: hoard
quantities: {gold: 0..2147483647, silver: 0..2147483647}
fluents:
  shut: {}
operators:
  add:
    preconditions: gold <= 2000000000
    assign: {gold: 2000000001}
  close:
    preconditions: gold + silver > 2000000001
    adds: shut
"""
MANY = Effort(1 << 60)


def weighed(target: str, weights: Sequence[int]) -> Problem:
    """A problem of the centrifuge cell whose tubes have other weights."""
    problem = load_problem(target)
    others = tuple(fact for fact in problem.statics if fact.name != "weight")
    own = (
        Function("weight", (Function(f"tube_{n}"), Number(each)))
        for n, each in enumerate(weights, 1)
    )
    return replace(problem, statics=(*others, *own))


def balanced(weights: Sequence[int]) -> bool:
    """Whether tubes can lie in a rotor of two places on each side so that both sides weigh the
    same.
    """
    sides = itertools.product((1, -1), repeat=len(weights))
    return any(
        max(side.count(1), side.count(-1)) <= 2 and sum(map(int.__mul__, side, weights)) == 0
        for side in sides
    )


def divisible(weights: Sequence[int]) -> bool:
    """Whether tubes can be divided into groups that are balanced."""
    if not weights:
        return True
    first, *rest = weights
    return any(
        balanced((first, *(rest[n] for n in chosen)))
        and divisible([each for n, each in enumerate(rest) if n not in chosen])
        for size in range(len(rest) + 1)
        for chosen in itertools.combinations(range(len(rest)), size)
    )


@pytest.mark.parametrize(
    "weights", [(12, 12, 14, 14), (12, 14, 26, 26), (0, 12, 14, 14), (0, 14, 14, 14)]
)
def test_tubes_have_a_plan_if_they_can_be_spun_in_balanced_groups(weights: tuple[int, ...]) -> None:
    outcome = checked_plan.plan_problem(
        weighed("centrifuge/four", weights), SearchLimits(expansions=20_000)
    )
    assert isinstance(outcome, Found if divisible(weights) else Infeasible)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 5), min_size=4, max_size=4))
def test_whether_tubes_can_be_spun_is_decided_for_all_weights(weights: list[int]) -> None:
    outcome = checked_plan.plan_problem(
        weighed("centrifuge/four", weights), SearchLimits(expansions=50_000)
    )
    assert isinstance(outcome, Found if divisible(weights) else Infeasible)


def test_one_tube_of_eight_that_finds_no_partner_is_proved_without_search() -> None:
    weights = (0, 12, 14, 14, 12, 12, 14, 14)
    assert not divisible(weights)
    outcome = checked_plan.plan_problem(
        weighed("centrifuge/eight", weights), SearchLimits(doubtful=True)
    )
    assert isinstance(outcome, Infeasible)
    assert outcome.statistics.counts["expanded"] == 0


def test_what_no_state_allows_is_proved_with_derived_atoms_as_they_are_defined() -> None:
    problem = checked_plan.problem_of("centrifuge/four", command="spin tube 1 for 5 min")
    assert UnsolvabilityProof(ground(problem)).run(MANY) is NO_PLAN
    both = checked_plan.problem_of("centrifuge/four", command="spin tube 1 and tube 2 for 5 min")
    assert UnsolvabilityProof(ground(both)).run(MANY) is None


@pytest.mark.parametrize(
    ("goals", "proved"),
    [
        ("content(tube_1) = 0, content(tube_1) = 1", True),
        ("content(tube_1) + content(tube_2) > 40", True),
        ("volume(buffer) = 22", False),
    ],
)
def test_goals_that_no_values_of_quantities_allow_are_proved_to_exclude_each_other(
    goals: str, proved: bool
) -> None:
    outcome = checked_plan.plan_problem(
        checked_plan.problem_of("centrifuge/four", goals=goals), SearchLimits(doubtful=True)
    )
    assert isinstance(outcome, Infeasible if proved else Found)
    assert outcome.statistics.counts["expanded"] == 0


def test_numbers_that_are_too_large_for_the_solver_are_left_to_the_search(tmp_path: Path) -> None:
    (tmp_path / "domain.yaml").write_text(HOARD)
    problem = (
        "problem: p\ndomain: hoard\ninitial: ['gold(2000000000), silver(2000000000)']\ngoals: "
        "[shut]\n"
    )
    (tmp_path / "p.yaml").write_text(problem)
    assert UnsolvabilityProof(ground(load_problem(str(tmp_path / "p.yaml")))).run(MANY) is None


def test_an_effect_that_never_happens_is_left_out_and_one_that_may_stays() -> None:
    light: Atom = Function("weight", (Function("tube_1"), Number(12)))
    problem = apply_amendment(
        load_problem("centrifuge/four"), Amendment((Edit("static", None, light),))
    )
    task = ground(problem)
    spins = [each for each in task.operators if each.instance.name == "spin"]
    moved = {str(atom) for each in spins for atom in task.names(_added(each))}
    assert '_stage("1:tube_2", 2)' not in moved
    assert '_stage("1:tube_3", 2)' in moved


def _added(operator: GroundOperator) -> int:
    found = 0
    for effect in operator.conditional:
        found |= effect.adds
    return found
