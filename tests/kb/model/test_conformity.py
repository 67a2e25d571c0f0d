"""The decision rule: guard bands, narrow zones, and that no more decisions are wrong than the
risk allows.
"""

import random

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cellwright.kb.model.measured_results import (
    COVERAGE_FACTOR,
    Conformity,
    check_conformity,
    share_within,
)

NUMBERS = st.floats(-1e3, 1e3)
SIGMAS = st.floats(1e-2, 1e2)
ORDER = [Conformity.NOT_CONFORMING, Conformity.UNDECIDED, Conformity.CONFORMING]


@given(NUMBERS, SIGMAS, st.floats(-5, 5))
def test_with_one_limit_the_rule_is_a_guard_band(limit: float, sigma: float, off: float) -> None:
    assume(abs(abs(off) - 1.6449) > 1e-3)
    shown = check_conformity(limit - off * sigma, None, limit, COVERAGE_FACTOR * sigma, 5.0)
    expected = ORDER[2] if off > 1.6449 else ORDER[0] if off < -1.6449 else ORDER[1]
    assert shown is expected


@given(NUMBERS, NUMBERS, st.floats(0, 1e3), SIGMAS, st.floats(1, 49))
def test_a_value_shows_no_more_if_it_is_less_sure(
    value: float, lower: float, width: float, sigma: float, risk: float
) -> None:
    zone = (lower, lower + width)
    sure, unsure = (
        check_conformity(value, *zone, COVERAGE_FACTOR * each, risk) for each in (sigma, 2 * sigma)
    )
    if unsure is Conformity.CONFORMING:
        assert sure is Conformity.CONFORMING
    assert check_conformity(value, *zone, 0.0, risk) is not Conformity.UNDECIDED


@given(NUMBERS, st.floats(0.1, 100), SIGMAS, NUMBERS)
def test_the_share_within_is_that_of_a_normal_distribution(
    lower: float, width: float, sigma: float, value: float
) -> None:
    slices = 2000
    step = width / slices
    at = (lower + step * (n + 0.5) for n in range(slices))
    assume(step < sigma / 4)
    area = sum(2.718281828459045 ** (-0.5 * ((x - value) / sigma) ** 2) for x in at)
    slow = area * step / sigma / (2 * 3.141592653589793) ** 0.5
    assert share_within(value, lower, lower + width, sigma) == pytest.approx(slow, abs=1e-4)


def test_a_zone_too_narrow_for_the_uncertainty_never_shows_conformity() -> None:
    shown = {check_conformity(0.1 * n, -1.0, 1.0, 2.0, 5.0) for n in range(-60, 61)}
    assert shown == {Conformity.NOT_CONFORMING, Conformity.UNDECIDED}


def test_without_limits_nothing_is_shown() -> None:
    assert check_conformity(5.0, None, None, 1.0) is None


@pytest.mark.parametrize("risk", [1.0, 5.0, 20.0])
def test_of_values_near_a_limit_no_more_are_decided_wrongly_than_the_risk(risk: float) -> None:
    chance, wrong, decided = random.Random(7), 0, 0
    for _ in range(20_000):
        true = chance.uniform(-4, 4)
        shown = check_conformity(chance.gauss(true, 1.0), None, 0.0, 2.0, risk)
        if shown is not Conformity.UNDECIDED:
            decided += 1
            wrong += (shown is Conformity.CONFORMING) != (true <= 0)
    assert wrong / decided <= risk / 100
    assert decided > 2_000
