"""The checker's own reading of bodies and terms agrees with clingo; of conditions, with a plain
evaluation.
"""

import itertools
import random
from collections.abc import Sequence

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.condition_solving import condition_holds, solve_conditions
from cellwright.kb.arithmetic import evaluate_term
from cellwright.kb.asp import Grounder
from cellwright.kb.model.conditions import (
    Aggregate,
    And,
    BodyPart,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
)
from cellwright.kb.terms import Atom, Function, Number, Operation, Term, Text, Variable

MANY = settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
X, Y, Z = Variable("X"), Variable("Y"), Variable("Z")
A, B = Function("a"), Function("b")
VALUES: tuple[Term, ...] = (
    *map(Number, (-7, -2, -1, 0, 1, 2, 3, 7)),
    A,
    B,
    Text("a"),
    Text("b"),
    Function("f", (A,)),
    Function("f", (Number(2),)),
    Function("g", (A,)),
    Function("f", (A, B)),
    Function("a", (Function("f", (B,)),)),
)
RELATIONS = ("=", "!=", "<", "<=", ">", ">=")
values = st.sampled_from(VALUES)
numbers = st.integers(-9, 9).map(Number)
arithmetic = st.recursive(
    numbers, lambda part: st.builds(Operation, st.sampled_from("+-*/\\"), part, part), max_leaves=4
)


@given(arithmetic)
@MANY
def test_arithmetic_is_that_of_clingo(term: Term) -> None:
    grounder = Grounder()
    grounder.ground(f"is({term}).")
    found = evaluate_term(term)
    assert grounder.atoms("is", 1) == ([] if found is None else [(found,)])


@given(values, st.sampled_from(RELATIONS), values)
@MANY
def test_terms_are_ordered_as_by_clingo(left: Term, relation: str, right: Term) -> None:
    grounder = Grounder()
    grounder.ground(f"yes :- {left} {relation} {right}.")
    assert condition_holds(Comparison(left, relation, right), CheckerFacts([]), {}) == bool(
        grounder.atoms("yes", 0)
    )


def test_what_is_no_number_has_no_value_in_arithmetic() -> None:
    assert evaluate_term(Operation("+", A, Number(1))) is None
    assert evaluate_term(Operation("*", Number(1), Text("a"))) is None
    assert evaluate_term(Operation("/", Number(1), Number(0))) is None
    assert evaluate_term(Operation("\\", Number(1), Number(0))) is None
    assert evaluate_term(A) == A


sides = st.one_of(
    st.sampled_from([X, Y, Z]),
    values,
    st.builds(
        Operation,
        st.sampled_from("+-*/\\"),
        st.sampled_from([X, Y]),
        st.sampled_from([X, Number(2)]),
    ),
)
patterns = st.sampled_from(
    [X, Y, Z, A, Number(1), Function("f", (X,)), Function("f", (Y, Z)), Variable("_")]
)
positive = st.one_of(
    st.builds(lambda one: Literal(Function("p", (one,))), patterns),
    st.builds(lambda one, other: Literal(Function("r", (one, other))), patterns, patterns),
)
tests = st.one_of(
    st.builds(Comparison, sides, st.sampled_from(RELATIONS), sides),
    st.builds(lambda one, other: Literal(Function("r", (one, other)), False), patterns, patterns),
)
facts = st.lists(
    values.map(lambda one: Function("p", (one,)))
    | st.builds(lambda *both: Function("r", both), values, values),
    max_size=8,
)


given_z = st.sampled_from(
    [
        Comparison(Z, "=", X),
        Comparison(Operation("+", X, Number(1)), "=", Z),
        Literal(Function("p", (Z,))),
    ]
)


@given(st.lists(positive, max_size=2), given_z, st.lists(tests, max_size=2), facts, st.randoms())
@MANY
def test_bodies_have_the_solutions_of_clingo(
    more: list[BodyPart],
    z: BodyPart,
    others: list[BodyPart],
    given: list[Atom],
    chance: random.Random,
) -> None:
    body = [Literal(Function("p", (X,))), Literal(Function("p", (Y,))), z, *more, *others]
    chance.shuffle(body)
    told = [*given, Function("r", (A, A)), Function("p", (B,)), Function("p", (Number(1),))]
    grounder = Grounder()
    grounder.ground(
        "\n".join(f"{fact}." for fact in told) + f"\nout(X, Y, Z) :- {', '.join(map(str, body))}."
    )
    found = {
        (each[X], each[Y], each[Z])
        for each in solve_conditions(tuple(body), CheckerFacts(told), {})
    }
    assert found == set(grounder.atoms("out", 3))


def test_what_is_known_of_a_variable_is_kept() -> None:
    found = CheckerFacts([Function("p", (A,)), Function("p", (B,))])
    assert list(solve_conditions((Literal(Function("p", (X,))),), found, {X: A})) == [{X: A}]
    assert list(solve_conditions((), found, {X: A})) == [{X: A}]


def test_an_equation_binds_either_side_even_inside_a_term() -> None:
    pattern = Function("f", (X,))
    for left, right in ((pattern, Function("f", (A,))), (Function("f", (A,)), pattern)):
        assert list(solve_conditions((Comparison(left, "=", right),), CheckerFacts([]), {})) == [
            {X: A}
        ]
    assert (
        list(
            solve_conditions((Comparison(pattern, "=", Function("g", (A,))),), CheckerFacts([]), {})
        )
        == []
    )


