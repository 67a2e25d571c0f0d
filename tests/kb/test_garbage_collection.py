"""Python's search for reference cycles: when it is made, and that nobody's choice is overruled."""

import gc
from collections.abc import Iterator

import pytest

from cellwright.kb.garbage_collection import search_now


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
