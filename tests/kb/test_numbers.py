"""Numbers in files: finite, not too large, in few digits, in plain ASCII."""

import math
from contextlib import suppress
from decimal import Decimal

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cellwright.kb.numbers import (
    MAX_FILE_NUMBER,
    NumberError,
    is_number,
    read_decimal,
    read_finite,
    read_whole,
)

BAD = [
    "",
    "nan",
    "inf",
    "-Infinity",
    "1_0",
    "１",
    "²",
    "0x10",
    "1e",
    "--1",
    "1 2",
    "1e400",
    "9" * 5000,
    "1e16",
]


@pytest.mark.parametrize("text", BAD)
def test_what_is_no_number_is_refused(text: str) -> None:
    with pytest.raises(NumberError):
        read_decimal(text)
    with pytest.raises(NumberError):
        read_whole(text)


@given(st.floats(-MAX_FILE_NUMBER, MAX_FILE_NUMBER))
def test_numbers_are_read_as_they_were_written(value: float) -> None:
    assert read_decimal(repr(value)) == value


@given(st.floats(allow_nan=False, allow_infinity=False))
@example(5e-324)
@example(-1.7976931348623157e308)
def test_numbers_of_any_size_are_read_without_an_exponent_too(value: float) -> None:
    assert read_finite(format(Decimal(repr(value)), "f")) == value


@pytest.mark.parametrize("value", [math.nan, math.inf, 10**400, True, "1", None, [1]])
def test_values_that_are_no_finite_numbers(value: object) -> None:
    assert not is_number(value)


@given(st.integers(-(10**15), 10**15), st.integers(-(10**15), 10**15))
def test_whole_numbers_have_a_least(value: int, least: int) -> None:
    if value >= least:
        assert read_whole(str(value), least) == value
    else:
        with pytest.raises(NumberError, match="is less than"):
            read_whole(str(value), least)


@given(st.text(max_size=12))
def test_any_text_is_a_number_or_refused(text: str) -> None:
    with suppress(NumberError):
        assert math.isfinite(read_decimal(text))
