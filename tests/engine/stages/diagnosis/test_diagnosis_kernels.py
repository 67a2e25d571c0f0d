"""The kernels of diagnosis, compiled and interpreted, give the same figures to the last bit."""

import importlib
import math
from collections.abc import Iterator
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cellwright.engine.stages.diagnosis.kernels
from cellwright.engine.kernels.cancellation import Poll
from cellwright.engine.model.troubleshooting import Troubleshooting
from cellwright.engine.stages.diagnosis import search_arrays
from cellwright.engine.stages.diagnosis.pair_bounds import RATIOS, no_pairs, pair_bounds
from tests.engine.interpreted import interpreted_package
from tests.engine.stages.diagnosis.fault_cases import each_alone, isolations, troubles
from tests.engine.stages.diagnosis.test_unsure_tests import unsure

Modules = dict[str, ModuleType]
PACKAGE = cellwright.engine.stages.diagnosis.kernels
PLAIN: Modules = interpreted_package(PACKAGE)
IMPORTED: Modules = {name: importlib.import_module(f"{PACKAGE.__name__}.{name}") for name in PLAIN}
EVERY = (
    "likelihoods",
    "ends",
    "repairs",
    "shown",
    "costs",
    "following",
    "losses",
    "known",
    "shifts",
    "widths",
)
BUDGETS = (1, 3, 10_000)


def _beliefs(modules: Modules, problem: Troubleshooting) -> object:
    known = search_arrays.belief_arrays(problem)
    arrays_of = (getattr(known, name) for name in EVERY)
    return modules["belief"].Beliefs(
        *arrays_of, known.situations, 1.0 - problem.certainty, known.before
    )


def _searched(modules: Modules, problem: Troubleshooting) -> Iterator[object]:
    """Values and bounds by branch and bound with small and large budgets."""
    belief, beliefs = modules["belief"], _beliefs(modules, problem)
    trail = belief.Trail(beliefs, search_arrays.prior_weights(problem))
    for budget in BUDGETS:
        table = modules["memo"].Memo(1 << 12, budget, search_arrays.belief_arrays(problem).words)
        yield belief.solve(beliefs, table, trail, 0, math.inf)
        yield table.expansions, table.entries, table.spent, table.full
        for action in range(len(problem.actions)):
            yield belief.tells(beliefs, trail, 0, action)
            yield belief.estimate(beliefs, table, trail, 0, action)
    yield belief.stop(beliefs, trail, 0)


def _ruled(modules: Modules, problem: Troubleshooting) -> Iterator[object]:
    """What rules prefer and cost, and the lookahead over them."""
    rollout, beliefs = modules["rollout"], _beliefs(modules, problem)
    trail = modules["belief"].Trail(beliefs, search_arrays.prior_weights(problem))
    known = search_arrays.belief_arrays(problem)
    width = known.words
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search_arrays, "Groups", lambda _, *rest: rollout.Groups(beliefs, *rest))
        groups = search_arrays.cause_groups(known)
    for rule in rollout.RULES.values():
        yield rollout.greedy(beliefs, groups, trail, 0, rule)
        yield rollout.follow(
            beliefs, groups, modules["memo"].Memo(1 << 12, 0, width), trail, 0, rule
        )
    bases = tuple(modules["memo"].Memo(1 << 12, 0, width) for _ in range(3))
    yield rollout.look_ahead(beliefs, groups, bases, trail, 0, 2, math.inf)
    groups.limit(1, 0.2)
    bases = tuple(modules["memo"].Memo(1 << 12, 0, width) for _ in range(3))
    yield rollout.look_ahead(beliefs, groups, bases, trail, 0, 2, math.inf)


