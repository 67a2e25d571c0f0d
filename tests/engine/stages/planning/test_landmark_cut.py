"""The bound of landmark cuts stays below the cost of every plan, and is the cost itself where steps
form a chain.
"""

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.bits import Bits, bitset
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.stages.planning.landmark_cut import FAR, lower_bound
from cellwright.kb.terms import Function

SIZE = 7
sets = st.sets(st.integers(0, SIZE - 1), max_size=2).map(bitset)


def task_of(operators: list[GroundOperator], initial: Bits, *goals: Bits) -> GroundTask:
    atoms = tuple(Function(f"p{number}") for number in range(SIZE))
    return GroundTask(atoms, tuple(operators), initial, goals, (1,) * SIZE)


@st.composite
def relaxed_and_real(draw: st.DrawFn) -> GroundTask:
    operators = [
        GroundOperator(
            Function(f"o{number}"), draw(sets), draw(sets), draw(sets), cost=draw(st.integers(0, 4))
        )
        for number in range(draw(st.integers(1, 8)))
    ]
    return task_of(operators, draw(sets), *draw(st.lists(sets, min_size=1, max_size=2)))


def least(task: GroundTask) -> int | None:
    """The cost of a cheapest plan: the costs of states get smaller until none does."""
    costs = {task.initial: 0}
    while True:
        better = dict(costs)
        for state, cost in costs.items():
            for each in task.operators:
                if not each.preconditions & ~state:
                    after = progress_state(state, each)
                    better[after] = min(better.get(after, FAR), cost + each.cost)
        if better == costs:
            break
        costs = better
    return min((c for s, c in costs.items() if any(not g & ~s for g in task.goals)), default=None)


@given(relaxed_and_real())
@settings(max_examples=200, deadline=None)
def test_no_plan_costs_less_than_the_bound(task: GroundTask) -> None:
    bound, cost = lower_bound(task, FAR), least(task)
    assert bound <= (FAR if cost is None else cost)
    assert lower_bound(task, 2) <= bound


def test_a_chain_of_steps_costs_what_the_bound_tells() -> None:
    steps = [
        GroundOperator(Function(f"o{n}"), 1 << n, 2 << n, 1 << n, cost=n + 1) for n in range(4)
    ]
    assert lower_bound(task_of(steps, 1, 1 << 4), FAR) == 1 + 2 + 3 + 4


def test_what_nothing_reaches_is_beyond_all_costs() -> None:
    step = GroundOperator(Function("o"), 1, 2, 0)
    assert lower_bound(task_of([step], 1, 4), FAR) == FAR
    assert lower_bound(task_of([step], 1, 4, 1), FAR) == 0
