import copy
import dataclasses
import pickle

from hypothesis import given
from hypothesis import strategies as st

from cellwright.kb.terms import (
    ANYTHING,
    Function,
    Number,
    Operation,
    Term,
    Variable,
    is_ground,
    match_term,
    resolve_term,
    substitute_atom,
    substitute_term,
    term_variables,
    unify,
)

leaves = st.one_of(
    st.integers(-9, 9).map(Number),
    st.sampled_from("abc").map(Function),
    st.sampled_from("XYZ").map(Variable),
)
terms = st.recursive(
    leaves,
    lambda inner: st.builds(Function, st.sampled_from("fg"), st.tuples(inner, inner)),
    max_leaves=6,
)
ground_terms = terms.filter(is_ground)
sums = st.recursive(
    leaves,
    lambda inner: (
        st.builds(Operation, st.sampled_from("+*"), inner, inner)
        | st.builds(Function, st.sampled_from("fg"), st.tuples(inner, inner))
    ),
    max_leaves=6,
)


@given(
    terms,
    st.dictionaries(
        st.sampled_from([Variable(name) for name in "XYZ"]), ground_terms, min_size=3, max_size=3
    ),
)
def test_a_pattern_matches_each_of_its_instances(
    pattern: Term, bindings: dict[Variable, Term]
) -> None:
    instance = substitute_term(pattern, bindings)
    found = match_term(pattern, instance, {})
    assert found is not None
    assert substitute_term(pattern, found) == instance


@given(terms, ground_terms)
def test_unification_with_a_ground_term_is_matching(pattern: Term, ground: Term) -> None:
    matched, unified = match_term(pattern, ground, {}), unify(pattern, ground, {})
    assert (matched is None) == (unified is None)
    if unified is not None:
        assert resolve_term(pattern, unified) == ground


def test_anything_matches_twice_with_different_values() -> None:
    pair = Function("f", (Function("a"), Function("b")))
    assert match_term(Function("f", (ANYTHING, ANYTHING)), pair, {}) == {}
    assert match_term(Function("f", (Variable("X"), Variable("X"))), pair, {}) is None


@given(ground_terms)
def test_a_term_that_was_hashed_is_still_the_same_value(term: Term) -> None:
    fresh = copy.deepcopy(term)
    assert hash(term) == hash(fresh)
    again = pickle.loads(pickle.dumps(term))
    assert again == term == fresh
    assert hash(again) == hash(term)
    if isinstance(term, Function):
        assert [each.name for each in dataclasses.fields(term)] == ["name", "arguments"]


@given(terms, st.dictionaries(st.sampled_from([Variable(name) for name in "XYZ"]), ground_terms))
def test_a_term_in_which_nothing_is_replaced_stays_the_same_one(
    term: Term, bindings: dict[Variable, Term]
) -> None:
    replaced = substitute_term(term, bindings)
    assert (replaced is term) == (replaced == term)


@given(sums)
def test_a_term_is_ground_if_it_has_no_variable(term: Term) -> None:
    assert is_ground(term) == is_ground(term) == (next(term_variables(term), None) is None)


@given(terms, st.dictionaries(st.sampled_from([Variable(name) for name in "XYZ"]), ground_terms))
def test_an_atom_in_which_nothing_is_replaced_stays_itself(
    term: Term, bindings: dict[Variable, Term]
) -> None:
    atom = Function("p", (term, Number(1)))
    made = substitute_atom(atom, bindings)
    assert (made is atom) == bindings.keys().isdisjoint(term_variables(atom))
    assert is_ground(made) == (set(term_variables(atom)) <= bindings.keys())
