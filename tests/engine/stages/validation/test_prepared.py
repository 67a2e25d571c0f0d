"""Prepared preconditions and effects against substitution, condition by condition."""

from collections.abc import Callable
from typing import Any

from hypothesis import example, given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.condition_solving import bind_parameters, condition_holds
from cellwright.engine.stages.validation.prepared_conditions import comparison_test, value_function
from cellwright.engine.stages.validation.prepared_operators import PreparedOperator
from cellwright.engine.stages.validation.step_changes import Fired
from cellwright.kb.arithmetic import compare_terms, evaluate_term
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    And,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
    goal_parts,
)
from cellwright.kb.model.domain_model import Effect, Operator
from cellwright.kb.terms import (
    Atom,
    Function,
    Number,
    Operation,
    Term,
    Text,
    Variable,
    substitute_atom,
    substitute_term,
)

MANY = settings(max_examples=300, deadline=None)
X, Y, V, W, ANY = map(Variable, ("X", "Y", "V", "W", "_"))
A, B = Function("a"), Function("b")
numbers = st.sampled_from([Number(n) for n in (-(2**31), -3, 0, 1, 2, 2**31 - 1)])
values = st.one_of(st.sampled_from([A, B, Text("a"), Function("f", (A,))]), numbers)
things = st.sampled_from([A, B])
relations = st.sampled_from(["=", "!=", "<", "<=", ">", ">="])
variables = st.sampled_from([X, Y, V, W])
sums = st.recursive(
    st.one_of(variables, numbers),
    lambda part: st.builds(Operation, st.sampled_from("+-**/\\"), part, part),
    max_leaves=5,
)
arguments = st.one_of(
    variables, st.sampled_from([A, Number(1), ANY, Function("f", (X,)), Function("f", (V,))])
)
atoms = st.one_of(
    st.builds(lambda one: Atom("p", (one,)), arguments),
    st.builds(lambda one, other: Atom("level", (one, other)), arguments, arguments),
    st.just(Atom("lit", ())),
)
comparisons = st.builds(Comparison, sums, relations, sums, st.booleans())
tests = st.one_of(st.builds(Literal, atoms), st.builds(Literal, atoms, st.booleans()), comparisons)
parameters = st.lists(
    st.builds(
        Parameter, st.sampled_from([V, W]), st.sampled_from(["thing", "int", "object", "text"])
    ),
    max_size=2,
    unique_by=lambda each: each.variable,
).map(tuple)
parts = st.lists(tests, max_size=3).map(tuple)
quantity: st.SearchStrategy[Condition] = st.builds(  # as comparisons of quantities are read
    lambda one, relation, side: Exists(
        (Parameter(V, "int"),),
        And((Literal(Atom("level", (one, V))), Comparison(V, relation, side, True))),
    ),
    st.sampled_from([X, Y]),
    relations,
    st.sampled_from([Number(1), Operation("+", V, Number(1)), Operation("*", Number(2), V)]),
)
conditions: st.SearchStrategy[Condition] = st.recursive(
    st.one_of(
        tests, st.builds(And, parts), quantity, st.builds(Exists, parameters, st.builds(And, parts))
    ),
    lambda part: st.one_of(
        st.builds(Not, part),
        st.builds(lambda each: And(tuple(each)), st.lists(part, max_size=3)),
        st.builds(lambda each: Or(tuple(each)), st.lists(part, max_size=2)),
        st.builds(Exists, parameters, part),
        st.builds(ForAll, parameters, part),
    ),
    max_leaves=4,
)
moves = st.builds(  # as an increase of a quantity is read
    lambda one, sum_: Effect(
        Atom("level", (one, W)),
        True,
        (Parameter(V, "int"), Parameter(W, "int")),
        And((Literal(Atom("level", (one, V))), Comparison(W, "=", sum_, True))),
    ),
    st.sampled_from([X, Y]),
    st.sampled_from(
        [Operation("+", V, Number(1)), Operation("-", Operation("*", Number(2), V), Y)]
    ),
)
effects = st.one_of(
    moves,
    st.builds(
        Effect, atoms, st.booleans(), parameters, st.one_of(st.just(ALWAYS_TRUE), conditions)
    ),
)
operators = st.builds(
    lambda condition, own: Operator(
        "go",
        (Parameter(X, "object"), Parameter(Y, "object")),
        precondition=condition,
        effects=tuple(own),
    ),
    conditions,
    st.lists(effects, max_size=3),
)
known = st.builds(
    lambda single, double, lit: [
        *(Atom("thing", (each,)) for each in (A, B)),
        *(Atom("p", (each,)) for each in single),
        *(Atom("level", each) for each in double),
        *([Atom("lit", ())] if lit else []),
    ],
    st.lists(values, max_size=3),
    st.lists(st.tuples(values, values), max_size=24),
    st.booleans(),
)


