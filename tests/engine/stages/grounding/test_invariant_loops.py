"""Which operators break a group, compiled and interpreted, is what trying every state of the
group tells.
"""

from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.stages.grounding import invariant_loops
from tests.engine.interpreted import interpreted

SIZE = 6
BOTH = pytest.mark.parametrize(
    "module", [invariant_loops, interpreted(invariant_loops)], ids=["imported", "interpreted"]
)
sets = st.sets(st.integers(0, SIZE - 1), max_size=3).map(bitset)
# needs, adds, deletes, what conditional effects add
Operator = tuple[Bits, Bits, Bits, tuple[Bits, ...]]
operators = st.lists(
    st.tuples(
        sets, sets, sets, st.sampled_from([(), (), ()]) | st.lists(sets, max_size=2).map(tuple)
    ),
    max_size=7,
)


def breaks(group: Bits, operator: Operator) -> bool:
    """Whether two atoms of the group can be true after an operator that finds at most one of
    them true.
    """
    needs, adds, deletes, more = operator
    every = adds
    for each in more:
        every |= each
    if more and (every & group).bit_count() > 1:
        return True  # whether it can happen is not looked at
    states = [0, *(1 << atom for atom in indices(group))]
    return bool(every & group) and any(
        ((state & ~deletes | every) & group).bit_count() > 1
        for state in states
        if not needs & group & ~state
    )


@BOTH
@given(operators, sets, sets)
def test_the_first_operator_that_breaks_a_group(
    module: ModuleType, steps: list[Operator], start: Bits, group: Bits
) -> None:
    made = module.Conserving(*(list(column) for column in columns(steps)), start)
    breaking = (number for number, each in enumerate(steps) if breaks(group, each))
    expected = -1 if (start & group).bit_count() > 1 else next(breaking, None)
    assert made.broken_by(group) == (expected if group.bit_count() > 1 else None)


@BOTH
@given(operators, sets, sets)
def test_the_first_operator_that_adds_to_a_group_and_takes_nothing_of_it(
    module: ModuleType, steps: list[Operator], start: Bits, group: Bits
) -> None:
    made = module.Conserving(*(list(column) for column in columns(steps)), start)
    adding = (
        number
        for number, (needs, adds, _, more) in enumerate(steps)
        if any(each & group for each in (adds, *more)) and not needs & group
    )
    assert made.adding_without_taking(group) == next(adding, -1)


def columns(steps: list[Operator]) -> list[list[object]]:
    needs, adds, deletes, more = ([each[place] for each in steps] for place in range(4))
    return [needs, adds, deletes, more, more]
