"""What follows by a rule from new atoms, and which predicates are derived."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.stages.validation.atom_tables import AtomTables
from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.condition_joins import make_joins
from cellwright.engine.stages.validation.condition_solving import (
    order_body,
    solve_conditions,
    solve_in_order,
)
from cellwright.engine.stages.validation.rule_derivation import RuleDerivation
from cellwright.kb.model.conditions import Body, Comparison, Literal
from cellwright.kb.model.domain_model import Rule
from cellwright.kb.terms import Atom, Function, Variable

NAMES = ("a", "b", "c")
X, Y, Z = map(Variable, "XYZ")


def p(one: Variable, other: Variable) -> Literal:
    return Literal(Atom("p", (one, other)))


PATH: Body = (p(X, Y), p(Y, Z), Comparison(X, "!=", Z))
RULE = Rule(Atom("q", (X, Z)), PATH)
pairs = st.sets(st.sampled_from(list(itertools.product(NAMES, repeat=2))))


def atoms(chosen: set[tuple[str, str]]) -> list[Atom]:
    return [Atom("p", tuple(map(Function, each))) for each in sorted(chosen)]


@given(pairs, pairs)
def test_an_instance_with_new_conditions_is_found_once(
    old: set[tuple[str, str]], new: set[tuple[str, str]]
) -> None:
    fresh = atoms(new - old)
    facts = CheckerFacts([*atoms(old), *fresh])
    tables = AtomTables(CheckerFacts(), {"p", "q"})
    for atom in atoms(old):
        tables.told(atom)
    numbers = [number for atom in fresh if (number := tables.told(atom)) is not None]
    rows = [tables.rows[number][1] for number in numbers]
    found = [
        (
            *map(str, tables.atom(made.needs[0]).arguments),
            str(tables.atom(made.needs[1]).arguments[1]),
        )
        for each in make_joins(RULE, tables)
        for made in each.instances(rows, numbers)
    ]
    known = {
        tuple(str(b[each]) for each in (X, Y, Z))
        for b in solve_conditions(PATH, CheckerFacts(atoms(old)), {})
    }
    every = {tuple(str(b[each]) for each in (X, Y, Z)) for b in solve_conditions(PATH, facts, {})}
    assert len(found) == len(set(found))
    assert set(found) == every - known


@given(pairs, st.permutations(PATH), st.sampled_from([None, *NAMES]))
def test_an_order_decided_once_finds_the_same(
    chosen: set[tuple[str, str]], body: list[Literal | Comparison], given_x: str | None
) -> None:
    facts = CheckerFacts(atoms(chosen))
    bindings = {} if given_x is None else {X: Function(given_x)}
    found = [
        tuple(b[each] for each in (X, Y, Z))
        for b in solve_in_order(order_body(tuple(body), bindings), facts, bindings)
    ]
    plain = [
        tuple(b[each] for each in (X, Y, Z)) for b in solve_conditions(tuple(body), facts, bindings)
    ]
    assert sorted(found, key=str) == sorted(plain, key=str)


def test_only_what_is_asked_for_is_derived_and_the_rest_later() -> None:
    below = Rule(Atom("d", (X,)), (Literal(Atom("p", (X, X))),))
    above = Rule(Atom("e", (X,)), (Literal(Atom("d", (X,))),))
    derivation = RuleDerivation([[below], [above]], CheckerFacts(), {"p", "d", "e"})
    state = CheckerFacts(atoms({("a", "a")}), CheckerFacts())
    derivation.add(state, {"d"})
    assert [list(state.named(name)) for name in ("d", "e")] == [[Atom("d", (Function("a"),))], []]
    derivation.add(state, {"e"})
    assert list(state.named("e")) == [Atom("e", (Function("a"),))]