def _bracketed(
    modules: Modules, problem: Troubleshooting, length: int = 1 << 10
) -> Iterator[object]:
    """Bounds, choices and counts of the search between bounds."""
    bracket, known = modules["bracket"], search_arrays.belief_arrays(problem)
    beliefs, pairs = (
        _beliefs(modules, problem),
        pair_bounds(known) if problem.certainty == 1.0 else no_pairs(),
    )
    table = bracket.Brackets(beliefs, RATIOS, pairs.values, pairs.repairs, length, 1 << 8)
    trail = modules["belief"].Trail(beliefs, search_arrays.prior_weights(problem))
    for expansions in (1, 3, 40):
        state = bracket.search(table, trail, math.inf, expansions, 1e-10)
        table = table.grown(2 * table.length, 2 * table.room) if table.full else table
        yield table.low[state], table.high[state], table.choice[state], table.states, table.expanded
    yield bracket.floor_in_pairs(table, trail, 0)


def _tabled(modules: Modules, problem: Troubleshooting) -> list[float]:
    """The values of all states."""
    radix = np.array([len(action.outcomes) + 1 for action in problem.actions], np.int64)
    found = modules["dense"].values(
        _beliefs(modules, problem), search_arrays.prior_weights(problem), radix, Poll()
    )
    return [float(each) for each in found.ravel()]


def _parted(modules: Modules, problem: Troubleshooting) -> Iterator[object]:
    """Values and bounds over sets of causes."""
    partition = modules["partition"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search_arrays, "Partition", partition.Partition)
        sets = search_arrays.cause_set_arrays(problem, search_arrays.belief_arrays(problem))
    assert sets is not None
    causes = sum(1 << cause for cause, prior in enumerate(problem.priors) if prior > 0)
    for budget in BUDGETS:
        table = modules["memo"].Memo(1 << 12, budget, sets.sets + 1)
        yield partition.solve(sets, table, partition.Room(sets, causes, 0), 0, math.inf)
        yield table.expansions, table.entries, table.spent, table.full
        for action in range(len(problem.actions)):
            yield partition.estimate(sets, table, partition.Room(sets, causes, 0), 0, action)


@settings(max_examples=30, deadline=None)
@given(isolations(5) | troubles(3))
def test_beliefs_are_searched_alike(problem: Troubleshooting) -> None:
    assert list(_searched(IMPORTED, problem)) == list(_searched(PLAIN, problem))


@settings(max_examples=30, deadline=None)
@given(isolations(5) | troubles(3))
def test_rules_and_lookahead_are_alike(problem: Troubleshooting) -> None:
    assert list(_ruled(IMPORTED, problem)) == list(_ruled(PLAIN, problem))


@settings(max_examples=20, deadline=None)
@given(unsure(), st.sampled_from((1.0, 0.9)), st.booleans())
def test_bounds_are_brought_together_alike(
    problem: Troubleshooting, certainty: float, again: bool
) -> None:
    first = problem.actions[0]
    more = (first, replace(first, repeats=0), *problem.actions[1:])
    each = (
        (*each_alone(len(problem.causes)), *problem.conclusions)
        if certainty < 1.0
        else problem.conclusions
    )
    asked = replace(problem, certainty=certainty, conclusions=each)
    asked = replace(asked, actions=more, setup=None) if again else asked
    assert list(_bracketed(IMPORTED, asked)) == list(_bracketed(PLAIN, asked))


@settings(max_examples=20, deadline=None)
@given(troubles(3))
def test_tables_of_all_states_are_alike(problem: Troubleshooting) -> None:
    assert _tabled(IMPORTED, problem) == _tabled(PLAIN, problem)


@settings(max_examples=30, deadline=None)
@given(isolations(5))
def test_sets_of_causes_are_searched_alike(problem: Troubleshooting) -> None:
    assert list(_parted(IMPORTED, problem)) == list(_parted(PLAIN, problem))


@pytest.mark.parametrize("modules", [IMPORTED, PLAIN], ids=["imported", "interpreted"])
def test_a_grown_table_knows_what_it_knew(modules: Modules) -> None:
    """The table has a power of two of slots."""
    table = modules["memo"].Memo(4, 7)
    larger = table.grown()
    assert (larger.length, larger.budget, larger.expansions) == (16, 7, 0)
    with pytest.raises(ValueError, match="power of two"):
        modules["memo"].Memo(12, 0)
