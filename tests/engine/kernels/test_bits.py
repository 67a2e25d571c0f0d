"""Bitsets, compiled and interpreted, agree with sets of numbers."""

from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.kernels import bits
from tests.engine.interpreted import interpreted

BOTH = pytest.mark.parametrize("module", [bits, interpreted(bits)], ids=["imported", "interpreted"])


@BOTH
@given(st.sets(st.integers(0, 400)))
def test_a_bitset_holds_exactly_its_positions_lowest_first(
    module: ModuleType, positions: set[int]
) -> None:
    made = module.bitset(iter(positions))
    assert made == sum(2**position for position in positions)
    assert module.indices(made) == sorted(positions)