def unmet(
    operator: Operator, facts: CheckerFacts, bindings: dict[Variable, Term]
) -> Condition | None:
    return next(
        (p for p in goal_parts(operator.precondition) if not condition_holds(p, facts, bindings)),
        None,
    )


def fired(operator: Operator, facts: CheckerFacts, bindings: dict[Variable, Term]) -> list[Fired]:
    return [
        (
            substitute_atom(effect.atom, each),
            effect.adds,
            bool(effect.parameters) or effect.condition != ALWAYS_TRUE,
        )
        for effect in operator.effects
        for each in bind_parameters(effect.parameters, effect.condition, facts, bindings)
    ]


def outcome(run: Callable[[], Any]) -> Any:
    """What comes back, or that terms without values were to be put in order."""
    try:
        return run()
    except ValueError:
        return ValueError


@given(operators, known, st.tuples(values, values), st.integers(0, 30))
@MANY
def test_prepared_preconditions_and_effects_agree_with_substitution(
    operator: Operator, atoms: list[Atom], given: tuple[Term, Term], split: int
) -> None:
    facts = CheckerFacts(atoms[split:], CheckerFacts(atoms[:split]))
    prepared, bindings = PreparedOperator(operator), {X: given[0], Y: given[1]}
    one = outcome(lambda: prepared.unmet(facts, given))
    other = outcome(lambda: unmet(operator, facts, bindings))
    assert one is other
    assert outcome(lambda: prepared.fired(facts, given)) == outcome(
        lambda: fired(operator, facts, bindings)
    )


@given(sums, relations, sums, st.booleans(), st.tuples(values, values, values, values))
@example(Operation("+", X, X), "<", Number(0), False, (Number(2**31 - 1),) * 4)
@example(Operation("+", X, X), "<", Number(0), True, (Number(2**31 - 1),) * 4)
@MANY
def test_prepared_sums_have_the_values_of_terms(
    left: Term, relation: str, right: Term, exact: bool, given: tuple[Term, ...]
) -> None:
    places = dict(zip((X, Y, V, W), range(4), strict=True))
    bindings = dict(zip((X, Y, V, W), given, strict=True))
    one, other = (substitute_term(each, bindings) for each in (left, right))
    assert value_function(left, places, exact)(list(given)) == evaluate_term(one, exact)
    test = comparison_test(Comparison(left, relation, right, exact), places)
    assert test(list(given)) == compare_terms(one, relation, other, exact)


def test_conditions_that_ask_for_the_same_look_facts_up_once() -> None:
    class Counted(CheckerFacts):
        asked = 0

        def having(self, name: str, arguments: Any) -> Any:
            self.asked += 1
            return super().having(name, arguments)

    level = Literal(Atom("level", (X, V)))
    more = Comparison(W, "=", Operation("+", V, Number(2)), True)
    changes = (
        Effect(level.atom, False, (Parameter(V, "int"),), level),
        Effect(
            Atom("level", (X, W)),
            True,
            (Parameter(V, "int"), Parameter(W, "int")),
            And((level, more)),
        ),
    )
    facts = Counted([Atom("level", (A, Number(3))), Atom("level", (B, Number(4)))])
    found = PreparedOperator(Operator("go", (Parameter(X, "object"),), ALWAYS_TRUE, changes)).fired(
        facts, [A]
    )
    assert [str(each) for each, _, _ in found] == ["level(a, 3)", "level(a, 5)"]
    assert facts.asked == 1


def test_what_is_asked_of_values_that_were_found_is_looked_up_for_each() -> None:
    chain = And((Literal(Atom("level", (X, V))), Literal(Atom("level", (V, W)))))
    effect = Effect(Atom("p", (W,)), True, (Parameter(V, "int"), Parameter(W, "int")), chain)
    one, two, three, four = map(Number, (1, 2, 3, 4))
    facts = CheckerFacts(
        [Atom("level", each) for each in ((A, one), (A, two), (one, three), (two, four))]
    )
    found = PreparedOperator(
        Operator("go", (Parameter(X, "object"),), ALWAYS_TRUE, (effect,))
    ).fired(facts, [A])
    assert [str(each) for each, _, _ in found] == ["p(3)", "p(4)"]
