"""The checker's facts against a plain set of them, for small predicates and for large ones,
which have indexes.
"""

import itertools
import random
import weakref

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.validation.checker_facts import (
    MAX_SINGLE_LOOKUPS,
    MIN_INDEXED_ATOMS,
    WORTH_READING,
    CheckerFacts,
    CompletedFacts,
    EvaluatedFacts,
)
from cellwright.engine.stages.validation.condition_solving import solve_conditions
from cellwright.kb.model.conditions import Literal
from cellwright.kb.terms import Atom, Function, Variable, match_term

X, Y = Variable("X"), Variable("Y")
THINGS = tuple(Function(f"t{number}") for number in range(9))
PAIRS = tuple(Function("r", pair) for pair in itertools.product(THINGS, repeat=2))
PATTERNS = (
    Function("r", (X, Y)),
    Function("r", (X, X)),
    Function("r", (THINGS[0], Y)),
    Function("r", (X, THINGS[1])),
    Function("r", (THINGS[2], THINGS[3])),
)
atoms = st.sets(st.sampled_from(PAIRS), max_size=4 * MIN_INDEXED_ATOMS)


def looked_up(facts: CheckerFacts, pattern: Atom) -> set[Atom]:
    return {each for each in facts.matching(pattern) if match_term(pattern, each, {}) is not None}


def plain(told: set[Atom], pattern: Atom) -> set[Atom]:
    return {each for each in told if match_term(pattern, each, {}) is not None}


@given(atoms, atoms, atoms, atoms)
@settings(max_examples=100, deadline=None)
def test_atoms_are_found_by_pattern_before_and_after_changes(
    below: set[Atom], above: set[Atom], ends: set[Atom], adds: set[Atom]
) -> None:
    layer = CheckerFacts(below)
    facts = CheckerFacts(above - below, layer)
    for pattern in PATTERNS:
        assert looked_up(facts, pattern) == plain(above | below, pattern)
    later = facts.after(ends, adds - below)
    for pattern in PATTERNS:
        assert looked_up(later, pattern) == plain(
            ((above - below) - ends) | adds - below | below, pattern
        )
        assert looked_up(facts, pattern) == plain(above | below, pattern)


@given(atoms, st.lists(st.sampled_from(PAIRS), max_size=10))
@settings(max_examples=100, deadline=None)
def test_what_is_added_later_is_found_too(told: set[Atom], more: list[Atom]) -> None:
    facts = CheckerFacts(told)
    for atom in more:
        looked_up(facts, PATTERNS[2])
        assert facts.add(atom) == (atom not in told)
        told = told | {atom}
        for pattern in PATTERNS:
            assert looked_up(facts, pattern) == plain(told, pattern)


def test_of_a_large_predicate_only_those_that_share_an_argument_are_looked_at() -> None:
    facts = CheckerFacts(PAIRS)
    assert len(PAIRS) > MIN_INDEXED_ATOMS
    assert sorted(map(str, facts.matching(PATTERNS[2]))) == sorted(
        f"r(t0, {each})" for each in THINGS
    )
    assert len(list(facts.matching(PATTERNS[0]))) == len(PAIRS)


@pytest.mark.parametrize("seed", range(20))
def test_what_is_denied_of_any_value_is_false_of_all(seed: int) -> None:
    told = random.Random(seed).sample(PAIRS, 12)
    found = list(
        solve_conditions(
            (Literal(Function("r", (X, Variable("_"))), False),), CheckerFacts(told), {X: THINGS[0]}
        )
    )
    assert bool(found) == all(each.arguments[0] != THINGS[0] for each in told)


@pytest.mark.parametrize("size", [10, 2 * WORTH_READING * MAX_SINGLE_LOOKUPS])
def test_a_large_predicate_is_read_only_if_much_of_it_is_asked_for(size: int) -> None:
    rows = {Function("row", (Function(f"n{n}"),)): None for n in range(size)}
    readings = list[str]()

    def read(name: str) -> dict[Atom, None]:
        readings.append(name)
        return rows

    facts = EvaluatedFacts(read, rows.__contains__, lambda _name, count: size > count)
    asked = [Function("row", (Function(f"n{n}"),)) for n in range(MAX_SINGLE_LOOKUPS + 20)]
    assert [atom in facts for atom in asked] == [atom in rows for atom in asked]
    assert readings == (["row"] if size == 10 else [])
    assert all(atom in facts for atom in rows)
    assert readings == ["row"]


def test_a_state_that_nobody_keeps_is_gone_at_once() -> None:
    def complete(facts: CompletedFacts, name: str) -> None:
        facts.settle({name})

    facts = CompletedFacts(PAIRS, CheckerFacts(), ["r"], complete)
    assert PAIRS[0] in facts
    gone = weakref.ref(facts)
    del facts
    assert gone() is None  # without a search for cycles of references
