"""The goals that exclude one another are found by halves, as leaving out one after the other
finds them.
"""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.pipelines.explanation.unreachable_goals import minimal_goals
from cellwright.kb.loader import load_problem
from cellwright.kb.model.conditions import And, Literal, goal_parts
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Number

Conflicts = frozenset[frozenset[int]]


def wanting(count: int) -> Problem:
    """A problem with goals by number."""
    goals = (Literal(Function("wanted", (Number(number),))) for number in range(count))
    bundled = load_problem("themse/one")
    return Problem("p", bundled.domain, goal=And(tuple(goals)))


def numbers(problem: Problem) -> frozenset[int]:
    found = [
        part.atom.arguments[0] for part in goal_parts(problem.goal) if isinstance(part, Literal)
    ]
    return frozenset(each.value for each in found if isinstance(each, Number))


def one_after_another(count: int, conflicts: Conflicts) -> set[int]:
    """A single goal if there is one; else what is left when each goal is left out that can be."""
    single = [number for number in range(count) if frozenset({number}) in conflicts]
    if single:
        return {single[0]}
    kept = set(range(count))
    for number in range(count):
        if any(each <= kept - {number} for each in conflicts):
            kept.remove(number)
    return kept


@given(st.data())
def test_halves_find_what_one_after_another_finds(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 12))
    some = st.frozensets(st.integers(0, count - 1), min_size=1, max_size=4)
    conflicts = data.draw(st.frozensets(some, min_size=1, max_size=4))
    found = minimal_goals(
        wanting(count), lambda each: any(known <= numbers(each) for known in conflicts)
    )
    assert {int(str(goal)[len("wanted(") : -1]) for goal in found} == one_after_another(
        count, conflicts
    )


@pytest.mark.parametrize("conflict", [{3}, {0, 63}, {20, 21, 22}])
def test_few_of_many_goals_are_found_with_few_questions(conflict: set[int]) -> None:
    asked = list[int]()

    def infeasible(problem: Problem) -> bool:
        asked.append(len(numbers(problem)))
        return conflict <= numbers(problem)

    assert len(minimal_goals(wanting(64), infeasible)) == len(conflict)
    assert len(asked) < 40


def test_what_is_not_decided_may_hold_what_is_out_of_reach_by_itself() -> None:
    found = minimal_goals(wanting(8), lambda each: True if numbers(each) == {5} else None)
    assert list(map(str, found)) == ["wanted(5)"]
