"""Uses of a decision tree: follow it for a hidden cause, or price it under other beliefs or set-up costs."""

import random

from cellwright.engine.model.troubleshooting import Conclude, Tree, Troubleshooting, Try


def simulated_cost(problem: Troubleshooting, tree: Tree, chance: random.Random) -> float:
    """The cost of one simulated case: a cause is drawn from the priors, and outcomes from their likelihoods."""
    cause = chance.choices(range(len(problem.causes)), problem.priors)[0]
    return cost_of_case(problem, tree, cause, chance)


def cost_of_case(problem: Troubleshooting, tree: Tree, cause: int, chance: random.Random) -> float:
    """The cost of following a tree if `cause` is the cause."""
    cost = 0.0
    while isinstance(tree, Try):
        cost += tree.cost
        rows = problem.actions[tree.action].likelihoods
        outcome = chance.choices(range(len(rows)), [row[cause] for row in rows])[0]
        tree = dict(tree.branches)[outcome]
    return cost + (problem.conclusions[tree.conclusion].losses[cause] if tree.conclusion is not None else 0.0)


def cost_under(problem: Troubleshooting, tree: Tree) -> float:
    """The expected cost of following a tree under the priors, set-up and losses of `problem`.

    The tree may have been made for other beliefs.
    """
    return _cost(problem, tree, problem.priors, 0)


def _cost(problem: Troubleshooting, tree: Tree, weights: tuple[float, ...], situation: int) -> float:
    if isinstance(tree, Conclude):
        if tree.conclusion is None:
            return 0.0
        losses = problem.conclusions[tree.conclusion].losses
        return sum(weight * loss for weight, loss in zip(weights, losses, strict=True) if weight > 0.0)
    action, setup = problem.actions[tree.action], problem.setup
    extra = setup.costs[situation][tree.action] if setup else 0.0
    after = setup.following[situation][tree.action] if setup else 0
    total = (action.cost + extra) * sum(weights)
    for outcome, branch in tree.branches:
        row = action.likelihoods[outcome]
        total += _cost(problem, branch, tuple(w * p for w, p in zip(weights, row, strict=True)), after)
    return total