def test_aggregates_are_left_to_clingo() -> None:
    with pytest.raises(ValueError, match="evaluated by clingo"):
        list(solve_conditions((Aggregate("#count { X : p(X) } < 3"),), CheckerFacts([]), {}))
    with pytest.raises(ValueError, match="evaluated by clingo"):
        condition_holds(Aggregate("#count { X : p(X) } < 3"), CheckerFacts([]), {})


# Facts over facts that never change.


def test_facts_lie_over_those_below() -> None:
    below = CheckerFacts([Function("p", (A,))])
    above = CheckerFacts([Function("p", (B,)), Function("q")], below)
    assert sorted(map(str, above.named("p"))) == ["p(a)", "p(b)"]
    assert Function("p", (A,)) in above
    assert Function("q") not in below
    assert not above.add(Function("p", (A,)))
    assert above.add(Function("r"))
    assert not above.add(Function("r"))
    assert list(above.named("r")) == [Function("r")]


@pytest.mark.parametrize(
    ("term", "type_", "is_one"),
    [
        (Number(1), "int", True),
        (Number(1), "time", True),
        (A, "int", False),
        (Text("a"), "text", True),
        (A, "text", False),
        (A, "thing", True),
        (B, "thing", False),
        (B, "object", True),
    ],
)
def test_types_are_facts_or_built_in(term: Term, type_: str, is_one: bool) -> None:
    assert CheckerFacts([Function("thing", (A,))]).has_type(term, type_) == is_one


# Conditions.

THINGS, PLACES = (A, B), (Function("c"), A)
ONE_X, BOTH = (Parameter(X, "thing"),), (Parameter(X, "thing"), Parameter(Y, "place"))
TYPES = [Function("thing", (each,)) for each in THINGS] + [
    Function("place", (each,)) for each in PLACES
]
POSSIBLE = [Function("r", pair) for pair in itertools.product((A, B, Function("c")), repeat=2)][:6]


def literals(terms: Sequence[Term]) -> st.SearchStrategy[Condition]:
    chosen = st.sampled_from(list(terms))
    plain = st.builds(
        lambda x, y, sign: Literal(Function("r", (x, y)), sign), chosen, chosen, st.booleans()
    )
    return plain | st.builds(Comparison, chosen, st.sampled_from(("=", "!=")), chosen)


def grown(part: st.SearchStrategy[Condition]) -> st.SearchStrategy[Condition]:
    several = st.lists(part, max_size=2).map(tuple)
    return st.one_of(st.builds(And, several), st.builds(Or, several), st.builds(Not, part))


inner = literals((X, Y, A)) | grown(literals((X, Y, A)))
quantified = st.one_of(
    st.builds(Exists, st.just(BOTH), inner),
    st.builds(ForAll, st.just(BOTH), inner),
    st.builds(Exists, st.just(ONE_X), literals((X, A, B))),
    st.builds(ForAll, st.just(ONE_X), literals((X, A, B))),
)
conditions = st.one_of(
    literals(THINGS), quantified, grown(quantified), grown(grown(literals(THINGS) | quantified))
)


def plainly(condition: Condition, state: frozenset[Atom], bindings: dict[Variable, Term]) -> bool:
    """Whether a condition is true, by its definition: all values of all types are tried."""

    def value(term: Term) -> Term:
        return bindings.get(term, term) if isinstance(term, Variable) else term

    match condition:
        case Literal(atom, positive):
            return (Function(atom.name, tuple(map(value, atom.arguments))) in state) == positive
        case Comparison(left, relation, right):
            return (value(left) == value(right)) == (relation == "=")
        case And(parts):
            return all([plainly(part, state, bindings) for part in parts])
        case Or(parts):
            return any([plainly(part, state, bindings) for part in parts])
        case Not(part):
            return not plainly(part, state, bindings)
        case Exists(parameters, part) | ForAll(parameters, part):
            ranges = [THINGS if each.type == "thing" else PLACES for each in parameters]
            tried = [
                plainly(
                    part,
                    state,
                    bindings | dict(zip((p.variable for p in parameters), each, strict=True)),
                )
                for each in itertools.product(*ranges)
            ]
            return any(tried) if isinstance(condition, Exists) else all(tried)
    raise AssertionError(condition)


@given(conditions, st.sets(st.sampled_from(POSSIBLE)))
@MANY
def test_conditions_mean_what_they_say(condition: Condition, state: set[Atom]) -> None:
    found = CheckerFacts(state, CheckerFacts(TYPES))
    assert condition_holds(condition, found, {}) == plainly(condition, frozenset(state), {})


@given(conditions, st.sets(st.sampled_from(POSSIBLE)), st.sets(st.sampled_from(POSSIBLE)))
@MANY
def test_what_holds_between_two_states_holds_in_all_between_them(
    condition: Condition, certain: set[Atom], more: set[Atom]
) -> None:
    lower, upper = (
        CheckerFacts(certain, CheckerFacts(TYPES)),
        CheckerFacts(certain | more, CheckerFacts(TYPES)),
    )
    open_ = sorted(more - certain, key=str)
    states = [
        certain | set(chosen)
        for size in range(len(open_) + 1)
        for chosen in itertools.combinations(open_, size)
    ]
    true = [plainly(condition, frozenset(state), {}) for state in states]
    if condition_holds(condition, lower, {}, upper):
        assert all(true)
    if isinstance(condition, Literal):
        assert condition_holds(condition, lower, {}, upper) == all(true)
