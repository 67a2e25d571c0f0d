from hypothesis import given, settings
from hypothesis import strategies as st
from shares import share, shorten


def test_the_quick_suite_tries_a_share_of_the_examples_of_a_law() -> None:
    tried: list[int] = []

    @settings(max_examples=60, database=None)
    @given(st.integers())
    def law(n: int) -> None:
        tried.append(n)

    law()
    assert len(tried) == 60
    tried.clear()
    shorten(law)
    law()
    assert len(tried) == share(60) == 18


def test_no_share_is_taken_of_a_few_examples() -> None:
    assert [share(n) for n in (1, 4, 5, 10, 18, 40, 200)] == [1, 4, 5, 5, 5, 12, 60]
