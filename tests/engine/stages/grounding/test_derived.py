"""Supports of derived atoms against the truth of the atoms in every state."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.stages.grounding.derived_atoms import Rules, supports_of

FLUENTS = range(4)
DERIVED = range(100, 104)  # the first two may depend on one another, and so may the last two

Body = tuple[int, ...]


def bodies(head: int) -> st.SearchStrategy[list[Body]]:
    """Bodies of rules of a derived atom, which need those of the other pair to be true or false."""
    layer = (head - 100) // 2
    own = [100 + 2 * layer, 101 + 2 * layer]
    fluents = [each for fluent in FLUENTS for each in (fluent, ~fluent)]
    earlier = [each for atom in DERIVED[: 2 * layer] for each in (atom, ~atom)]
    body = st.lists(st.sampled_from([*fluents, *own, *earlier]), max_size=3).map(tuple)
    return st.lists(body, max_size=3)


rules = st.fixed_dictionaries({head: bodies(head) for head in DERIVED})


def true_atoms(known: Rules, fluents: frozenset[int]) -> set[int]:
    """The fluents and derived atoms that are true, pair by pair and rule by rule."""
    true = set(fluents)
    for pair in (DERIVED[:2], DERIVED[2:]):
        before = -1
        while before != len(true):
            before = len(true)
            true |= {head for head in pair for body in known[head] if holds(body, true)}
    return true


def holds(condition: frozenset[int] | Body, true: set[int]) -> bool:
    return all(each in true if each >= 0 else ~each not in true for each in condition)


@given(rules)
def test_a_derived_atom_is_true_where_one_of_its_supports_is_and_false_where_one_of_its_negation_is(
    known: Rules,
) -> None:
    supports = supports_of(list(DERIVED), known, DERIVED)
    assert not supports.stay
    for size in range(len(FLUENTS) + 1):
        for chosen in itertools.combinations(FLUENTS, size):
            true = true_atoms(known, frozenset(chosen))
            for signed in (each for atom in DERIVED for each in (atom, ~atom)):
                found = any(holds(support, set(chosen)) for support in supports.of(signed))
                assert found == holds((signed,), true)


@given(rules)
def test_no_support_contains_another_one_or_its_own_opposite(known: Rules) -> None:
    supports = supports_of(list(DERIVED), known, DERIVED)
    for signed in (each for atom in DERIVED for each in (atom, ~atom)):
        found = supports.of(signed)
        assert not any(one < other for one in found for other in found)
        assert not any(~each in support for support in found for each in support)
