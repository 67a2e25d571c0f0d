"""How often a step is repeated, against adding it again and again."""

import operator
from array import array

from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.kernels.sums import NEVER, Comparisons, Repetitions
from cellwright.engine.model.ground_axioms import COMPARISON_SIGNS

HOLDS = dict(
    zip(
        COMPARISON_SIGNS,
        (operator.eq, operator.ne, operator.lt, operator.le, operator.gt, operator.ge),
        strict=True,
    )
)
small = st.integers(-30, 30)


@given(
    small,
    small.filter(bool),
    st.integers(-3, 3).filter(bool),
    st.sampled_from(COMPARISON_SIGNS),
    st.integers(1, 5),
)
def test_a_step_is_repeated_until_the_comparison_holds(
    value: int, gain: int, factor: int, relation: str, cost: int
) -> None:
    compared = Comparisons([[(0, factor)]], [7], [COMPARISON_SIGNS.index(relation)], [0], [1], 1)
    wanted = Repetitions(compared, [0], [COMPARISON_SIGNS.index(relation)], [gain], [cost])
    total = 7 + factor * value
    row = compared.true(array("q", [value]))
    assert row[0] & 1 == HOLDS[relation](total, 0)
    assert row[0] >> 1 & 1 == (not HOLDS[relation](total, 0))
    assert list(wanted.needed(array("q", [value]))) == [_slowly(total, gain, relation, cost)]


def _slowly(total: int, gain: int, relation: str, cost: int) -> int:
    if HOLDS[relation](total, 0):
        return cost
    for times in range(1, 200):
        before, total = total, total + gain
        if HOLDS[relation](total, 0) or (relation == "=" and (before < 0) != (total < 0)):
            return times * cost  # past an equality counts as there
    return NEVER
