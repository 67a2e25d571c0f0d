"""Numbers that do not fit into clingo's 32 bits are told, with their rule and values."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.grounding import ground
from cellwright.kb.asp import Grounder
from cellwright.kb.asp.overflow import LEAST, MOST, WatchedRule, overflows, rules_that_watch
from cellwright.kb.diagnostics import NOWHERE, InvalidInput
from cellwright.kb.loader import load_problem

EDGES = [
    0,
    1,
    -1,
    2,
    -2,
    3,
    46_340,
    46_341,
    -46_341,
    65_536,
    2**30,
    -(2**30),
    MOST - 1,
    MOST,
    -MOST,
]
NUMBERS = st.one_of(st.sampled_from(EDGES), st.integers(-MOST, MOST))
SIGNS = {"+": int.__add__, "-": int.__sub__, "*": int.__mul__}


def told(facts: str, rule: str) -> list[str]:
    """What is said of a rule over facts."""
    watched, grounder = [WatchedRule(rule, NOWHERE, "here")], Grounder()
    grounder.ground(f"{facts}\n{rule}\n{rules_that_watch(watched)}")
    return [each.message for each in overflows(watched, grounder)]


def trees() -> Any:
    """Terms over A, B and constants: a name, a number, or (sign, left, right)."""
    leaves = st.one_of(st.sampled_from(["A", "B"]), st.integers(-5, 5))
    return st.recursive(
        leaves, lambda inner: st.tuples(st.sampled_from(sorted(SIGNS)), inner, inner), max_leaves=4
    )


def text_of(tree: Any) -> str:
    return (
        f"({text_of(tree[1])} {tree[0]} {text_of(tree[2])})"
        if isinstance(tree, tuple)
        else f"({tree})"
    )


def values_in(tree: Any, names: dict[str, int]) -> list[int]:
    """The exact values of a term and of all terms in it, its own one first."""
    if not isinstance(tree, tuple):
        return [names.get(tree, tree)]
    left, right = (values_in(part, names) for part in tree[1:])
    return [SIGNS[tree[0]](left[0], right[0]), *left, *right]


@given(
    trees(),
    NUMBERS,
    NUMBERS,
    st.sampled_from(["r(E) :- v(A,B).", "r :- v(A,B), E > 0.", "r(X) :- v(A,B), X = E."]),
)
@settings(max_examples=60, deadline=None)
def test_an_operation_is_told_where_it_does_not_fit(
    tree: Any, one: int, other: int, rule: str
) -> None:
    exact = values_in(tree, {"A": one, "B": other})
    said = told(f"v({one},{other}).", rule.replace("E", text_of(tree)))
    assert bool(said) == any(not LEAST <= each <= MOST for each in exact)


@given(st.lists(NUMBERS, max_size=6))
@settings(max_examples=40, deadline=None)
def test_a_sum_over_facts_is_told_where_it_does_not_fit(numbers: list[int]) -> None:
    facts = "".join(f"w({place},{number})." for place, number in enumerate(numbers))
    said = told(f"{facts} #defined w/2.", "r(S) :- S = #sum { N,X : w(X,N) }.")
    assert bool(said) == (not LEAST <= sum(numbers) <= MOST)


def test_what_a_condition_keeps_small_and_what_is_no_number_is_fine() -> None:
    facts = "v(2000000000). v(5). v(bolt)."
    assert not told(facts, "r(M) :- v(N), N < 1000, M = N * 1000000.")
    assert not told(facts, "r(M) :- v(N), not big(N), M = N * 1000000. big(2000000000).")
    assert told(facts, "r(M) :- v(N), M = N * 1000000.") == [
        "the product 2000000000 * 1000000 is 2000000000000000, which does not fit into 32 bits: "
        "here"
    ]


def test_powers_and_sums_with_conditions_are_told() -> None:
    facts = "v(a, 2000000000). v(b, 2000000000)."
    assert told(facts, "r(X) :- v(X,N), N ** 2 > 1.")
    assert told(facts, "r(X) :- v(X,_), #sum { N,Y : v(Y,N) } > 3.")
    assert not told(facts, "r(X) :- v(X,_), #sum { N,Y : v(Y,N), Y != X } > 3.")
    assert not told("v(2). v(0). v(-1).", "r(X) :- v(X), X ** 30 > 1.")


DOMAIN = """domain: d
include: [rules.lp]
types: {item: object}
statics: {"load(item, int)": {}}
fluents: {"done(item)": {}, idle: {}}
derived: {"ready(item)": {}}
operators:
  take(Item):
    where: WHERE
    preconditions: ready(Item)
    adds: done(Item)
"""


@pytest.mark.parametrize(
    ("where", "rules", "goal", "place"),
    [
        ("load(Item, N), N + N > 0", "ready(X) :- item(X), idle.", "done(bolt)", "domain.yaml"),
        ("load(Item, N)", "ready(X) :- load(X, N), idle, N + N > 0.", "done(bolt)", "rules.lp"),
        (
            "load(Item, N)",
            "ready(X) :- item(X), idle. big(X) :- load(X, N), N * 2 > 0.",
            "done(bolt)",
            "rules.lp",
        ),
        (
            "load(Item, N)",
            "ready(X) :- item(X), idle. :- load(X, N), N * 2 > 0.",
            "done(bolt)",
            "rules.lp",
        ),
    ],
)
def test_it_is_told_wherever_clingo_evaluates(
    tmp_path: Path, where: str, rules: str, goal: str, place: str
) -> None:
    (tmp_path / "domain.yaml").write_text(DOMAIN.replace("WHERE", where))
    (tmp_path / "rules.lp").write_text(rules)
    (tmp_path / "problems").mkdir()
    problem = tmp_path / "problems" / "p.yaml"
    text = (
        "problem: p\ndomain: d\nobjects: {item: [bolt]}\nstatics: ['load(bolt, "
        "2000000000)']\ninitial: [idle]\n"
    )
    problem.write_text(f"{text}goals: ['{goal}']\n")
    with pytest.raises(InvalidInput) as refused:
        ground(load_problem(problem))
    diagnostic = refused.value.diagnostics[0]
    assert diagnostic.code == "K113"
    assert "4000000000" in diagnostic.message
    assert place in str(diagnostic.where)


@pytest.mark.parametrize("rule", ["p(X) :- q(X).", ":- q(X), X > 3.", "p :- q(X) : r(X)."])
def test_a_rule_that_computes_nothing_is_not_parsed_again(
    rule: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("clingo.ast.parse_string")
    assert rules_that_watch([WatchedRule(rule, NOWHERE, "here")]) == ""


@pytest.mark.parametrize(
    "rule", ["p(X-1):-q(X).", "p(Y) :- q(X), Y = X - 1.", "p(Y):-q(X),Y=-1-X."]
)
def test_a_minus_beside_the_sign_of_a_rule_is_seen(rule: str) -> None:
    assert rules_that_watch([WatchedRule(rule, NOWHERE, "here")])
