"""The kernels of forward search, compiled and interpreted, agree with each other and with sets."""

from types import ModuleType
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.kernels.packed_rows import PackedRows
from cellwright.engine.stages.planning.forward import kernels
from tests.engine.interpreted import interpreted

SIZE = 19  # atoms, more than two bytes of them
Lists = list[list[int]]


PLAIN = interpreted(kernels)
FAR: int = PLAIN.MOST
BOTH = pytest.mark.parametrize("module", [kernels, PLAIN], ids=["imported", "interpreted"])
atoms = st.lists(st.integers(0, SIZE - 1), max_size=4, unique=True)
states = st.sets(st.integers(0, SIZE - 1))


class Relaxed(NamedTuple):
    """Operators without deletes, and goals."""

    costs: list[int]
    goals: list[int]
    need: Lists
    add: Lists

    def users(self) -> Lists:
        """The operators that need each atom."""
        return [
            [number for number, needed in enumerate(self.need) if atom in needed]
            for atom in range(SIZE)
        ]


@st.composite
def tasks(draw: st.DrawFn) -> Relaxed:
    count = draw(st.integers(0, 12))
    lists = st.lists(atoms, min_size=count, max_size=count)
    costs = st.lists(st.integers(1, 5), min_size=count, max_size=count)
    return Relaxed(draw(costs), draw(atoms), draw(lists), draw(lists))


def made(module: ModuleType, task: Relaxed) -> kernels.RelaxedPlans:
    rows = [PackedRows(lists) for lists in (task.need, task.add, task.users())]
    plans: kernels.RelaxedPlans = module.RelaxedPlans(task.costs, task.goals, *rows)
    return plans


def packed(chosen: set[int], size: int = SIZE) -> bytes:
    return sum(1 << each for each in chosen).to_bytes((size + 7) // 8, "little")


def additive(task: Relaxed, state: set[int]) -> list[int]:
    """Additive costs of all atoms, by going over all operators until nothing changes."""
    costs = [0 if atom in state else FAR for atom in range(SIZE)]
    before: list[int] = []
    while before != costs:
        before = costs.copy()
        for own, need, add in zip(task.costs, task.need, task.add, strict=True):
            spent = min(own + sum(costs[atom] for atom in need), FAR)
            for atom in add:
                costs[atom] = min(costs[atom], spent)
    return costs


@BOTH
@given(task=tasks(), state=states)
def test_relaxed_plans_agree_with_sets(module: ModuleType, task: Relaxed, state: set[int]) -> None:
    plans = made(module, task)
    estimate = plans.evaluate(packed(state))
    plainly = [number for number, needed in enumerate(task.need) if set(needed) <= state]
    assert sorted(plans.applicable) == plainly
    assert set(plans.preferred) <= set(plainly)
    costs = [additive(task, state)[goal] for goal in task.goals]
    if max(costs, default=0) == FAR:
        assert estimate == -1
        assert plans.preferred == []
    else:
        assert max(costs, default=0) > 0 or estimate == 0
        assert (estimate > 0) == bool(plans.preferred)
        assert estimate <= sum(costs)
        assert estimate >= sum(task.costs[number] for number in plans.preferred)


@BOTH
@given(task=tasks(), state=states)
def test_with_one_condition_each_a_relaxed_plan_for_one_goal_is_shortest(
    module: ModuleType, task: Relaxed, state: set[int]
) -> None:
    """A chain: its cost is the additive one, which is then a length of a shortest path."""
    chain = task._replace(goals=task.goals[:1], need=[need[:1] for need in task.need])
    costs = additive(chain, state)
    estimate = made(module, chain).evaluate(packed(state))
    wanted = sum(costs[goal] for goal in chain.goals)
    assert estimate == (-1 if wanted == FAR else wanted)


@given(task=tasks(), visited=st.lists(states, min_size=1, max_size=3))
def test_compiled_and_interpreted_relaxed_plans_are_the_same(
    task: Relaxed, visited: list[set[int]]
) -> None:
    compiled, plain = made(kernels, task), made(PLAIN, task)
    for state in map(packed, visited):
        assert compiled.evaluate(state) == plain.evaluate(state)
        assert (compiled.applicable, compiled.preferred) == (plain.applicable, plain.preferred)


@BOTH
def test_costs_that_double_with_every_step_are_cut_off(module: ModuleType) -> None:
    """Two atoms, each of two operators' work, need both before them: 2 ** 70 by simple addition."""
    length = 70
    lists = [[0], *[[place, length + place] for place in range(1, length)]]
    need = [needed for needed in lists for _ in range(2)]
    add = [[place + 1 + side * length] for place in range(length) for side in (0, 1)]
    users = [
        [number for number, needed in enumerate(need) if atom in needed]
        for atom in range(2 * length + 1)
    ]
    rows = [PackedRows(each) for each in (need, add, users)]
    plans = module.RelaxedPlans([1] * len(need), [length], *rows)
    assert plans.evaluate(packed({0}, 2 * length + 1)) == 2 * length - 1


def accepted_after(before: Lists, places: Lists, accepted: set[int], state: set[int]) -> set[int]:
    for landmark, atoms in enumerate(places):
        if state & set(atoms) and set(before[landmark]) <= accepted:
            accepted = accepted | {landmark}
    return accepted


@BOTH
@given(st.data())
def test_landmarks_counted_agree_with_sets(module: ModuleType, data: st.DataObject) -> None:
    atoms = st.lists(st.integers(0, SIZE - 1), min_size=1, max_size=3, unique=True)
    places = data.draw(st.lists(atoms, min_size=1, max_size=12))
    some = st.lists(st.integers(0, len(places) - 1), max_size=3, unique=True)
    before, just_before = (
        data.draw(st.lists(some, min_size=len(places), max_size=len(places))) for _ in range(2)
    )
    goals = data.draw(some)
    count = module.LandmarkCount(
        PackedRows(places), PackedRows(before), PackedRows(just_before), goals
    )
    accepted: set[int] = set()
    row = packed(accepted, len(places))
    for state in data.draw(st.lists(states, max_size=4)):
        accepted = accepted_after(before, places, accepted, state)
        row = count.accept(row, packed(state))
        assert row == packed(accepted, len(places))
        open_ = set(range(len(places))) - accepted
        again = {
            *goals,
            *(other for landmark in open_ for other in just_before[landmark]),
        } & accepted
        again = {landmark for landmark in again if not state & set(places[landmark])}
        assert count.left(row, packed(state)) == len(open_) + len(again)


def test_only_operators_that_are_listed_are_told_as_applicable() -> None:
    """The others count in relaxed plans all the same."""
    need, add = PackedRows([[0], [0], [1]]), PackedRows([[1], [2], [2]])
    plans = kernels.RelaxedPlans([5, 9, 1], [2], need, add, PackedRows([[0, 1], [2], []]), 1)
    assert (plans.evaluate(b"\x01"), plans.applicable) == (6, [0])
    assert (sorted(plans.relaxed), plans.preferred) == ([0, 2], [0])
