"""What is done with decision trees: following one with each cause gives, on average, what it is
expected to cost.
"""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.troubleshooting import Troubleshooting, expected_cost
from cellwright.engine.stages.diagnosis.action_selection import BASE_RULES, ActionSelector
from cellwright.engine.stages.diagnosis.hidden_cause import cost_of_case, cost_under, simulated_cost
from tests.engine.stages.diagnosis.fault_cases import isolations, priors, troubles

MANY = settings(max_examples=60, deadline=None)


@given(isolations(5) | troubles())
@MANY
def test_a_tree_costs_under_its_own_beliefs_what_it_is_expected_to_cost(
    problem: Troubleshooting,
) -> None:
    selector = ActionSelector(problem)
    tree = selector.tree()
    assert cost_under(problem, tree) == pytest.approx(expected_cost(tree))


@given(isolations(5), st.data())
@MANY
def test_a_tree_costs_under_other_beliefs_the_mean_of_its_cases(
    problem: Troubleshooting, data: st.DataObject
) -> None:
    """Tests are certain, so that each cause leads to one leaf; set-up costs are those that the
    tree was made for.
    """
    tree = ActionSelector(problem).tree()
    other = data.draw(priors(len(problem.causes)))
    costs = [cost_of_case(problem, tree, cause, random.Random(0)) for cause in range(len(other))]
    changed = Troubleshooting(
        problem.causes, other, problem.actions, problem.conclusions, problem.setup
    )
    assert cost_under(changed, tree) == pytest.approx(
        math.fsum(p * c for p, c in zip(other, costs, strict=True))
    )


@given(troubles(3), st.sampled_from(list(BASE_RULES)))
@settings(max_examples=10, deadline=None)
def test_cases_that_are_drawn_cost_on_average_what_is_expected(
    problem: Troubleshooting, rule: str
) -> None:
    selector, chance = ActionSelector(problem), random.Random(1)
    tree = selector.tree(choose=selector.rule(rule))
    drawn = [simulated_cost(problem, tree, chance) for _ in range(3000)]
    spread = math.sqrt(sum((each - sum(drawn) / 3000) ** 2 for each in drawn) / 3000) + 1e-9
    assert abs(sum(drawn) / 3000 - expected_cost(tree)) <= 6 * spread / math.sqrt(3000) + 1e-6
