"""What terms are worth and how they are ordered is what clingo says."""

import clingo
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.kb.arithmetic import compare_terms, evaluate_term, order_key
from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.terms import Function, Number, Operation, Term, Text, Variable

laws = settings(
    max_examples=200, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
LARGEST = 2**31 - 1
numbers = st.one_of(st.integers(-9, 9), st.integers(-LARGEST, LARGEST)).map(Number)
names = st.sampled_from(["a", "b", "ab", "slot", "zone"])
texts = st.sampled_from(["", "a", "b", "Z", "half-open", 'say "a"', "\\", "ä", "😀"]).map(Text)
values = st.recursive(
    st.one_of(numbers, names.map(Function), texts),
    lambda inner: st.builds(Function, names, st.lists(inner, min_size=1, max_size=3).map(tuple)),
    max_leaves=5,
)
terms = st.recursive(
    st.one_of(numbers, numbers, names.map(Function), texts),
    lambda inner: st.one_of(
        st.builds(Operation, st.sampled_from("+-*/\\"), inner, inner),
        st.builds(Function, names, st.lists(inner, min_size=1, max_size=2).map(tuple)),
    ),
    max_leaves=6,
)


def symbol(term: Term) -> clingo.Symbol:
    match term:
        case Number(value):
            return clingo.Number(value)
        case Text(value):
            return clingo.String(value)
        case Function(name, arguments):
            return clingo.Function(name, list(map(symbol, arguments)))
        case _:
            raise AssertionError(term)


def grounded(text: str) -> clingo.Control:
    control = clingo.Control(["--warn=none"], logger=lambda *_: None)
    control.add("base", [], text)
    control.ground([("base", [])])
    return control


def worth(term: Term) -> clingo.Symbol | None:
    """What clingo makes of a term in a fact; None if there is no such fact."""
    control = grounded(f"value({term}).")  # its atoms live as long as it does
    found = [atom.symbol.arguments[0] for atom in control.symbolic_atoms]
    return found[0] if found else None


@laws
@given(terms)
def test_a_term_is_worth_what_clingo_says(term: Term) -> None:
    value = evaluate_term(term)
    assert (None if value is None else symbol(value)) == worth(term)


@laws
@given(values, values)
def test_values_are_ordered_as_clingo_orders_symbols(one: Term, other: Term) -> None:
    low, high = symbol(one), symbol(other)
    assert (order_key(one) < order_key(other)) == (low < high)
    assert (order_key(one) == order_key(other)) == (low == high)


@laws
@given(terms, st.sampled_from(["=", "!=", "<", "<=", ">", ">="]), terms)
def test_a_comparison_is_true_where_clingo_derives_from_it(
    left: Term, relation: str, right: Term
) -> None:
    control = grounded(f"holds :- {left} {relation} {right}.")
    assert compare_terms(left, relation, right) == bool(len(control.symbolic_atoms))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("7 / -2", -3),
        ("-7 \\ 2", -1),
        ("7 \\ -2", 1),
        (f"{LARGEST} + 1", -LARGEST - 1),
        ("65536 * 65536", 0),
    ],
)
def test_division_rounds_towards_zero_and_sums_wrap_around(text: str, value: int) -> None:
    left, operator, right = text.split()
    assert evaluate_term(Operation(operator, Number(int(left)), Number(int(right)))) == Number(
        value
    )
    assert ground_term(f"{left} {operator} ({right})") == Number(value)


@pytest.mark.parametrize("operator", ["/", "\\"])
def test_division_by_zero_has_no_value_wherever_it_stands(operator: str) -> None:
    nothing = Operation(operator, Number(1), Number(0))
    assert evaluate_term(Function("slot", (nothing,))) is None
    assert not any(
        compare_terms(nothing, relation, nothing) for relation in ("=", "!=", "<=", ">=")
    )


def test_the_smallest_number_divided_by_minus_one_wraps_where_clingo_dies() -> None:
    assert evaluate_term(Operation("/", Number(-LARGEST - 1), Number(-1))) == Number(-LARGEST - 1)


def test_what_is_not_ground_has_no_place_in_the_order() -> None:
    with pytest.raises(ValueError, match="no value"):
        order_key(Variable("X"))


def test_arithmetic_on_constants_has_no_value_as_in_clingo() -> None:
    assert evaluate_term(Operation("+", Function("bolt"), Number(1))) is None
    with pytest.raises(AspError):
        ground_term("bolt + 1")
