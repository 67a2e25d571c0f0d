"""Advice in the middle of a case, advice in haste, and advice of a selector that was asked
before.
"""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.troubleshooting import CaseStanding, Conclude, Tree, Troubleshooting
from cellwright.engine.stages.diagnosis.action_selection import ActionSelector
from tests.engine.stages.diagnosis.fault_cases import certain, isolations, names, troubles

SOME = settings(max_examples=80, deadline=None)


def on_the_way(selector: ActionSelector, steps: st.DataObject) -> CaseStanding:
    """Where a case stands after up to three actions whose outcomes are possible."""
    standing = selector.start()
    for _ in range(steps.draw(st.integers(0, 3))):
        after = [
            selector.observe(standing, action, outcome)
            for action in still_open(selector, standing)
            for outcome in range(len(selector.problem.actions[action].outcomes))
            if outcome not in selector.problem.actions[action].ends
        ]
        if not (possible := [each for each in after if each.possible]):
            break
        standing = steps.draw(st.sampled_from(possible))
    return standing


def still_open(selector: ActionSelector, standing: CaseStanding) -> list[int]:
    """The actions that may still tell something."""
    advice = selector.advise(standing)
    others = [action for action, _ in advice.runners_up]
    return sorted(others if advice.action is None else [advice.action, *others])


def leaves(tree: Tree) -> list[Conclude]:
    """All ends of a tree."""
    return (
        [tree]
        if isinstance(tree, Conclude)
        else [e for _, after in tree.branches for e in leaves(after)]
    )


def cost_of_stopping(selector: ActionSelector, standing: CaseStanding) -> float:
    """What the best conclusion loses; infinite if there is none, or the cause is not sure
    enough for any.
    """
    weights = selector.weights(standing)
    losses = [
        sum(
            loss * weight for loss, weight in zip(each.losses, weights, strict=True) if weight > 0.0
        )
        for each in selector.problem.conclusions
    ]
    return min(losses, default=math.inf) / float(weights.sum())


@given(isolations(5) | troubles(3), st.data())
@SOME
def test_bounds_and_costs_hold_on_the_way(problem: Troubleshooting, steps: st.DataObject) -> None:
    exact, without = ActionSelector(problem), ActionSelector(problem, expansions=0)
    standing = on_the_way(exact, steps)
    best = exact.advise(standing)
    assert best.optimal
    assert best.bound == pytest.approx(best.expected_cost)
    rough = without.advise(standing)
    assert rough.bound <= best.expected_cost * (1 + 1e-9) + 1e-12
    assert rough.expected_cost >= best.expected_cost * (1 - 1e-9) - 1e-12


@given(isolations(5) | troubles(3), st.data())
@SOME
def test_a_tree_from_the_way_shares_out_what_is_left(
    problem: Troubleshooting, steps: st.DataObject
) -> None:
    selector = ActionSelector(problem)
    tree = selector.tree(on_the_way(selector, steps))
    assert tree.probability == pytest.approx(1.0)
    assert sum(each.probability for each in leaves(tree)) == pytest.approx(1.0)


@given(isolations(5) | troubles(3), st.data())
@SOME
def test_advice_in_haste_promises_nothing_and_never_goes_on_dearer_than_stopping(
    problem: Troubleshooting, steps: st.DataObject
) -> None:
    exact, hasty = ActionSelector(problem), ActionSelector(problem, interrupted=lambda: True)
    standing = on_the_way(exact, steps)
    best, advice, stopping = (
        exact.advise(standing),
        hasty.advise(standing),
        cost_of_stopping(exact, standing),
    )
    assert not advice.optimal
    assert advice.bound <= best.expected_cost * (1 + 1e-9) + 1e-12
    assert best.expected_cost <= advice.expected_cost * (1 + 1e-9) + 1e-12
    if advice.action is None:
        assert advice.expected_cost == pytest.approx(stopping)
    else:
        assert advice.expected_cost < stopping


@given(isolations(6) | troubles(), st.data())
@SOME
def test_a_selector_that_was_asked_before_advises_like_a_new_one(
    problem: Troubleshooting, steps: st.DataObject
) -> None:
    asked = ActionSelector(problem, expansions=0)
    for _ in range(3):
        standing = on_the_way(asked, steps)
        new = ActionSelector(problem, expansions=0).advise(standing)
        again = asked.advise(standing)
        assert (again.action, again.conclusion) == (new.action, new.conclusion)
        assert again.expected_cost == pytest.approx(new.expected_cost)


@given(isolations(3) | troubles(3))
@SOME
def test_nothing_is_advised_where_no_cause_is_possible(problem: Troubleshooting) -> None:
    with pytest.raises(ValueError, match="no cause"):
        ActionSelector(problem).advise(CaseStanding(0, 0, 0))


def test_advice_in_haste_is_bounded_by_what_the_causes_would_cost_if_they_were_known() -> None:
    repairs = (
        certain("tighten", 3.0, (0, 1), frozenset({0})),
        certain("replace", 5.0, (1, 0), frozenset({0})),
    )
    selector = ActionSelector(
        Troubleshooting(names(2), (0.5, 0.5), repairs), interrupted=lambda: True
    )
    advice = selector.advise(selector.start())
    assert advice.bound == pytest.approx(4.0)
    assert advice.action is not None
    assert advice.expected_cost >= 3.0 + 0.5 * 5.0
