"""The searches by themselves: which one a problem gets, limits, budgets, interruptions, rules
and their tables.
"""

import math

import pytest
from hypothesis import given, settings

from cellwright.engine.kernels.cancellation import Interrupted, Poll, never
from cellwright.engine.model.troubleshooting import (
    Action,
    Conclusion,
    Setup,
    Troubleshooting,
    expected_cost,
)
from cellwright.engine.stages.diagnosis import action_selection, search_arrays
from cellwright.engine.stages.diagnosis.action_selection import (
    BASE_RULES,
    ActionSelector,
    BranchAndBound,
    Searcher,
    ValueTable,
)
from cellwright.engine.stages.diagnosis.kernels.memo import Memo
from tests.engine.stages.diagnosis.fault_cases import (
    brute_force,
    certain,
    each_alone,
    isolations,
    names,
    troubles,
    uncertain,
)

SOME = settings(max_examples=40, deadline=None)
ENOUGH = 100_000
LOOK, LISTEN = certain("look", 1.0, (0, 1)), certain("listen", 2.0, (1, 0))
GUESS = uncertain("guess", 1.0, (0.5, 0.25))


def searcher(
    problem: Troubleshooting, expansions: int, interrupted: Interrupted = never
) -> Searcher:
    return action_selection.make_searcher(
        problem, search_arrays.belief_arrays(problem), expansions, Poll(interrupted)
    )


def partitioned(problem: Troubleshooting) -> bool:
    return search_arrays.cause_set_arrays(problem, search_arrays.belief_arrays(problem)) is not None


SIGNATURES = ("00000", "01001", "00110", "10011", "11000", "11110")


def two_causes(
    *actions: Action, wrong: float = math.inf, setup: Setup | None = None
) -> Troubleshooting:
    return Troubleshooting(names(2), (0.5, 0.5), actions, each_alone(2, wrong), setup)


def six_causes() -> Troubleshooting:
    tests = (
        certain(f"t{test}", 1.0, tuple(int(each[test]) for each in SIGNATURES)) for test in range(5)
    )
    return Troubleshooting(
        names(6), (0.70, 0.01, 0.02, 0.10, 0.05, 0.12), tuple(tests), each_alone(6)
    )


# Which search a problem gets.


def test_sets_of_causes_are_searched_if_outcomes_are_certain_and_conclusions_sure() -> None:
    assert partitioned(two_causes(LOOK))
    assert not partitioned(two_causes(LOOK, wrong=5.0))
    assert not partitioned(two_causes(LOOK, GUESS))
    found = searcher(two_causes(LOOK), ENOUGH)
    assert isinstance(found, BranchAndBound)
    assert found.partition is not None


TWO_PLACES = Setup(((0.0, 1.0), (1.0, 0.0)), ((0, 1), (0, 1)))


@pytest.mark.parametrize(
    ("problem", "expansions", "tabled"),
    [
        (two_causes(GUESS), ENOUGH, True),
        (two_causes(GUESS, LOOK), ENOUGH, True),  # half of the outcomes are uncertain
        (two_causes(GUESS, LOOK, LISTEN), ENOUGH, False),
        (two_causes(LOOK), ENOUGH, False),
        (two_causes(LOOK, wrong=5.0), ENOUGH, False),
        (two_causes(GUESS, LOOK), 2, True),  # nine states cost as much as two expansions
        (two_causes(GUESS, LOOK), 1, False),
        (two_causes(GUESS, LOOK, setup=TWO_PLACES), 3, True),  # twice as many
        (two_causes(GUESS, LOOK, setup=TWO_PLACES), 2, False),
    ],
)
def test_all_states_are_tabled_if_many_outcomes_are_uncertain_and_states_are_few(
    problem: Troubleshooting, expansions: int, tabled: bool
) -> None:
    assert isinstance(searcher(problem, expansions), ValueTable) == tabled


