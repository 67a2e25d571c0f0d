"""Optimal models one after the other: cheapest first, none containing an earlier one."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.kb.asp import AspError
from cellwright.kb.asp.model_search import best_models

NAMES = "abcde"


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.sets(st.sampled_from(NAMES), min_size=1), min_size=1, max_size=4),
    st.lists(st.integers(1, 9), min_size=5, max_size=5),
)
def test_hitting_sets_come_out_as_brute_force_has_them(
    sets: list[set[str]], costs: list[int]
) -> None:
    price = dict(zip(NAMES, costs, strict=True))
    text = "{ in(X) : item(X) }. #minimize { C, X : in(X), cost(X, C) }."
    text += "".join(f"item({name}). cost({name}, {price[name]})." for name in NAMES)
    text += "".join(f":- {', '.join(f'not in({name})' for name in sorted(each))}." for each in sets)
    found = [(cost, frozenset(map(str, atoms))) for cost, atoms in best_models(text, "in", 100)]
    hitting = [
        frozenset(chosen)
        for size in range(len(NAMES) + 1)
        for chosen in itertools.combinations(NAMES, size)
        if all(each & set(chosen) for each in sets)
    ]
    minimal = {each for each in hitting if not any(other < each for other in hitting)}
    assert {chosen for _, chosen in found} == minimal
    assert [cost for cost, _ in found] == sorted(
        sum(price[name] for name in each) for each in minimal
    )


def test_no_more_come_than_were_asked_for() -> None:
    assert len(list(best_models("1 { in(1..5) } 1. #minimize { X : in(X) }.", "in", 0))) == 0
    found = list(best_models("1 { in(f(1..5)) } 1. #minimize { X : in(f(X)) }.", "in", 2))
    assert [(cost, str(atoms[0])) for cost, atoms in found] == [(1, "f(1)"), (2, "f(2)")]


def test_nothing_comes_of_a_contradiction() -> None:
    assert list(best_models("in(a). :- in(a).", "in", 3)) == []


def test_what_is_no_program_is_refused() -> None:
    with pytest.raises(AspError):
        list(best_models("in(", "in", 1))
