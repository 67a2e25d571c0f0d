"""Derived atoms by compiled rules, against rules that are solved again and again until nothing
more follows.
"""

import itertools

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.condition_solving import solve_conditions
from cellwright.engine.stages.validation.rule_derivation import RuleDerivation
from cellwright.kb.model.conditions import BodyPart, Comparison, Literal
from cellwright.kb.model.domain_model import Rule
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Operation,
    Term,
    Variable,
    substitute_atom,
    term_variables,
)

X, Y, Z = map(Variable, "XYZ")
A, B = Function("a"), Function("b")
NUMBERS = (Number(1), Number(2), Number(3))


def box(*inside: Term) -> Function:
    """A compound term."""
    return Function("box", inside)


def true(name: str, *arguments: Term) -> Literal:
    return Literal(Atom(name, arguments))


def false(name: str, *arguments: Term) -> Literal:
    return Literal(Atom(name, arguments), False)


GROUND: tuple[Term, ...] = (A, B, box(A, Number(1)), box(B, Number(2)), *NUMBERS)
CONDITIONS: tuple[BodyPart, ...] = (
    true("fluent", X, Y),
    true("fluent", Y, Z),
    true("fluent", X, X),
    true("fluent", X, ANYTHING),
    true("fluent", box(X, Y), Z),
    true("fluent", Z, box(A, Y)),
    true("fluent", box(ANYTHING, Y), X),
    true("fluent", A, X),
    true("static", X, Y),
    true("static", Y, X),
    true("static", box(X, Y), ANYTHING),
    false("static", X, Y),
    Comparison(X, "!=", Y),
    Comparison(Y, "=", Operation("+", X, Number(1))),
    Comparison(X, "=", box(Y, Z)),
)
LOWER: tuple[BodyPart, ...] = (true("low", X), true("low", Y), true("low", box(X, Number(1))))
UPPER: tuple[BodyPart, ...] = (*LOWER, true("high", X, Y), true("high", Y, Z))
DENIED: tuple[BodyPart, ...] = (
    false("fluent", X, Y),
    false("fluent", Y, ANYTHING),
    false("fluent", X, box(ANYTHING, Y)),
)
atoms = st.sets(st.sampled_from(list(itertools.product(GROUND, repeat=2))), max_size=9)


@st.composite
def rules(
    draw: st.DrawFn, head: Atom, more: tuple[BodyPart, ...], denied: tuple[BodyPart, ...]
) -> Rule:
    """A rule whose variables all occur in a positive condition, in any order of its conditions."""
    body = draw(
        st.lists(st.sampled_from((*CONDITIONS, *more)), min_size=1, max_size=3, unique=True)
    )
    body += draw(st.lists(st.sampled_from(denied), max_size=1))
    bound = {
        v for p in body if isinstance(p, Literal) and p.positive for v in term_variables(p.atom)
    }
    used = {v for p in (Literal(head), *body) for v in _named(p)} - {ANYTHING}
    body += [true("fluent", each, ANYTHING) for each in sorted(used - bound, key=str)]
    return Rule(head, tuple(draw(st.permutations(body))))


def _named(part: BodyPart) -> set[Variable]:
    if isinstance(part, Comparison):
        return {*term_variables(part.left), *term_variables(part.right)}
    return {*term_variables(part.atom)} if isinstance(part, Literal) else set()


STRATA = st.tuples(
    st.lists(rules(Atom("low", (X,)), LOWER, DENIED), min_size=1, max_size=2),
    st.lists(
        rules(Atom("high", (X, box(A, Y))), UPPER, (*DENIED, false("low", Y)))
        | rules(Atom("high", (Y, X)), UPPER, (*DENIED, false("low", Y))),
        min_size=1,
        max_size=3,
    ),
)


def named(name: str, chosen: set[tuple[Term, Term]]) -> list[Atom]:
    return [Atom(name, each) for each in sorted(chosen, key=str)]


def plain(strata: tuple[list[Rule], ...], facts: CheckerFacts) -> set[Atom]:
    """All derived atoms, small enough to be reached in a few rounds."""
    found: set[Atom] = set()
    for each in strata:
        judge = CheckerFacts(
            (atom for name in ("fluent", "low") for atom in facts.extent(name)), facts.below
        )
        more = True
        while more:
            heads = [
                substitute_atom(r.head, b)
                for r in each
                for b in solve_conditions(r.body, facts, {}, judge)
            ]
            more = any([facts.add(head) for head in heads])
            found |= set(heads)
    return found


def _depth(strata: tuple[list[Rule], ...]) -> bool:
    """Whether heads can grow without end: a compound head over a derived atom of its own kind."""
    return any(
        any(isinstance(a, Function) and a.arguments for a in rule.head.arguments)
        and any(isinstance(p, Literal) and p.atom.name == rule.head.name for p in rule.body)
        for rule in strata[1]
    )


@given(STRATA, atoms, st.lists(atoms, min_size=1, max_size=3))
@settings(max_examples=150, deadline=None)
def test_each_state_gets_what_follows_in_it_whatever_states_came_before(
    strata: tuple[list[Rule], list[Rule]],
    static: set[tuple[Term, Term]],
    states: list[set[tuple[Term, Term]]],
) -> None:
    if _depth(strata):
        return
    statics = CheckerFacts(named("static", static))
    derivation = RuleDerivation(strata, statics, {"fluent", "low", "high"})
    for state in states:
        facts, other = (CheckerFacts(named("fluent", state), statics) for _ in range(2))
        derivation.add(facts)
        found = {*facts.extent("low"), *facts.extent("high")}
        assert found == plain(strata, other)


LINKED = (
    Rule(Atom("path", (X, Y)), (true("link", X, Y),)),
    Rule(Atom("path", (X, Z)), (true("path", X, Y), true("link", Y, Z))),
)


@given(
    st.lists(
        st.sets(st.sampled_from(list(itertools.permutations(range(6), 2)))), min_size=1, max_size=3
    )
)
@settings(max_examples=50, deadline=None)
def test_paths_are_found_along_all_links_of_a_state(states: list[set[tuple[int, int]]]) -> None:
    derivation = RuleDerivation([LINKED], CheckerFacts(), {"link", "path"})
    for links in states:
        facts = CheckerFacts(
            [Atom("link", tuple(map(Number, each))) for each in sorted(links)], CheckerFacts()
        )
        derivation.add(facts)
        reached = set(links)
        while more := {(a, c) for a, b in reached for d, c in links if b == d} - reached:
            reached |= more
        assert {*facts.extent("path")} == {
            Atom("path", tuple(map(Number, each))) for each in reached
        }
