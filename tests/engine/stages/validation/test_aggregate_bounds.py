"""Aggregates of a set of which only bounds are known, against the aggregates of every set
between them.
"""

import itertools
import operator
from collections.abc import Callable, Iterator, Set

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.validation.aggregate_values import Tuple, can_test, fitting_bindings
from cellwright.kb.arithmetic import order_key
from cellwright.kb.model.conditions import StateAggregate
from cellwright.kb.terms import Function, Number, Term, Variable

N, M = Variable("N"), Variable("M")
VALUES: tuple[Term, ...] = (*map(Number, range(-2, 4)), Function("bolt"), Function("nut"))
COMPARED: dict[str, Callable[[object, object], bool]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
tuples = st.tuples(st.sampled_from(VALUES), st.sampled_from(VALUES[:3])) | st.sampled_from(
    [(), (VALUES[1],)]
)
sets = st.sets(tuples, max_size=4)
functions = st.sampled_from(["count", "sum", "min", "max"])
guards = st.lists(
    st.tuples(st.sampled_from(list(COMPARED)), st.sampled_from(VALUES)), min_size=1, max_size=2
).map(tuple)
HUNDREDS = settings(max_examples=400, deadline=None)


def value(function: str, own: Set[Tuple]) -> tuple[object, ...]:
    """The sort key of the value of one set; the empty set's least is behind all terms, its
    greatest before them.
    """
    firsts = [each[0] for each in own if each]
    keys = [order_key(each) for each in firsts if each is not None]
    if function == "count":
        return (0, len(own))
    if function == "sum":
        return (0, sum(each.value for each in firsts if isinstance(each, Number)))
    return min(keys, default=(9,)) if function == "min" else max(keys, default=(-1,))


def plainly(aggregate: StateAggregate, own: Set[Tuple]) -> bool:
    found = value(aggregate.function, own)
    told = all(COMPARED[relation](found, order_key(term)) for relation, term in aggregate.guards)
    return told is aggregate.positive


def between(certain: Set[Tuple], more: Set[Tuple]) -> Iterator[Set[Tuple]]:
    for count in range(len(more) + 1):
        for some in itertools.combinations(more, count):
            yield {*certain, *some}


def is_true(aggregate: StateAggregate, one: Set[Tuple], other: Set[Tuple]) -> bool:
    return bool(list(fitting_bindings(aggregate, {}, one, other)))


def has_greatest_of(function: str, own: Set[Tuple]) -> bool:
    """Whether each tuple has a first term, as every aggregate of terms must."""
    return function not in ("min", "max") or all(own)


@given(functions, guards, st.booleans(), sets, sets)
@HUNDREDS
def test_certain_means_every_set_between_and_possible_misses_none(
    function: str,
    guarded: tuple[tuple[str, Term], ...],
    positive: bool,
    certain: set[Tuple],
    more: set[Tuple],
) -> None:
    aggregate = StateAggregate(function, (), guarded, (), positive)
    possible = certain | more
    if not has_greatest_of(function, possible):
        return
    plain = [plainly(aggregate, own) for own in between(certain, more)]
    if is_true(aggregate, certain, possible):
        assert all(plain)
    if possible != certain and not is_true(aggregate, possible, certain):
        assert not any(plain)
    assert is_true(aggregate, certain, certain) == plainly(aggregate, certain)
    if len(guarded) == 1 and guarded[0][0] not in ("=", "!="):
        assert is_true(aggregate, certain, possible) == all(plain)
        assert possible == certain or is_true(aggregate, possible, certain) == any(plain)


@given(functions, sets, sets, st.sampled_from([(), ((">", Number(0)),), (("!=", Number(1)),)]))
@HUNDREDS
def test_a_variable_takes_the_value_of_the_set_if_it_is_sure_and_each_that_is_possible(
    function: str, certain: set[Tuple], more: set[Tuple], others: tuple[tuple[str, Term], ...]
) -> None:
    possible = certain | more
    if not has_greatest_of(function, possible):
        return
    taking = StateAggregate(function, (), (("=", N), *others), (N,))

    def values(one: Set[Tuple], other: Set[Tuple]) -> set[Term]:
        return {found[N] for found in fitting_bindings(taking, {}, one, other)}

    def plain(own: Set[Tuple]) -> set[Term]:
        tests = [(term, StateAggregate(function, (), (("=", term), *others), ())) for term in terms]
        return {term for term, each in tests if plainly(each, own)}

    terms = {*map(Number, range(-9, 14)), *VALUES}
    every = [plain(own) for own in between(certain, more)]
    assert values(certain, certain) == plain(certain)
    assert values(certain, possible) <= set.intersection(*every)
    assert possible == certain or values(possible, certain) >= set.union(*every)


def test_an_aggregate_is_tested_when_its_outer_variables_have_values_but_for_the_one_that_it_gives() -> (
    None
):
    giving = StateAggregate("count", (), (("=", N),), (N, M))
    assert not can_test(giving, {})
    assert can_test(giving, {M: VALUES[0]})
    denied = StateAggregate("count", (), (("=", N),), (N, M), positive=False)
    assert not can_test(denied, {M: VALUES[0]})
    assert can_test(denied, {M: VALUES[0], N: VALUES[1]})
