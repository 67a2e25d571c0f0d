"""Sets of numbers as bits, beside sets of Python."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.model.run_protocol import NumberSet

numbers = st.integers(0, 60)


@given(st.lists(st.tuples(st.booleans(), numbers)), st.sets(numbers))
def test_it_is_the_set_that_python_has(changes: list[tuple[bool, int]], other: set[int]) -> None:
    found, plain = NumberSet(), set[int]()
    for adds, number in changes:
        (found.add if adds else found.discard)(number)
        (plain.add if adds else plain.discard)(number)
        assert (number in found) == (number in plain)
    assert list(found) == sorted(plain)
    assert len(found) == len(plain)
    assert set(found | other) == plain | other
    assert NumberSet(plain) == plain


def test_what_is_no_number_from_0_on_is_not_in_it() -> None:
    found = NumberSet([0, 3])
    assert -1 not in found
    assert "3" not in found
    with pytest.raises(ValueError, match="negative"):
        found.add(-1)


def test_a_million_numbers_take_an_eighth_of_a_megabyte() -> None:
    found = NumberSet(range(1_000_000))
    assert len(found._bits) == 125_000
