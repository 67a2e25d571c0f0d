"""Plain terms are read as the grammar and clingo read them, and everything else is left to them."""

import clingo
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.kb.asp import ground_term, term_of_symbol
from cellwright.kb.plain_terms import plain_terms
from cellwright.kb.syntax import ExpressionError, _parse_by_grammar, parse_expression
from cellwright.kb.terms import Function, Number, Variable, is_ground

words = [
    "not ",
    "not",
    "at(",
    "meas(m1)",
    "12",
    "007",
    "-3",
    "_x",
    "__X",
    "min",
    "2147483648",
    "3 h",
    "3h",
    "1.5",
]
pieces = st.sampled_from([*words, *"aXf_(),(),() -'+|:é²\n\t", '"a"', "#sup", "p'"])
texts = st.lists(pieces, max_size=12).map("".join)
names = st.sampled_from(
    ["a", "f", "bolt_1", "p'", "not", "min", "X", "_", "Yes", "0", "-7", "123456789", "12 min"]
)
nested = st.recursive(
    names,
    lambda inner: st.builds(
        lambda name, arguments, gap: f"{name}({gap.join(arguments)})",
        names,
        st.lists(inner, min_size=1, max_size=3),
        st.sampled_from([",", ", ", " , "]),
    ),
    max_leaves=6,
)
starts = st.sampled_from(["atoms", "atom", "terms", "term", "conditions", "body"])


@given(texts | nested, starts)
def test_a_quick_reading_is_that_of_the_grammar(text: str, start: str) -> None:
    try:
        slow = _parse_by_grammar(start, text, "s", None)
    except ExpressionError:
        with pytest.raises(ExpressionError):
            parse_expression(start, text)
        return
    quick = parse_expression(start, text)
    assert quick.value == slow.value
    assert quick.places == slow.places


@given(texts | nested)
def test_a_quick_reading_is_that_of_clingo(text: str) -> None:
    plain = plain_terms(text)
    if plain is not None and len(plain) == 1 and is_ground(plain[0]):
        assert term_of_symbol(clingo.parse_term(text)) == plain[0]
        assert ground_term(text) == plain[0]


def test_facts_goals_and_steps_are_plain() -> None:
    assert plain_terms("position(m1, 64262, -135111, 0)") == (
        Function("position", (Function("m1"), Number(64262), Number(-135111), Number(0))),
    )
    assert plain_terms("p(_, X), q") == (
        Function("p", (Variable("_"), Variable("X"))),
        Function("q"),
    )


@pytest.mark.parametrize(
    "text",
    [
        "",
        "p(",
        "p)",
        "p()",
        "p(a",
        "p,",
        "3(a)",
        "X(a)",
        "not p",
        "a-3",
        "f" * 3000,
        "f(" * 30 + "a" + ")" * 30,
    ],
)
def test_what_is_not_plain_is_left_to_others(text: str) -> None:
    assert plain_terms(text) is None
