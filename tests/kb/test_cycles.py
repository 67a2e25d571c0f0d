"""Python's search for reference cycles: when it is made, and that nobody's choice is overruled."""

import gc
from collections.abc import Iterator

import pytest

from kb.cycles import SELDOM, search_now, seldom_searched


@pytest.fixture(autouse=True)
def seldom() -> Iterator[None]:
    before = gc.get_threshold()
    gc.set_threshold(1_000_000)
    yield
    gc.enable()
    gc.set_threshold(*before)


def test_what_stays_is_old_after_a_search() -> None:
    kept = [[number] for number in range(5_000)]
    assert gc.get_count()[0] > len(kept)
    search_now()
    assert gc.get_count()[0] < 100


def test_who_has_switched_the_search_off_is_not_searched() -> None:
    gc.disable()
    kept = [[number] for number in range(5_000)]
    search_now()
    assert gc.get_count()[0] > len(kept)


def test_the_limit_comes_back_when_the_last_has_left() -> None:
    one, other = seldom_searched(), seldom_searched()
    one.__enter__()
    other.__enter__()
    one.__exit__(None, None, None)
    assert gc.get_threshold()[0] == SELDOM
    other.__exit__(None, None, None)
    assert gc.get_threshold()[0] == 1_000_000