def test_a_table_has_at_most_so_many_states(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(action_selection, "MAX_TABLE_STATES", 9)
    assert isinstance(searcher(two_causes(GUESS, LOOK), ENOUGH), ValueTable)
    monkeypatch.setattr(action_selection, "MAX_TABLE_STATES", 8)
    assert not isinstance(searcher(two_causes(GUESS, LOOK), ENOUGH), ValueTable)


# Limits, budgets and interruptions.


@given(isolations(5) | troubles(3))
@SOME
def test_a_value_below_the_limit_is_exact_and_any_other_is_a_bound(
    problem: Troubleshooting,
) -> None:
    optimum, weights = brute_force(problem), search_arrays.prior_weights(problem)

    def fresh() -> list[Searcher]:
        known = search_arrays.belief_arrays(problem)
        kinds: list[Searcher] = [searcher(problem, ENOUGH), BranchAndBound(known, None)]
        return [*kinds, ValueTable(known, problem)] if len(problem.actions) <= 4 else kinds

    for search in fresh():
        value, proved = search.value(weights, 0, 1.01 * optimum + 0.01, ENOUGH)
        assert (value, proved) == (pytest.approx(optimum), True)
    for search in fresh():
        bound, proved = search.value(weights, 0, 0.9 * optimum, ENOUGH)
        assert bound <= optimum + 1e-9
        assert not proved


def searched(expansions: int = ENOUGH, interrupted: bool = False) -> tuple[float, bool, int]:
    """The value of the six causes, whether it is proved, and the expansions."""
    search = searcher(six_causes(), ENOUGH, (lambda: True) if interrupted else never)
    return *search.value(
        search_arrays.prior_weights(six_causes()), 0, math.inf, expansions
    ), search.spent


def test_a_search_ends_when_its_budget_is_spent() -> None:
    value, proved, spent = searched()
    assert (value, proved) == (pytest.approx(2.18), True)
    assert spent > 3
    for budget in range(1, spent):
        bound, proved, used = searched(budget)
        assert bound <= 2.18 + 1e-9
        assert (proved, used) == (False, budget)


def test_an_interrupted_search_proves_nothing_and_still_has_a_bound() -> None:
    bound, proved, _ = searched(interrupted=True)
    assert not proved
    assert bound <= 2.18 + 1e-9
    assert searched()[:2] == (pytest.approx(2.18), True)


def test_a_table_of_values_counts_its_states_as_work() -> None:
    table = searcher(two_causes(GUESS, LOOK), ENOUGH)
    assert table.spent == 0
    table.value(search_arrays.prior_weights(two_causes(GUESS, LOOK)), 0, math.inf, ENOUGH)
    assert table.spent >= 1


# What is compared, and what rules do.


@given(isolations(5) | troubles())
@SOME
def test_other_actions_are_listed_by_bounds_on_what_they_cost(problem: Troubleshooting) -> None:
    selector = ActionSelector(problem)
    start = selector.start()
    advice = selector.advise(start)
    compared = selector.compare(start, tuple(range(len(problem.actions))))
    costs = {action: cost for action, cost, proved in compared if proved}
    assert len(costs) == len(problem.actions)
    bounds = [bound for _, bound in advice.runners_up]
    assert bounds == sorted(bounds)
    assert advice.action not in dict(advice.runners_up)
    for action, bound in advice.runners_up:
        assert bound <= costs[action] + 1e-9
    if advice.action is not None:
        assert costs[advice.action] == pytest.approx(advice.expected_cost)


@pytest.mark.parametrize(("loss", "stops"), [(5.0, True), (10.0, True), (20.0, False)])
def test_a_rule_stops_where_going_on_costs_no_less(loss: float, stops: bool) -> None:
    repair = uncertain("mend", 10.0, (1.0,), frozenset({0}))
    problem = Troubleshooting(names(1), (1.0,), (repair,), (Conclusion("ask", (loss,)),))
    selector = ActionSelector(problem)
    advice = selector.rule("p/c")(selector.start())
    assert (advice.action, advice.conclusion) == ((None, 0) if stops else (0, None))
    assert advice.expected_cost == pytest.approx(min(loss, 10.0))


def test_short_tables_change_no_advice() -> None:
    """Forty causes that six tests tell apart bit by bit: more states than a table of 64 holds."""
    tests = tuple(
        certain(f"bit{n}", 1.0 + n, tuple(each >> n & 1 for each in range(40))) for n in range(6)
    )
    problem = Troubleshooting(names(40), (1 / 40,) * 40, tests, each_alone(40))
    ample, cramped = ActionSelector(problem, 0), ActionSelector(problem, 0)
    cramped._bases = (Memo(1 << 6, 0), Memo(1 << 6, 0), Memo(1 << 6, 0))
    cramped._followed = {rule: Memo(1 << 6, 0) for rule in BASE_RULES.values()}
    assert cramped.advise(cramped.start()) == ample.advise(ample.start())
    for name in BASE_RULES:
        assert cramped.rule(name)(cramped.start()) == ample.rule(name)(ample.start())
    assert all(table.length > 1 << 6 for table in (*cramped._bases, *cramped._followed.values()))


@given(isolations(6) | troubles())
@SOME
def test_a_rule_expects_what_its_tree_costs(problem: Troubleshooting) -> None:
    for name in BASE_RULES:
        selector = ActionSelector(problem)
        rule = selector.rule(name)
        assert rule(selector.start()).expected_cost == pytest.approx(
            expected_cost(selector.tree(choose=rule))
        )


def test_a_rule_stops_where_stopping_is_what_it_expects_though_sums_are_rounded() -> None:
    """After t1 and t0 the rule's value is the loss of a conclusion, added up in another order."""
    causes = ("c0", "c1", "c2")
    actions = (
        Action("t0", 2.0, ("yes", "no"), ((0.0, 0.3, 1.0), (1.0, 0.7, 0.0))),
        Action("t1", 1.0, ("yes", "no"), ((1.0, 0.8, 0.1), (0.0, 1.0 - 0.8, 0.9))),
        Action("t2", 9.0, ("yes", "no"), ((0.0, 0.0, 1.0), (1.0, 1.0, 0.0))),
        Action("r0", 4.0, ("yes", "no"), ((0.5, 0.0, 0.0), (0.5, 1.0, 1.0)), frozenset({0})),
    )
    conclusions = (
        *(
            Conclusion(f"it is {n}", tuple(0.0 if n == other else 40.0 for other in range(3)))
            for n in range(3)
        ),
        Conclusion("ask", (9.0, 9.0, 9.0)),
    )
    priors = (41 / 86, 13 / 86, 32 / 86)
    selector = ActionSelector(Troubleshooting(causes, priors, actions, conclusions))
    for name in ("gain", "pairs"):
        rule = selector.rule(name)
        assert expected_cost(selector.tree(choose=rule)) == pytest.approx(
            rule(selector.start()).expected_cost
        )


def test_a_comparison_that_the_budget_ends_gives_lower_bounds() -> None:
    """Six causes, told apart two by two: with no expansions nothing is proved, with enough
    everything.
    """
    causes = 6
    pairs = [tuple(int(cause in (a, a + 1)) for cause in range(causes)) for a in range(causes - 1)]
    actions = tuple(certain(f"t{n}", 1.0 + n / 7, row) for n, row in enumerate(pairs))
    conclusions = tuple(
        Conclusion(str(one), tuple(0.0 if one == other else 50.0 for other in range(causes)))
        for one in range(causes)
    )
    problem = Troubleshooting(
        tuple(f"c{n}" for n in range(causes)), (1.0 / causes,) * causes, actions, conclusions
    )
    hasty, thorough = ActionSelector(problem, 0), ActionSelector(problem)
    every = tuple(range(len(actions)))
    bounds, costs = hasty.compare(hasty.start(), every), thorough.compare(thorough.start(), every)
    assert all(exact for _, _, exact in costs)
    assert not any(exact for _, _, exact in bounds)
    assert all(
        low <= cost * (1 + 1e-9) for (_, low, _), (_, cost, _) in zip(bounds, costs, strict=True)
    )
